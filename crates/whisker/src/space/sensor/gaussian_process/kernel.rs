//! Covariance functions of the Gaussian process, and their parameters.

use nalgebra::{Vector2, Vector3};
use serde::{Deserialize, Serialize};

/// A contact and the reading there.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sample {
    /// Contact, in a frame fixed to the sensor (m), 3x1.
    pub contact_m: Vector3<f64>,
    /// Both channels relative to rest, 2x1, in any unit: a process depends only on the ratios of its readings.
    pub reading: Vector2<f64>,
    /// Index of the line on which the contact moved.
    pub line: usize,
}

/// A contact with its load.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Place {
    /// Contact, in a frame fixed to the sensor (m), 3x1.
    pub contact_m: Vector3<f64>,
    /// Norm of the reading over the largest of the calibration.
    pub load: f64,
}

impl Place {
    /// The place of a reading, given the largest one of the calibration.
    pub(super) fn of(contact_m: Vector3<f64>, reading: &Vector2<f64>, largest_reading: f64) -> Self {
        Self { contact_m, load: reading.norm() / largest_reading }
    }
}

/// Parameters of the covariance of one channel, with `R` the largest reading of the calibration and `y` a reading's norm over `R`,
/// the load.
///
/// The reading at a contact `p` on line `i` is `m(p) + f(p) + w(y) e_i(p) + noise`: a quadratic trend `m`; the smooth map `f`; an
/// error `e_i` of each line, which represents friction, stick-slip and hysteresis, with a standard deviation `w` that grows with
/// the load; and white noise.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Kernel {
    /// Correlation length of the map along each axis (m).
    pub length_m: [f64; 3],
    /// Standard deviation of the map, over `R`.
    pub map_sd: f64,
    /// Standard deviation of a line's error without load, and its growth with the load, over `R`.
    pub line: [f64; 2],
    /// Correlation length of a line's error (m).
    pub line_length_m: f64,
    /// Standard deviation of the noise without load, and its growth with the load, over `R`.
    pub noise: [f64; 2],
}

impl Kernel {
    /// The covariance from which the selection starts.
    pub const START: Self = Self {
        length_m: [10e-3, 10e-3, 8e-3],
        map_sd: 0.6,
        line: [0.002, 0.012],
        line_length_m: 5e-3,
        noise: [0.0012, 0.002],
    };

    /// Whether the numbers are finite, and the lengths positive.
    pub(super) fn is_valid(&self) -> bool {
        let Self { length_m, map_sd, line, line_length_m, noise } = *self;
        let mut lengths = length_m.into_iter().chain([line_length_m]);
        let mut sds = [map_sd].into_iter().chain(line).chain(noise);
        lengths.all(|length_m| length_m.is_finite() && length_m > 0.0) && sds.all(f64::is_finite)
    }

    /// Correlation of a line's error between two contacts `distance_m` apart: Matérn covariance function of order 5/2.
    pub(super) fn along(&self, distance_m: f64) -> f64 {
        let r = 5.0_f64.sqrt() * distance_m / self.line_length_m;
        (1.0 + r + r * r / 3.0) * (-r).exp()
    }

    /// Covariance of the map between two contacts, over `R^2`.
    pub(super) fn map(&self, a: &Vector3<f64>, b: &Vector3<f64>) -> f64 {
        let square: f64 = (0..3).map(|axis| ((a[axis] - b[axis]) / self.length_m[axis]).powi(2)).sum();
        self.map_sd.powi(2) * (-0.5 * square).exp()
    }

    /// Standard deviation of a line's error at a load, over `R`.
    pub fn line_sd(&self, load: f64) -> f64 {
        self.line[0].hypot(self.line[1] * load)
    }

    /// Variance of the noise at a load, over `R^2`.
    pub fn noise_variance(&self, load: f64) -> f64 {
        self.noise[0].powi(2) + (self.noise[1] * load).powi(2)
    }
}
