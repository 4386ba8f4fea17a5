//! The particle filter on the contact's place.

use std::sync::Arc;

use filters::Cloud;
use nalgebra::{Vector1, Vector2, vector};
use rand::{RngExt, SeedableRng};
use rand_distr::StandardNormal;
use rand_pcg::Pcg64;
use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::model::{ContactReading, StaticContact, hold};
use super::settings::{ContactSettings, Settings, SettingsError, parse, within};
use super::{Estimate, Knowledge, Method, Sample, Tracker};
use crate::sensor::CalibratedFace;

/// Settings.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub(super) struct Config {
    /// Fading memory: the cloud's covariance is scaled by it at each step.
    pub fading: f64,
    /// How far the contact may wander in the world, as the standard deviation after one second, in m.
    pub wander_m_sqrt_s: f64,
    /// Standard deviation of the contact's distance from the undeflected whisker at the touch.
    pub start_away_sd_m: f64,
    /// Number of particles.
    pub particles: usize,
    /// Resample where the effective sample size falls below this share of the particles.
    pub resample_share: f64,
    /// Kernel of the resampling, in standard deviations of the cloud.
    pub kernel: f64,
}

impl Default for Config {
    fn default() -> Self {
        Self {
            fading: 1.004,
            wander_m_sqrt_s: 1e-4,
            start_away_sd_m: 1e-3,
            particles: 1000,
            resample_share: 0.5,
            kernel: 0.1,
        }
    }
}

struct ParticleFilter {
    config: Config,
    knowledge: Arc<Knowledge>,
}

impl Settings for Config {
    fn validate(&self) -> Result<(), SettingsError> {
        let Self { fading, wander_m_sqrt_s, start_away_sd_m, .. } = *self;
        ContactSettings { fading, wander_m_sqrt_s, start_away_sd_m }.validate()?;
        within("particles", self.particles as f64, 1.0..=1e7)?;
        within("resample_share", self.resample_share, 0.0..=1.0)?;
        within("kernel", self.kernel, 0.0..=1.0)
    }
}

pub(super) fn build(config: &Value, knowledge: &Arc<Knowledge>) -> Result<Box<dyn Method>, SettingsError> {
    Ok(Box::new(ParticleFilter { config: parse(config)?, knowledge: knowledge.clone() }))
}

impl Method for ParticleFilter {
    fn begin(&self, face: &Arc<CalibratedFace>, seed: u64) -> Box<dyn Tracker> {
        let mut rng = Pcg64::seed_from_u64(seed);
        let particles = spread(face, &self.config, &mut rng);
        Box::new(Filter {
            config: self.config,
            noise_sd_n_m: self.knowledge.noise_sd_n_m,
            face: face.clone(),
            cloud: Cloud::new(particles),
            rng,
        })
    }
}

struct Filter {
    config: Config,
    noise_sd_n_m: f64,
    face: Arc<CalibratedFace>,
    cloud: Cloud<2>,
    rng: Pcg64,
}

/// Contacts spread evenly along the undeflected whisker's calibrated part, at distances away from it as a normal deviate has
/// from zero.
fn spread(face: &CalibratedFace, config: &Config, rng: &mut Pcg64) -> Vec<Vector2<f64>> {
    let (low, high) = face.domain.arc_range_m();
    (0..config.particles)
        .map(|i| {
            let arc_m = low + (high - low) * (i as f64 + rng.random::<f64>()) / config.particles as f64;
            let away_m = rng.sample::<f64, _>(StandardNormal).abs() * config.start_away_sd_m;
            vector![arc_m, away_m]
        })
        .collect()
}

impl Tracker for Filter {
    fn step(&mut self, sample: &Sample) -> Option<Estimate> {
        let face = &self.face;
        self.cloud.predict(&StaticContact::new(face, sample, self.config.wander_m_sqrt_s), &mut self.rng);
        self.cloud.fade(self.config.fading);
        self.cloud.map(|x| {
            let (arc_m, away_m) = face.domain.clamp(x[0], x[1]);
            vector![arc_m, away_m]
        });
        let reading = ContactReading::new(face, self.noise_sd_n_m);
        let innovation = self.cloud.update(&reading, &Vector1::new(sample.reading_n_m)).ok();
        let mut belief = self.cloud.moments();
        let share = self.cloud.effective_size() / self.cloud.particles().len() as f64;
        if share < self.config.resample_share {
            self.cloud.resample(self.config.kernel, &mut self.rng);
        }
        Some(hold(&mut belief, face, innovation))
    }
}
