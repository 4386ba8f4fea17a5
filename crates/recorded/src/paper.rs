//! `paper-ukf-3d`: the unscented Kalman filter of Lin et al. ("Navigation and 3D surface reconstruction from passive whisker
//! sensing", arXiv 2406.06038, 2024): the contact as state, both bending channels as readings, a Gaussian process without
//! friction as sensor model, and a fading memory.

use filters::unscented::{self, Spread};
use filters::{Gaussian, Measurement, Process};
use nalgebra::{Matrix2, Matrix3, Vector2, Vector3};
use whisker::space::sensor::gaussian_process::{Kernel, Predictor};

use crate::fixed::{Estimate, Reading};

/// Standard deviation of the start along each axis (m).
const START_SD_M: f64 = 5e-3;

/// Standard deviation of the process noise of a row along each axis (m).
const STEP_SD_M: f64 = 0.05e-3;

/// Standard deviation of the readings, over the largest of the calibration.
const READING_SD: f64 = 0.01;

/// Factor on the prior covariance in each step.
const FADING: f64 = 1.004;

const SPREAD: Spread = Spread { alpha: 1.0, beta: 2.0, kappa: 0.0 };

/// The covariance of its sensor model: a map and white noise, one length for all axes.
pub fn kernel() -> Kernel {
    Kernel { length_m: [10e-3; 3], line: [1e-9, 0.0], noise: [READING_SD, 0.0], ..Kernel::START }
}

/// The filter. Its state is the contact in the frame of the sensor (mm), for numbers of the order of one.
pub struct PaperUkf<'a> {
    predictor: &'a Predictor<'a>,
    before: Reading,
    belief: Gaussian<3>,
}

const MM: f64 = 1e3;

impl<'a> PaperUkf<'a> {
    /// The filter with a start in World.
    pub fn new(predictor: &'a Predictor<'a>, before: Reading, start_m: Vector3<f64>) -> Self {
        let mean = before.to_sensor(&start_m) * MM;
        Self { predictor, before, belief: Gaussian::new(mean, Matrix3::identity() * (START_SD_M * MM).powi(2)) }
    }

    /// Takes the next reading. `None` if the covariance is no longer positive definite.
    pub fn step(&mut self, reading: Reading) -> Option<Estimate> {
        let process = Moved { before: self.before, now: reading };
        self.before = reading;
        self.belief.covariance *= FADING;
        unscented::predict(&mut self.belief, &process, &SPREAD).ok()?;
        let sensor = Sensor { predictor: self.predictor };
        unscented::update(&mut self.belief, &sensor, &SPREAD, &reading.counts).ok()?;
        let contact_m = self.belief.mean / MM;
        let turned =
            reading.rotation.matrix() * self.belief.covariance * reading.rotation.matrix().transpose() / MM.powi(2);
        Some(Estimate {
            contact_m: reading.rotation * contact_m + reading.origin_m,
            covariance_m2: turned,
            is_calibrated: true,
        })
    }
}

struct Moved {
    before: Reading,
    now: Reading,
}

impl Process<3> for Moved {
    fn predict(&self, x: &Vector3<f64>) -> Vector3<f64> {
        let place_m = self.before.rotation * (x / MM) + self.before.origin_m;
        self.now.to_sensor(&place_m) * MM
    }

    fn noise(&self, _: &Vector3<f64>) -> Matrix3<f64> {
        Matrix3::identity() * (STEP_SD_M * MM).powi(2)
    }
}

struct Sensor<'a> {
    predictor: &'a Predictor<'a>,
}

impl Measurement<3, 2> for Sensor<'_> {
    fn predict(&self, x: &Vector3<f64>) -> Option<Vector2<f64>> {
        Some(self.predictor.predict(&(x / MM)).0)
    }

    fn noise(&self, _: &Vector3<f64>) -> Matrix2<f64> {
        Matrix2::identity() * (READING_SD * self.predictor.process.largest_reading).powi(2)
    }
}
