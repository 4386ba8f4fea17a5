//! The unscented Kalman filter on the contact's place.

use std::sync::Arc;

use filters::unscented::Spread;
use filters::{Gaussian, unscented};
use nalgebra::Vector1;
use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::model::{ContactReading, StaticContact, hold, start};
use super::{Estimate, Knowledge, Method, Sample, Tracker};
use crate::sensor::CalibratedFace;

/// Settings.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub(super) struct Config {
    /// Fading memory: the prior covariance is scaled by it at each step.
    pub fading: f64,
    /// How far the contact may wander in the world, as the standard deviation after one second, in m.
    pub wander_m_sqrt_s: f64,
    /// Standard deviation of the contact's distance from the undeflected whisker at the touch.
    pub start_away_sd_m: f64,
    /// Scale of the sigma points' spread; see [`Spread`].
    pub alpha: f64,
    /// Prior knowledge of the distribution, 2 for a Gaussian.
    pub beta: f64,
    /// Secondary scale; state size + kappa is the kurtosis that is matched.
    pub kappa: f64,
}

impl Default for Config {
    fn default() -> Self {
        Self { fading: 1.004, wander_m_sqrt_s: 1e-4, start_away_sd_m: 1e-3, alpha: 1.0, beta: 2.0, kappa: 1.0 }
    }
}

struct Ukf {
    config: Config,
    knowledge: Arc<Knowledge>,
}

pub(super) fn build(config: &Value, knowledge: &Arc<Knowledge>) -> Result<Box<dyn Method>, serde_json::Error> {
    Ok(Box::new(Ukf { config: Config::deserialize(config)?, knowledge: knowledge.clone() }))
}

impl Method for Ukf {
    fn begin(&self, face: &Arc<CalibratedFace>, _seed: u64) -> Box<dyn Tracker> {
        Box::new(Filter {
            config: self.config,
            noise_sd_n_m: self.knowledge.noise_sd_n_m,
            belief: start(face, self.config.start_away_sd_m),
            face: face.clone(),
        })
    }
}

struct Filter {
    config: Config,
    noise_sd_n_m: f64,
    face: Arc<CalibratedFace>,
    belief: Gaussian<2>,
}

impl Tracker for Filter {
    fn step(&mut self, sample: &Sample) -> Option<Estimate> {
        let belief = &mut self.belief;
        let Config { alpha, beta, kappa, .. } = self.config;
        let spread = Spread { alpha, beta, kappa };
        let process = StaticContact::new(&self.face, sample, self.config.wander_m_sqrt_s);
        // Neither step is skipped while the covariance is positive definite, which wander and fading maintain.
        unscented::predict(belief, &process, &spread).ok()?;
        belief.fade(self.config.fading);
        let reading = ContactReading::new(&self.face, self.noise_sd_n_m);
        let innovation = unscented::update(belief, &reading, &spread, &Vector1::new(sample.reading_n_m)).ok();
        Some(hold(belief, &self.face, innovation))
    }
}
