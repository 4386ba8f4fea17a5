//! Initial belief at a touch: hypotheses along the whisker, with the displacement from the first readings.

use filters::Gaussian;
use nalgebra::{Matrix3, Vector2, Vector3};

use super::side::{Expected, Side};
use crate::space::sensor::Around;

/// Newton steps for the displacement that explains the readings.
const NEWTON_STEPS: usize = 8;

/// Standard deviation of the distance along the whisker between the contacts before and after a slip (m).
const NEARBY_M: f64 = 3e-3;

/// Gaussians of the contact at the touch with their weights: the calibrated part of the whisker is divided into `count` intervals
/// of equal ratio, since the readings are nearly powers of the arc length; the standard deviation along the whisker is half an
/// interval, the weight its length. The displacement follows from the two readings, with their
/// uncertainty, so no position along the whisker is favoured before it is known how the readings grow. A whisker that has slipped
/// off an object bears on it again nearby, at an arc length about `near_m`, or anywhere, with equal probability. If the slip
/// is detected late, `near_m` may lie outside the calibrated part; it is then moved to the border of that part.
pub(super) fn beliefs(
    side: &Side,
    count: usize,
    near_m: Option<f64>,
    reading_n_m: Vector2<f64>,
) -> Vec<(Gaussian<3>, f64)> {
    let (first_m, high_m) = side.calibrated.domain.tabulated_range_m();
    let edge_m = |i: usize| first_m * (high_m / first_m).powf(i as f64 / count as f64);
    let anywhere = (0..count).filter_map(|i| {
        let (from_m, to_m) = (edge_m(i), edge_m(i + 1));
        let belief = pushed(side, 0.5 * (from_m + to_m), 0.5 * (to_m - from_m), reading_n_m)?;
        Some((belief, to_m - from_m))
    });
    let nearby = near_m.and_then(|near_m| {
        let near_m = near_m.clamp(first_m, high_m);
        Some((pushed(side, near_m, NEARBY_M, reading_n_m)?, high_m - first_m))
    });
    anywhere.chain(nearby).collect()
}

/// The belief that the contact lies about `along_m`, displaced so that it has these readings. `None` if no displacement does.
fn pushed(side: &Side, along_m: f64, sd_m: f64, reading_n_m: Vector2<f64>) -> Option<Gaussian<3>> {
    let mut at = Around::new(along_m, 0.0, 0.0);
    for _ in 0..NEWTON_STEPS {
        let Expected { reading_n_m: expected_n_m, slopes, .. } = side.expect(at);
        let across = slopes.fixed_columns::<2>(1).try_inverse()?;
        let step = across * (reading_n_m - expected_n_m);
        at = Around::new(along_m, at.left_m + step.x, at.up_m + step.y);
        let mut x = at.vector();
        side.hold(&mut x);
        at = Around::of_state(&x);
    }
    let slopes = side.expect(at).slopes;
    let across = slopes.fixed_columns::<2>(1).try_inverse()?;
    // Along a line of equal readings, and across it.
    let shift = -across * slopes.column(0);
    let line = Vector3::new(1.0, shift.x, shift.y) * sd_m;
    let mut covariance: Matrix3<f64> = line * line.transpose();
    let of_reading = across * side.covariance_n2_m2(at) * across.transpose();
    covariance.fixed_view_mut::<2, 2>(1, 1).zip_apply(&of_reading, |entry, added| *entry += added);
    Some(Gaussian::new(at.vector(), covariance))
}
