//! The particle filter on the contact.

use std::sync::Arc;

use filters::particle::Renewal;
use filters::{ConstantNoise, ParticleSet};
use nalgebra::{SVector, Vector1};
use rand::SeedableRng;
use rand_pcg::Pcg64;
use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::motion::{AnyMotion, Motion, MotionSettings, Round};
use super::side::{ContactReading, Side};
use super::start::{Earlier, EarlierReading, Start, earlier};
use super::{ContactPrior, Estimate, Knowledge, Method, Sample, Touch, Tracker};
use crate::settings::{Settings, SettingsError, parse, within};

/// Settings.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub(super) struct Config {
    /// Initial hypotheses, from which equal numbers of particles are drawn: one Gaussian, or several along the whisker.
    pub start: Start,
    /// Model of the contact's motion.
    pub motion: MotionSettings,
    /// Fading memory: factor of the set's covariance at each step.
    pub fading: f64,
    /// Gate, in standard deviations: the noise of a reading with a larger innovation is inflated until the innovation
    /// lies at the gate.
    pub gate_sds: f64,
    /// Number of particles.
    pub particles: usize,
    /// Share of the particles; a new set is drawn if the effective sample size falls below it.
    pub renew_share: f64,
    /// Kernel of the new set, in standard deviations of the old one.
    pub kernel: f64,
}

impl Default for Config {
    fn default() -> Self {
        Self {
            start: Start::Hypotheses { count: 100 },
            motion: MotionSettings::Round(Round::default()),
            fading: 1.0,
            gate_sds: 5.0,
            particles: 180,
            renew_share: 0.5,
            kernel: 0.6,
        }
    }
}

impl Settings for Config {
    fn validate(&self) -> Result<(), SettingsError> {
        self.start.validate()?;
        self.motion.validate()?;
        within("fading", self.fading, 1.0..=2.0)?;
        within("gate_sds", self.gate_sds, 1.0..=1e6)?;
        within("particles", self.particles as f64, 1.0..=1e7)?;
        within("renew_share", self.renew_share, 0.0..=1.0)?;
        within("kernel", self.kernel, 0.0..=1.0)
    }
}

impl Config {
    fn renewal(&self) -> Renewal {
        Renewal { share: self.renew_share, bandwidth: self.kernel, gate_sds: self.gate_sds }
    }
}

struct ParticleFilter {
    config: Config,
    knowledge: Arc<Knowledge>,
}

pub(super) fn build(config: &Value, knowledge: &Arc<Knowledge>) -> Result<Box<dyn Method>, SettingsError> {
    Ok(Box::new(ParticleFilter { config: parse(config)?, knowledge: knowledge.clone() }))
}

impl Method for ParticleFilter {
    fn begin(&self, touch: &Touch<'_>) -> Box<dyn Tracker> {
        self.config.motion.begin(self, touch)
    }

    fn is_of_fixed_size(&self) -> bool {
        true
    }
}

impl AnyMotion for ParticleFilter {
    fn begin_with<Model: Motion<N>, const N: usize>(&self, motion: Model, touch: &Touch<'_>) -> Box<dyn Tracker> {
        Box::new(Follower::new(self.config, motion, touch, &self.knowledge))
    }
}

struct Follower<Model, const N: usize> {
    config: Config,
    motion: Model,
    side: Side,
    noise_sd_n_m: f64,
    contact_prior: Option<ContactPrior>,
    /// Samples before the touch, until the first step.
    history: Vec<Sample>,
    rng: Pcg64,
    /// `None` before the first step.
    set: Option<ParticleSet<N>>,
}

impl<Model: Motion<N>, const N: usize> Follower<Model, N> {
    fn new(config: Config, motion: Model, touch: &Touch<'_>, knowledge: &Knowledge) -> Self {
        Self {
            config,
            motion,
            side: Side::new(touch.face, knowledge),
            noise_sd_n_m: knowledge.noise_sd_n_m,
            contact_prior: touch.contact_prior,
            history: touch.history.to_vec(),
            rng: Pcg64::seed_from_u64(touch.seed),
            set: None,
        }
    }

    /// The particles at the touch: drawn from the initial hypotheses and weighted by the readings before the touch.
    fn begin(&mut self, touch: &Sample) -> ParticleSet<N> {
        let beliefs = self.config.start.beliefs(&self.side, touch.reading_n_m, self.contact_prior);
        let parts: Vec<_> =
            beliefs.iter().map(|(place, log_weight)| (self.motion.belief(place), log_weight.exp())).collect();
        let drawn = ParticleSet::drawn(&parts, self.config.particles, &mut self.rng);
        let mut set = drawn.expect("the initial hypotheses have positive weights");
        set.map(|x| self.held(*x));
        let renewal = self.config.renewal();
        for Earlier { sample, .. } in earlier(&self.history, touch, self.noise_sd_n_m, 0.0) {
            let back = self.motion.step(&self.side, &sample);
            let reading = EarlierReading { back, reading: ContactReading::new(&self.side, Model::INDICES) };
            // A reading without a valid update leaves the particles as they are.
            let _ = set.update_or_renew(&reading, &Vector1::new(sample.reading_n_m), &renewal, &mut self.rng);
        }
        set
    }

    fn held(&self, mut x: SVector<f64, N>) -> SVector<f64, N> {
        self.side.hold(&mut x);
        x
    }
}

impl<Model: Motion<N>, const N: usize> Tracker for Follower<Model, N> {
    fn step(&mut self, sample: &Sample) -> Option<Estimate> {
        let Some(mut set) = self.set.take() else {
            let set = self.begin(sample);
            let estimate = self.side.estimate(self.motion.radius(), &set.moments(), None);
            self.set = Some(set);
            return Some(estimate);
        };
        set.predict(&self.motion.step(&self.side, sample), &mut self.rng);
        set.fade(self.config.fading);
        set.map(|x| self.held(*x));
        // The sensor model's error is part of the noise, but it is systematic: it recurs at the same position. If each
        // particle were weighted with its own noise, a series of small residuals would count as evidence for positions
        // where the sensor model is accurate.
        let reading = ConstantNoise::new(ContactReading::new(&self.side, Model::INDICES), &set.mean());
        let z = Vector1::new(sample.reading_n_m);
        let innovation = set.update_or_renew(&reading, &z, &self.config.renewal(), &mut self.rng).ok();
        let estimate = self.side.estimate(self.motion.radius(), &set.moments(), innovation);
        self.set = Some(set);
        Some(estimate)
    }
}
