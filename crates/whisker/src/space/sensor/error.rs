//! Error of a sensor model over its calibrated domain, in addition to that which the model predicts, as a covariance of both
//! bending moments.

use nalgebra::{Matrix2, Vector2};
use serde::{Deserialize, Serialize};

use super::{Around, SpatialDomain};
use crate::frames::Base;
use crate::sensor::Shares;
use crate::sensor::error_map::corners;
use crate::space::frames::Point;

/// Nodes along and away.
const NODES: (usize, usize) = (4, 4);

/// Weight of the region's mean at each node, in samples of an average node.
const SHRINKAGE: f64 = 0.5;

/// Covariance of the error in addition to [`SpatialModel::sd_n_m`](super::SpatialModel::sd_n_m), on nodes spread evenly over the
/// calibrated domain, along the whisker and away from it; linear in between.
///
/// Its axes turn with the direction of the contact about the whisker: the first is the moment that bends a straight whisker in
/// this direction, the second the moment across it. A calibration has few lines in each direction, so that the covariance is
/// taken as the same in all.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SpatialErrorMap {
    /// Nodes along the whisker, from the first calibrated arc length to the last.
    pub along: usize,
    /// Nodes away from it, from the undeflected whisker to the largest calibrated distance.
    pub away: usize,
    /// Variance in the first axis, covariance, and variance in the second (N2 m2), those of one arc length in sequence.
    pub covariances_n2_m2: Vec<[f64; 3]>,
    /// Correlation length of the error along the path of a contact (m). `None` if unknown or for a simulated sensor.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub correlation_m: Option<f64>,
}

/// Correlation of the errors at two contacts of one path, `distance_m` apart: the exponential covariance function of an
/// Ornstein-Uhlenbeck process.
pub(crate) fn exponential(distance_m: f64, length_m: f64) -> f64 {
    (-distance_m / length_m).exp()
}

/// Smallest share of the error that counts as new.
const LEAST_SHARE: f64 = 1e-3;

/// A residual on held-out data.
#[derive(Clone, Copy, Debug)]
pub(super) struct Residual {
    pub(super) contact: Point<Base>,
    pub(super) at: Around,
    /// Error of the bending moments about y and z.
    pub(super) error_n_m: Vector2<f64>,
    /// Standard deviations that the model predicts at the contact, [`SpatialModel::sd_n_m`](super::SpatialModel::sd_n_m).
    pub(super) sd_n_m: Vector2<f64>,
    /// Variance of each of them by the noise of the reference.
    pub(super) noise_n2_m2: f64,
}

/// Rotation from the axes of the direction of a contact to those of Base, 2x2. At the left of the whisker the first axis is the
/// moment about z, above it the negative one about y.
fn axes(at: Around) -> Matrix2<f64> {
    let (sin, cos) = at.azimuth_rad().sin_cos();
    Matrix2::new(-sin, cos, cos, sin)
}

impl SpatialErrorMap {
    /// The map of residuals on held-out data. `least` is the smallest variance of each moment. The variances that the model
    /// predicts are subtracted, since they are added to the map: at the contacts of the calibration, the sum is the error on
    /// held-out data, or the predicted one if it is larger, and it varies elsewhere as the predicted variances do.
    pub(super) fn new(domain: &SpatialDomain, residuals: &[Residual], least: f64) -> Self {
        let (along, away) = NODES;
        let mut weights = vec![0.0; along * away];
        let mut sums = vec![Matrix2::zeros(); along * away];
        for residual in residuals {
            let (axes, Residual { error_n_m, sd_n_m, noise_n2_m2, .. }) = (axes(residual.at), *residual);
            let turned = axes.transpose() * error_n_m;
            let predicted = axes.transpose() * Matrix2::from_diagonal(&sd_n_m.component_mul(&sd_n_m)) * axes;
            let square = turned * turned.transpose() - Matrix2::identity() * noise_n2_m2 - predicted;
            for (node, weight) in corners(along, away, domain.shares(residual.at)) {
                weights[node] += weight;
                sums[node] += square * weight;
            }
        }
        let count = residuals.len() as f64;
        let mean = sums.iter().sum::<Matrix2<f64>>() / count;
        let prior = SHRINKAGE * count / sums.len() as f64;
        let at_node = |(sum, weight): (&Matrix2<f64>, &f64)| raised((sum + mean * prior) / (weight + prior), least);
        let covariances = sums.iter().zip(&weights).map(at_node);
        let covariances_n2_m2 = covariances.map(|c| [c[(0, 0)], c[(0, 1)], c[(1, 1)]]).collect();
        Self { along, away, covariances_n2_m2, correlation_m: None }
    }

    /// The map with a known correlation length (m).
    pub(super) fn with_correlation(self, length_m: f64) -> Self {
        Self { correlation_m: Some(length_m), ..self }
    }

    /// The map with an additional error of the readings, of this standard deviation in every direction.
    pub(super) fn with_offset(&self, sd_n_m: f64) -> Self {
        let widened = |&[first, mixed, second]: &[f64; 3]| [first + sd_n_m * sd_n_m, mixed, second + sd_n_m * sd_n_m];
        Self { covariances_n2_m2: self.covariances_n2_m2.iter().map(widened).collect(), ..self.clone() }
    }

    /// Share of the error at a contact that counts as new after a path (m) since the previous contact. It reaches 1 at twice the
    /// correlation length, the integral of the correlation over both directions. 1 if the correlation length is unknown.
    pub(crate) fn new_share(&self, path_m: f64) -> f64 {
        self.correlation_m.map_or(1.0, |length_m| (path_m / (2.0 * length_m)).clamp(LEAST_SHARE, 1.0))
    }

