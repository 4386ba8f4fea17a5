//! Properties of a recording of a real sensor in space: two channels, and their conversion to bending moments.

use std::f64::consts::FRAC_1_SQRT_2;
use std::path::Path;

use files::Error;
use nalgebra::{Matrix2, Vector2};
use serde::{Deserialize, Serialize};

use crate::{LARGEST, ObjectClass};

/// Smallest ratio of the singular values of the response with which both moments are determined.
const LEAST_DETERMINED: f64 = 1e-3;

/// Linear response of a sensor with two channels to the bending moments at the root, `counts - rest = C M`, with `M` about y and z
/// of Base.
///
/// A sensor that is turned about the whisker reads a mixture of both moments, which `C` separates. Its nonlinearity is left to the
/// sensor model, which is fitted to the converted moments: a linear map of the readings loses no information.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(transparent)]
pub struct BendingResponse {
    /// Rows of `C`, one for each channel (counts per N m).
    pub counts_per_n_m: [[f64; 2]; 2],
}

impl BendingResponse {
    /// The response with this matrix (counts per N m), 2x2. `None` if the counts do not determine both moments.
    pub fn new(response: Matrix2<f64>) -> Option<Self> {
        let own = Self { counts_per_n_m: response.transpose().into() };
        own.is_valid().then_some(own)
    }

    /// Least-squares fit to pairs of bending moments about y and z (N m) and counts above rest, both 2x1. `None` if they do not
    /// determine it, or if the counts do not determine both moments.
    pub fn fit(pairs: &[(Vector2<f64>, Vector2<f64>)]) -> Option<Self> {
        let scale_n_m = pairs.iter().map(|(moment_n_m, _)| moment_n_m.norm()).fold(0.0, f64::max);
        let (mut normal, mut right) = (Matrix2::<f64>::zeros(), Matrix2::<f64>::zeros());
        for (moment_n_m, counts) in pairs {
            let moment = moment_n_m / scale_n_m;
            normal += moment * moment.transpose();
            right += moment * counts.transpose();
        }
        Self::new((normal.try_inverse()? * right).transpose() / scale_n_m)
    }

    /// The matrix `C` (counts per N m), 2x2.
    pub fn response(&self) -> Matrix2<f64> {
        Matrix2::from(self.counts_per_n_m).transpose()
    }

    /// Bending moments about y and z (N m), 2x1, of counts above rest. Zero if the response is singular; a file with such a
    /// response is refused.
    pub fn moment_n_m(&self, counts: Vector2<f64>) -> Vector2<f64> {
        self.response().try_inverse().unwrap_or_default() * counts
    }

    /// Counts above rest of bending moments about y and z (N m).
    pub fn counts(&self, moment_n_m: Vector2<f64>) -> Vector2<f64> {
        self.response() * moment_n_m
    }

    /// Root mean square of the residuals of both channels (counts), 2x1, over pairs as in [`Self::fit`]. Zero without pairs.
    pub fn residual_counts(&self, pairs: &[(Vector2<f64>, Vector2<f64>)]) -> Vector2<f64> {
        let square = |(moment_n_m, counts): &(Vector2<f64>, Vector2<f64>)| {
            (self.counts(*moment_n_m) - counts).map(|residual| residual * residual)
        };
        (pairs.iter().map(square).sum::<Vector2<f64>>() / pairs.len().max(1) as f64).map(f64::sqrt)
    }

    /// Standard deviations of the moments about y and z (N m), 2x1, by the independent noise of both channels (counts), 2x1.
    pub fn noise_sd_n_m(&self, noise_sd_counts: Vector2<f64>) -> Vector2<f64> {
        let variances = |channel: usize| {
            let moment_n_m = self.moment_n_m(Vector2::ith(channel, noise_sd_counts[channel]));
            moment_n_m.component_mul(&moment_n_m)
        };
        (variances(0) + variances(1)).map(f64::sqrt)
    }

    /// Checks the response that is part of `key`.
    ///
    /// # Errors
    /// [`Error::Value`] if it cannot be inverted.
    pub fn validate(&self, path: &Path, key: &str) -> Result<(), Error> {
        if self.is_valid() {
            return Ok(());
        }
        let found = format!("{:?}", self.counts_per_n_m);
        let expected = "two rows of two numbers, a matrix that can be inverted";
        Err(Error::value(path, format!("{key}.counts_per_n_m"), found, expected))
    }

