//! Common-mode calibration: influence of the reference sensor's counts on those of a sensor, with the board at rest at
//! several headings.
//!
//! Only the two horizontal axes are used. A board that rotates in the plane sees a constant vertical field, so the
//! third coefficient is unobservable.

use nalgebra::{Matrix2, Vector2};

use super::board::{Board, Counts, samples_in};
use crate::front_end::mounting::Mounting;
use crate::statistics::mean;

/// Number of equally spaced headings and the time at rest at each. The time averages the noise of the reference, which
/// would bias the influence towards zero.
const HEADINGS: usize = 24;
const STILL_S: f64 = 1.0;

/// Significance level of the F-test: probability of accepting an influence that is noise alone.
const MOST_CHANCE: f64 = 1e-3;

/// Estimates the influence of the reference's x and y axes on the sensor in a slot.
pub(super) fn fit_at_headings(board: &Board, mounting: &Mounting, slot: usize, seed: u64, dt_s: f64) -> [f64; 2] {
    let mut reader = board.reader(&mounting.on("headings"), seed);
    let stops: Vec<Counts> = (0..HEADINGS)
        .map(|heading| {
            let yaw_rad = std::f64::consts::TAU * heading as f64 / HEADINGS as f64;
            let still = reader.rest(slot, samples_in(STILL_S, dt_s), dt_s, yaw_rad);
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

/// Least-squares fit of `own = rest + influence . reference`. Returns zero unless the influence is significant at level
/// [`MOST_CHANCE`], since noise would be fitted to noise if the field at the reference does not change.
///
/// F-test: `F = ((S0 - S) / 2) / (S / (n - 3))` with the residual sums of squares `S0` without and `S` with the
/// influence. With two numerator degrees of freedom, the p-value of `F` is `(1 + 2 F / (n - 3))^-((n - 3) / 2) = (S /
/// S0)^((n - 3) / 2)`.
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
    fn verif_fit_recovers_the_influence() {
        let stop = |x: f64, y: f64| Counts { own: 7.0 + 0.02 * x + 1.1 * y, reference: [x, y] };
        let [x, y] = fit(&[stop(1.0, 0.0), stop(0.0, 6.0), stop(-5.0, -1.0), stop(2.0, -3.0)]);
        assert!((x - 0.02).abs() < 1e-12 && (y - 1.1).abs() < 1e-12);
        assert_eq!(fit(&[stop(3.0, 3.0); 4]), [0.0, 0.0]);
        let noise = |i: u32| f64::from((i * 7919) % 13) - 6.0;
        let unrelated: Vec<Counts> =
            (0..24).map(|i| Counts { own: noise(i), reference: [noise(i + 31), noise(3 * i + 5)] }).collect();
        assert_eq!(fit(&unrelated), [0.0, 0.0], "noise must not be fitted");
    }
}