    /// Whether the lists describe a map.
    pub fn is_valid(&self) -> bool {
        let is_definite = |&[first, mixed, second]: &[f64; 3]| {
            first.is_finite() && second.is_finite() && first > 0.0 && second > 0.0 && mixed * mixed < first * second
        };
        self.along >= 2
            && self.away >= 2
            && Some(self.covariances_n2_m2.len()) == self.along.checked_mul(self.away)
            && self.covariances_n2_m2.iter().all(is_definite)
            && self.correlation_m.is_none_or(|length_m| length_m.is_finite() && length_m > 0.0)
    }

    /// Covariance of these errors of the bending moments about y and z of Base at a contact (N2 m2), 2x2, given its position within
    /// the calibrated domain.
    pub(crate) fn covariance_at(&self, at: Around, shares: Shares) -> Matrix2<f64> {
        let mut covariance = Matrix2::zeros();
        for (node, weight) in corners(self.along, self.away, shares) {
            let [first, mixed, second] = self.covariances_n2_m2[node];
            covariance += Matrix2::new(first, mixed, mixed, second) * weight;
        }
        let axes = axes(at);
        axes * covariance * axes.transpose()
    }
}

/// A covariance whose principal variances are at least `least`.
fn raised(covariance: Matrix2<f64>, least: f64) -> Matrix2<f64> {
    let mut parts = covariance.symmetric_eigen();
    parts.eigenvalues.iter_mut().for_each(|variance| *variance = variance.max(least));
    parts.recompose()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::space::sensor::Across;

    fn domain() -> SpatialDomain {
        SpatialDomain { arc_m: vec![0.03, 0.06], directions: 4, away_m: vec![5e-3; 8], across: Across::Normal }
    }

    /// Errors along the direction of the contact alone, three times as large far from the whisker as near it.
    fn residuals() -> Vec<Residual> {
        let mut residuals = Vec::new();
        for i in 0..200_i32 {
            for j in 0..40 {
                let (azimuth, away_m) = (0.31 * f64::from(i), 1.2e-4 * (f64::from(j) + 0.5));
                let at = Around::new(0.045, away_m * azimuth.cos(), away_m * azimuth.sin());
                let size = if i % 2 == 0 { 1.0 } else { -1.0 } * (1.0 + 2.0 * f64::from(j) / 40.0);
                let error_n_m = axes(at).column(0) * size;
                residuals.push(Residual {
                    contact: Point::new(0.045, 0.0, 0.0),
                    at,
                    error_n_m,
                    sd_n_m: Vector2::zeros(),
                    noise_n2_m2: 0.0,
                });
            }
        }
        residuals
    }

    fn covariance(map: &SpatialErrorMap, at: Around) -> Matrix2<f64> {
        map.covariance_at(at, domain().shares(at))
    }

    #[test]
    fn verif_the_map_follows_the_residuals_and_turns_with_the_contact() {
        let map = SpatialErrorMap::new(&domain(), &residuals(), 1e-6);
        assert!(map.is_valid());
        let near = covariance(&map, Around::new(0.045, 0.5e-3, 0.0));
        let far = covariance(&map, Around::new(0.045, 4.5e-3, 0.0));
        let above = covariance(&map, Around::new(0.045, 0.0, 4.5e-3));
        assert!(far[(1, 1)] > 2.0 * near[(1, 1)] && far[(0, 0)] < 1e-3, "{far} {near}");
        assert!((above[(0, 0)] - far[(1, 1)]).abs() < 1e-9 && (above[(1, 1)] - far[(0, 0)]).abs() < 1e-9);
    }

    #[test]
    fn robust_an_error_below_the_noise_is_not_zero() {
        let noisy = residuals().into_iter().map(|residual| Residual { noise_n2_m2: 100.0, ..residual });
        let map = SpatialErrorMap::new(&domain(), &noisy.collect::<Vec<_>>(), 0.25);
        let covariance = covariance(&map, Around::new(0.05, 1e-3, 1e-3));
        assert!((covariance - Matrix2::identity() * 0.25).norm() < 1e-9, "{covariance}");
    }

    #[test]
    fn verif_the_map_holds_the_error_beyond_the_predicted_one() {
        // To the left of the whisker, the first axis is the moment about z.
        let (contact, at) = (Point::new(0.045, 2e-3, 0.0), Around::new(0.045, 2e-3, 0.0));
        let variance = |predicted: f64| {
            let (error_n_m, sd_n_m) = (Vector2::new(0.0, 1.0), Vector2::new(0.0, predicted));
            let residual = Residual { contact, at, error_n_m, sd_n_m, noise_n2_m2: 0.0 };
            covariance(&SpatialErrorMap::new(&domain(), &[residual], 1e-6), at)[(1, 1)]
        };
        for (predicted, expected) in [(0.0, 1.0), (0.6, 0.64), (1.2, 1e-6)] {
            assert!((variance(predicted) - expected).abs() < 1e-12, "{predicted}");
        }
    }

    #[test]
    fn verif_an_error_is_new_after_twice_the_correlation_length() {
        let map = SpatialErrorMap::new(&domain(), &residuals(), 1e-6);
        assert_eq!(map.new_share(0.0), 1.0);
        let map = map.with_correlation(4e-3);
        assert!(map.is_valid());
        for (path_m, share) in [(0.0, LEAST_SHARE), (2e-3, 0.25), (8e-3, 1.0), (20e-3, 1.0)] {
            assert!((map.new_share(path_m) - share).abs() < 1e-12, "{path_m}");
        }
        assert!(!map.with_correlation(0.0).is_valid());
    }
}
