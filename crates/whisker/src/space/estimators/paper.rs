//! The unscented Kalman filter of Lin et al. ("Navigation and 3D surface reconstruction from passive whisker sensing", arXiv
//! 2406.06038, 2024): the contact as state, at rest in the world; both bending moments as readings; a single initial hypothesis,
//! constant noise, and a fading memory. Errors of the sensor model are part of the constant noise, and no reading is gated.

use filters::unscented::{self, Spread};
use filters::{Gaussian, Measurement, Process};
use nalgebra::{Matrix2, Matrix3, Vector2, Vector3};
use serde::{Deserialize, Serialize};

use super::follower::Tracker;
use super::motion::{Motion, Resting};
use super::side::Side;
use super::{Estimate, Knowledge, Sample, start};
use crate::settings::{Settings, SettingsError, within};
use crate::space::sensor::Around;

const SPREAD: Spread = Spread { alpha: 1.0, beta: 2.0, kappa: 0.0 };

/// Settings.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub(super) struct Config {
    /// Standard deviation of the initial contact along each axis; its mean is in the middle of the calibrated part of the whisker.
    pub(super) start_sd_m: f64,
    /// Standard deviation of the process noise per sample, along each axis.
    pub(super) step_sd_m: f64,
    /// Standard deviation of each reading, relative to the largest reading of the calibration.
    pub(super) reading_sd: f64,
    /// Fading memory: factor by which the covariance is multiplied at each sample.
    pub(super) fading: f64,
}

impl Default for Config {
    /// Noise and fading as published. The published start is a given place; here it is that which explains the first readings.
    fn default() -> Self {
        Self { start_sd_m: 5e-3, step_sd_m: 0.05e-3, reading_sd: 0.01, fading: 1.004 }
    }
}

impl Settings for Config {
    fn validate(&self) -> Result<(), SettingsError> {
        within("start_sd_m", self.start_sd_m, 1e-6..=1.0)?;
        within("step_sd_m", self.step_sd_m, 1e-9..=1.0)?;
        within("reading_sd", self.reading_sd, 1e-6..=10.0)?;
        within("fading", self.fading, 1.0..=2.0)
    }
}

/// Follows one contact.
pub(super) struct PaperUkf {
    config: Config,
    side: Side,
    /// `None` before the first step.
    belief: Option<Gaussian<3>>,
}

impl PaperUkf {
    pub(super) fn new(config: &Config, knowledge: &Knowledge) -> Self {
        Self { config: *config, side: Side::new(knowledge), belief: None }
    }

    /// The belief at the touch. `None` if no contact explains the readings.
    fn begin(&self, touch: &Sample) -> Option<Gaussian<3>> {
        let (place, _) = *start::beliefs(&self.side, 1, None, touch.reading_n_m).first()?;
        Some(Gaussian::new(place.mean, Matrix3::identity() * self.config.start_sd_m.powi(2)))
    }
}

impl Tracker for PaperUkf {
    fn step(&mut self, sample: &Sample) -> Option<Estimate> {
        let Some(mut belief) = self.belief.take() else {
            let belief = self.begin(sample)?;
            self.belief = Some(belief);
            return self.side.estimate(&belief, None);
        };
        belief.covariance *= self.config.fading;
        let rest = Resting::default().step(&self.side, sample, &Matrix3::zeros());
        let process = Wandering { rest, variance_m2: self.config.step_sd_m.powi(2) };
        let sd_n_m = self.config.reading_sd * self.side.calibrated.largest_reading_n_m;
        let reading = Reading { side: &self.side, variance_n2_m2: sd_n_m.powi(2) };
        // After a failure, the next sample begins anew.
        unscented::predict(&mut belief, &process, &SPREAD).ok()?;
        // An update that fails leaves the belief as predicted.
        let innovation = unscented::update(&mut belief, &reading, &SPREAD, &sample.reading_n_m).ok();
        self.side.hold(&mut belief.mean);
        self.belief = Some(belief);
        self.side.estimate(&belief, innovation)
    }

    fn release(&mut self, _: &Sample) {
        self.forget();
    }

    fn forget(&mut self) {
        self.belief = None;
    }
}

/// A contact at rest in the world with a random walk of constant variance per sample.
struct Wandering<Rest> {
    rest: Rest,
    variance_m2: f64,
}

impl<Rest: Process<3>> Process<3> for Wandering<Rest> {
    fn predict(&self, x: &Vector3<f64>) -> Vector3<f64> {
        self.rest.predict(x)
    }

    fn noise(&self, _: &Vector3<f64>) -> Matrix3<f64> {
        Matrix3::identity() * self.variance_m2
    }
}

/// Both moments with a constant noise.
struct Reading<'a> {
    side: &'a Side,
    variance_n2_m2: f64,
}

impl Measurement<3, 2> for Reading<'_> {
    fn predict(&self, x: &Vector3<f64>) -> Option<Vector2<f64>> {
        Some(self.side.expect(Around::of_state(x)).reading_n_m)
    }

    fn noise(&self, _: &Vector3<f64>) -> Matrix2<f64> {
        Matrix2::identity() * self.variance_n2_m2
    }
}