    fn is_valid(&self) -> bool {
        let response = self.response();
        if !response.iter().all(|entry| entry.is_finite()) {
            return false;
        }
        let sizes = response.singular_values();
        let is_invertible = response.try_inverse().is_some_and(|inverse| inverse.iter().all(|entry| entry.is_finite()));
        is_invertible && sizes.min() > LEAST_DETERMINED * sizes.max()
    }
}

/// Sensor with two channels in a calibration of recordings, which converts its counts to bending moments.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BendingSensor {
    /// Response of the sensor.
    pub counts_per_n_m: BendingResponse,
    /// Root mean square of the standard deviations of the noise in both moments (N m).
    pub noise_sd_n_m: f64,
}

impl BendingSensor {
    pub(super) fn validate(&self, path: &Path, key: &str) -> Result<(), Error> {
        self.counts_per_n_m.validate(path, key)?;
        if !(0.0..=LARGEST).contains(&self.noise_sd_n_m) {
            let key = format!("{key}.noise_sd_n_m");
            return Err(Error::value(path, key, self.noise_sd_n_m, format!("a number from 0 to {LARGEST}")));
        }
        Ok(())
    }
}

/// Properties of a recording of a real sensor with two channels, as [`crate::Recorded`] for one channel.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SpatialRecorded {
    /// Source of the times.
    pub clock: String,
    /// Response of the sensor, whose inverse converted the counts to the moments of the trace.
    pub counts_per_n_m: BendingResponse,
    /// RMS residual of each channel over the calibration's readings with this response and whisker.
    pub residual_counts: [f64; 2],
    /// Reading of each channel at rest.
    pub rest_counts: [f64; 2],
    /// Standard deviations at rest of the noise that the moments about y and z contain.
    pub noise_sd_n_m: [f64; 2],
    /// Contact threshold: smallest distance of the counts from those at rest, over both channels, that counts as contact.
    pub touch_counts: f64,
    /// Class of the object.
    pub object_class: ObjectClass,
}

impl SpatialRecorded {
    /// Root mean square of the standard deviations of the noise about y and z (N m).
    pub fn mean_noise_sd_n_m(&self) -> f64 {
        let [y_n_m, z_n_m] = self.noise_sd_n_m;
        y_n_m.hypot(z_n_m) * FRAC_1_SQRT_2
    }

    pub(super) fn validate(&self, path: &Path) -> Result<(), Error> {
        let key = |name: &str| format!("recorded.{name}");
        self.counts_per_n_m.validate(path, "recorded")?;
        let [residual_counts, noise_sd_n_m] = [self.residual_counts, self.noise_sd_n_m];
        let not_negative = [
            ("residual_counts", residual_counts[0]),
            ("residual_counts", residual_counts[1]),
            ("noise_sd_n_m", noise_sd_n_m[0]),
            ("noise_sd_n_m", noise_sd_n_m[1]),
            ("touch_counts", self.touch_counts),
        ];
        for (name, found) in not_negative {
            if !(found.is_finite() && found >= 0.0) {
                return Err(Error::value(path, key(name), found, "a number of 0 or more"));
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn verif_the_fit_recovers_a_turned_sensor() {
        let response = Matrix2::new(3e7, 1e7, -8e6, 2.5e7);
        let moments = (0..12).map(|i| Vector2::new(1e-5 * f64::from(i % 4 - 2), 1e-5 * f64::from(i / 4)));
        let pairs: Vec<_> = moments.map(|moment_n_m| (moment_n_m, response * moment_n_m)).collect();
        let found = BendingResponse::fit(&pairs).unwrap();
        assert!((found.response() - response).norm() < 1e-6 * response.norm(), "{found:?}");
        for (moment_n_m, counts) in pairs {
            assert!((found.moment_n_m(counts) - moment_n_m).norm() < 1e-15);
            assert!((found.counts(moment_n_m) - counts).norm() < 1e-6);
        }
    }

    #[test]
    fn robust_moments_in_one_direction_determine_no_response() {
        let pairs: Vec<_> = (1..9).map(|i| (Vector2::new(0.0, 1e-5 * f64::from(i)), Vector2::new(1.0, 2.0))).collect();
        assert_eq!(BendingResponse::fit(&pairs), None);
        assert_eq!(BendingResponse::fit(&[]), None);
        assert_eq!(BendingResponse::new(Matrix2::new(1e7, 2e7, 2e7, 4e7)), None);
    }
}
