//! Common-mode calibration in space: influence of the reference's three axes on those of the sensor, with the board at
//! rest in several orientations. Unlike headings in the plane, these show the earth's field along all three axes.

use nalgebra::{Matrix3, Rotation3, Vector3};

use super::board::{Board, Counts};
use crate::front_end::hall::board::samples_in;

/// Time at rest in each orientation, which averages the noise of the reference.
const STILL_S: f64 = 1.0;

/// Number of orientations: the rotations of a cube onto itself.
const ORIENTATIONS: usize = 24;

/// Largest value of the F statistic that is taken for chance, for each axis of the sensor: 99.9 % of the F distribution
/// with 3 and 20 degrees of freedom lie below it.
const MOST_BY_CHANCE: f64 = 8.098;

/// Estimates the influence of the reference (columns) on the sensor (rows).
pub(super) fn fit_at_orientations(board: &Board, seed: u64, dt_s: f64) -> Matrix3<f64> {
    let mut reader = board.reader("orientations", seed);
    let stops: Vec<Counts> =
        orientations().iter().map(|base| average(&reader.rest(samples_in(STILL_S, dt_s), dt_s, base))).collect();
    fit(&stops)
}

/// Rotations of a cube onto itself: four about each of the six directions into which x may be turned.
fn orientations() -> Vec<Rotation3<f64>> {
    let quarter = std::f64::consts::FRAC_PI_2;
    let about = |axis, quarters: f64| Rotation3::from_axis_angle(&axis, quarters * quarter);
    let mut found = Vec::with_capacity(ORIENTATIONS);
    for turn in 0..4 {
        let roll = about(Vector3::x_axis(), f64::from(turn));
        found.extend((0..4).map(|quarters| about(Vector3::z_axis(), f64::from(quarters)) * roll));
        found.extend([1.0, -1.0].map(|quarters| about(Vector3::y_axis(), quarters) * roll));
    }
    found
}

fn average(counts: &[Counts]) -> Counts {
    let of = |value: fn(&Counts) -> Vector3<f64>| {
        counts.iter().map(value).sum::<Vector3<f64>>() / counts.len().max(1) as f64
    };
    Counts { own: of(|counts| counts.own), reference: of(|counts| counts.reference) }
}

/// Least-squares fit of `own = rest + influence . reference` for each axis. The influence on an axis is zero unless it
/// is significant, since noise would be fitted to noise if the field at the reference does not change.
///
/// F-test: `F = ((S0 - S) / 3) / (S / (n - 4))` with the residual sums of squares `S0` without and `S` with influence.
fn fit(stops: &[Counts]) -> Matrix3<f64> {
    let middle = average(stops);
    let (mut normal, mut right) = (Matrix3::zeros(), Matrix3::zeros());
    for stop in stops {
        let (own, reference) = (stop.own - middle.own, stop.reference - middle.reference);
        normal += reference * reference.transpose();
        right += reference * own.transpose();
    }
    let Some(cholesky) = normal.cholesky() else { return Matrix3::zeros() };
    let mut influence = cholesky.solve(&right).transpose();
    for axis in 0..3 {
        let squares = |kept: f64| -> f64 {
            let left = |stop: &Counts| {
                let expected = kept * (influence.row(axis) * (stop.reference - middle.reference))[0];
                stop.own[axis] - middle.own[axis] - expected
            };
            stops.iter().map(|stop| left(stop).powi(2)).sum()
        };
        let (without, with) = (squares(0.0), squares(1.0));
        if (without - with) / 3.0 <= MOST_BY_CHANCE * with / (stops.len() as f64 - 4.0) {
            influence.set_row(axis, &nalgebra::RowVector3::zeros());
        }
    }
    influence
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn verif_the_orientations_are_the_rotations_of_a_cube() {
        let found = orientations();
        assert_eq!(found.len(), ORIENTATIONS);
        for (place, one) in found.iter().enumerate() {
            assert!(found[..place].iter().all(|other| one.angle_to(other) > 1.0), "{place}");
            assert!(one.matrix().iter().all(|cell| (cell - cell.round()).abs() < 1e-12));
        }
    }

    #[test]
    fn verif_fit_recovers_the_influence() {
        let influence = Matrix3::new(1.1, 0.02, 0.0, -0.03, 0.9, 0.01, 0.04, 0.0, 1.05);
        let stops: Vec<Counts> = orientations()
            .iter()
            .map(|base| base * Vector3::new(3.0, -5.0, 9.0))
            .map(|reference| Counts { own: Vector3::new(7.0, 8.0, -9.0) + influence * reference, reference })
            .collect();
        assert!((fit(&stops) - influence).norm() < 1e-12);
        assert_eq!(fit(&[stops[0]; ORIENTATIONS]), Matrix3::zeros());
        let noise = |i: usize| ((i * 7919) % 13) as f64 - 6.0;
        let unrelated: Vec<Counts> = (0..ORIENTATIONS)
            .map(|i| Counts {
                own: Vector3::new(noise(i), noise(5 * i + 3), noise(2 * i + 1)),
                reference: Vector3::new(noise(i + 31), noise(3 * i + 5), noise(7 * i + 2)),
            })
            .collect();
        assert_eq!(fit(&unrelated), Matrix3::zeros(), "noise must not be fitted");
    }
}
