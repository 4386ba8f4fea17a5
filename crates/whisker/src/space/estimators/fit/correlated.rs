//! Errors of the sensor model that are correlated along the path of a contact, as those of a real sensor are because of friction,
//! hysteresis and interpolation between the calibrated lines.
//!
//! From one mean of readings to the next, the errors are modelled as an Ornstein-Uhlenbeck process (Gardiner, "Stochastic
//! methods", 2009, section 3.8.4): given the previous error, an error is independent of all earlier ones. Generalised least
//! squares with their joint covariance is then least squares of the changes from mean to mean. With measurement noise this is an
//! approximation: only the correlation with the previous mean counts. A jump, as by stick-slip, is an outlier of a single change.

use nalgebra::{Cholesky, Const, Matrix2x4, SMatrix, Vector2};

use crate::frames::Start;
use crate::space::frames::Point;
use crate::space::sensor::exponential;

/// Smallest standard deviation of the change of an error from one mean to the next, relative to that of the error: the variance of
/// a change is at least half that of the error. The contacts of a calibration are millimetres apart and do not determine changes
/// over shorter distances, such as those by stick-slip.
const LEAST_CHANGE: f64 = std::f64::consts::FRAC_1_SQRT_2;

/// Mean of readings, normalised by its covariance, whose error is correlated with that of the next mean.
#[derive(Clone, Copy, Debug)]
pub(super) struct Link<const N: usize> {
    row: Row<N>,
    /// Middle of the undeflected whisker.
    place: Point<Start>,
    /// Square root of the share of the error of the sensor model in the variance of error and measurement noise.
    share: f64,
}

/// Residual of a mean, its derivatives with respect to the state, and the effects of errors common to all means.
pub(super) type Row<const N: usize> = (Vector2<f64>, SMatrix<f64, 2, N>, Matrix2x4<f64>);

impl<const N: usize> Link<N> {
    /// Link of a mean, given the Cholesky factor of its covariance.
    pub(super) fn new(
        factor: &Cholesky<f64, Const<2>>,
        (residual, slopes, common): Row<N>,
        place: Point<Start>,
        share: f64,
    ) -> Self {
        let l = factor.l();
        let row = (
            l.solve_lower_triangular_unchecked(&residual),
            l.solve_lower_triangular_unchecked(&slopes),
            l.solve_lower_triangular_unchecked(&common),
        );
        Self { row, place, share }
    }

    /// Change from the previous mean: the part of the row that is independent of it, in units of its standard deviation. Without a
    /// previous mean, the row itself.
    pub(super) fn change_from(&self, last: Option<&Self>, length_m: f64) -> Row<N> {
        let Some(last) = last else { return self.row };
        let share = exponential(self.place.distance(&last.place), length_m) * self.share * last.share;
        let sd = (1.0 - share * share).sqrt().max(LEAST_CHANGE);
        let ((a, b, c), (x, y, z)) = (self.row, last.row);
        ((a - x * share) / sd, (b - y * share) / sd, (c - z * share) / sd)
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Matrix2;

    use super::*;

    /// The changes from mean to mean have the cost and the curvature of generalised least squares with the joint covariance of an
    /// Ornstein-Uhlenbeck process.
    #[test]
    fn verif_changes_of_correlated_errors_are_those_of_their_joint_covariance() {
        const LENGTH_M: f64 = 5e-3;
        let places = [0.0, 2e-3, 5e-3, 12e-3].map(|x_m| Point::<Start>::new(x_m, 0.0, 0.0));
        let covariance = Matrix2::new(2.0, 0.5, 0.5, 1.0);
        let residuals = [[0.3, -0.2], [0.5, 0.4], [-0.7, 0.1], [0.2, 0.9]].map(Vector2::from);
        let slopes =
            |i: usize| SMatrix::<f64, 2, 3>::from_fn(|row, column| ((1 + row + 2 * column) * (i + 1)) as f64 * 0.1);
        let factor = covariance.cholesky().unwrap();
        let (mut last, mut cost, mut curvature) = (None, 0.0, SMatrix::<f64, 3, 3>::zeros());
        for (i, place) in places.iter().enumerate() {
            let link = Link::new(&factor, (residuals[i], slopes(i), Matrix2x4::zeros()), *place, 1.0);
            let (residual, slopes, _) = link.change_from(last.as_ref(), LENGTH_M);
            cost += residual.norm_squared();
            curvature += slopes.tr_mul(&slopes);
            last = Some(link);
        }
        let shared = |i: usize, j: usize| exponential(places[i].distance(&places[j]), LENGTH_M);
        let joint = SMatrix::<f64, 8, 8>::from_fn(|i, j| covariance[(i % 2, j % 2)] * shared(i / 2, j / 2));
        let residual = SMatrix::<f64, 8, 1>::from_fn(|i, _| residuals[i / 2][i % 2]);
        let jacobian = SMatrix::<f64, 8, 3>::from_fn(|i, j| slopes(i / 2)[(i % 2, j)]);
        let factor = joint.cholesky().unwrap();
        assert!((cost - residual.dot(&factor.solve(&residual))).abs() < 1e-9);
        assert!((curvature - jacobian.tr_mul(&factor.solve(&jacobian))).norm() < 1e-9);
    }

    #[test]
    fn verif_the_change_of_an_error_at_the_same_place_has_half_of_its_variance() {
        let link = |error: f64| {
            let row = (Vector2::new(error, 0.0), SMatrix::<f64, 2, 3>::zeros(), Matrix2x4::zeros());
            Link::new(&Matrix2::identity().cholesky().unwrap(), row, Point::new(0.0, 0.0, 0.0), 1.0)
        };
        let (change, ..) = link(3.0).change_from(Some(&link(1.0)), 5e-3);
        assert!((change.norm_squared() - 2.0 * 2.0_f64.powi(2)).abs() < 1e-12, "{change}");
    }
}
