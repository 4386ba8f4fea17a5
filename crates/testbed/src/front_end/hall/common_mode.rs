//! How much of the reference sensor's counts appears in those of a sensor, learnt at rest while the board is turned.
//!
//! Only the two axes in the plane are used: a board that turns in the plane sees the same vertical field throughout, so nothing would tell the third.

use nalgebra::{Matrix2, Vector2};

use super::{Board, Counts, Mounting, samples_in};
use crate::statistics::mean;

/// Headings, evenly spread, at which the board stands still, and for how long. It is read there for so long that the noise of the reference, which would pass
/// for a smaller influence, averages out.
const HEADINGS: usize = 24;
const STILL_S: f64 = 1.0;

/// Most probability with which noise alone would look like an influence.
const MOST_CHANCE: f64 = 1e-3;

/// The influence of the reference's x and y on the sensor of a whisker.
pub(super) fn learn(board: &Board, mounting: &Mounting, seat: usize, seed: u64, dt_s: f64) -> [f64; 2] {
    let mut watch = board.watch(&mounting.on("headings"), seed);
    let stops: Vec<Counts> = (0..HEADINGS)
        .map(|heading| {
            let yaw_rad = std::f64::consts::TAU * heading as f64 / HEADINGS as f64;
            let still = watch.rest(seat, samples_in(STILL_S, dt_s), dt_s, yaw_rad);
            average(&still)
        })
        .collect();
    fit(&stops)
}

fn average(counts: &[Counts]) -> Counts {
    let of = |value: &dyn Fn(&Counts) -> f64| mean(counts.iter().map(value)).unwrap_or(0.0);
    Counts {
        own: of(&|counts| counts.own),
        reference: [of(&|counts| counts.reference[0]), of(&|counts| counts.reference[1])],
    }
}

/// Least squares of `own = rest + influence . reference`. No influence where that explains no more of the sensor's counts than noise would: where the reference sees
/// nothing change, least squares fits noise to noise. By the F-test at [`MOST_CHANCE`]: `F = ((S0 - S) / 2) / (S / (n - 3))` with the sums of squares `S0` without
/// and `S` with the influence; with two degrees of freedom above, `F` is larger by chance with the probability `(1 + 2 F / (n - 3))^-((n - 3) / 2)`, which is `(S / S0)^((n - 3) / 2)`.
fn fit(stops: &[Counts]) -> [f64; 2] {
    let middle = average(stops);
    let mut normal = Matrix2::zeros();
    let mut right = Vector2::zeros();
    for stop in stops {
        let reference = Vector2::from(stop.reference) - Vector2::from(middle.reference);
        normal += reference * reference.transpose();
        right += reference * (stop.own - middle.own);
    }
    let Some(influence) = normal.cholesky().map(|normal| normal.solve(&right)) else { return [0.0; 2] };
    let squares = |influence: Vector2<f64>| -> f64 {
        let left = |stop: &Counts| {
            let reference = Vector2::from(stop.reference) - Vector2::from(middle.reference);
            stop.own - middle.own - influence.dot(&reference)
        };
        stops.iter().map(|stop| left(stop).powi(2)).sum()
    };
    let chance = (squares(influence) / squares(Vector2::zeros())).powf(0.5 * (stops.len() as f64 - 3.0));
    if chance < MOST_CHANCE { influence.into() } else { [0.0; 2] }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn verif_fit_finds_the_influence() {
        let stop = |x: f64, y: f64| Counts { own: 7.0 + 0.02 * x + 1.1 * y, reference: [x, y] };
        let [x, y] = fit(&[stop(1.0, 0.0), stop(0.0, 6.0), stop(-5.0, -1.0), stop(2.0, -3.0)]);
        assert!((x - 0.02).abs() < 1e-12 && (y - 1.1).abs() < 1e-12);
        assert_eq!(fit(&[stop(3.0, 3.0); 4]), [0.0, 0.0]);
        let noise = |i: u32| f64::from((i * 7919) % 13) - 6.0;
        let unrelated: Vec<Counts> =
            (0..24).map(|i| Counts { own: noise(i), reference: [noise(i + 31), noise(3 * i + 5)] }).collect();
        assert_eq!(fit(&unrelated), [0.0, 0.0], "noise is no influence");
    }
}
