//! Strokes: segments of a motion between reversals.

use nalgebra::{Matrix2, Vector2};
use trace::Recording;
use whisker::RestShape;

/// Smallest reversal, as a fraction of the range of the motion.
const LEAST_SHARE: f64 = 0.1;

/// First row of the second stroke: the first reversal of the motion after the row `touch`. `None` if there is no
/// reversal.
///
/// The motion is that of the midpoint of the undeflected whisker, so that rotations of the base count too, projected on
/// its principal direction over the rows from `touch` on.
pub fn second_stroke(recording: &Recording, rest: &RestShape, touch: usize) -> Option<usize> {
    let middle = rest.point(0.5 * rest.length_m());
    let places: Vec<Vector2<f64>> =
        recording.instants[touch..].iter().map(|known| known.base.apply(middle).vector()).collect();
    let mean = places.iter().sum::<Vector2<f64>>() / places.len() as f64;
    let spread: Matrix2<f64> = places.iter().map(|place| (place - mean) * (place - mean).transpose()).sum();
    let principal = spread.symmetric_eigen();
    let axis: Vector2<f64> = principal.eigenvectors.column(principal.eigenvalues.imax()).into();
    let ways_m: Vec<f64> = places.iter().map(|place| axis.dot(place)).collect();
    first_reversal(&ways_m).map(|row| touch + row)
}

/// Row of the first reversal of a displacement.
fn first_reversal(ways_m: &[f64]) -> Option<usize> {
    let all = |pick: fn(f64, f64) -> f64| ways_m.iter().copied().reduce(pick);
    let least_m = LEAST_SHARE * (all(f64::max)? - all(f64::min)?);
    // Rows of the running minimum and maximum. A reversal is an extremum that is left by more than the threshold.
    let (mut low, mut high) = (0, 0);
    for (row, &way_m) in ways_m.iter().enumerate() {
        if way_m < ways_m[low] {
            low = row;
        }
        if way_m > ways_m[high] {
            high = row;
        }
        if high > low && ways_m[high] - way_m > least_m && ways_m[high] - ways_m[0] > least_m {
            return Some(high);
        }
        if low > high && way_m - ways_m[low] > least_m && ways_m[0] - ways_m[low] > least_m {
            return Some(low);
        }
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn verif_the_second_stroke_starts_at_the_first_reversal() {
        let there_and_back: Vec<f64> = (0..100).map(|i| (f64::from(i) * 0.1).sin()).collect();
        assert_eq!(first_reversal(&there_and_back), Some(16));
        let away: Vec<f64> = there_and_back.iter().map(|way| -way).collect();
        assert_eq!(first_reversal(&away), Some(16));
        let shaking: Vec<f64> = (0..100).map(|i| f64::from(i) + 3.0 * f64::from(i % 2)).collect();
        assert_eq!(first_reversal(&shaking), None);
        assert_eq!(first_reversal(&[1.0, 1.0]), None);
        assert_eq!(first_reversal(&[]), None);
    }
}
