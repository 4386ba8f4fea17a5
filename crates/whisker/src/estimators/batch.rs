//! Batch estimator: the most probable trajectory, given all readings of a contact.

use std::sync::Arc;

use filters::Gaussian;
use filters::batch::{Instant, solve};
use filters::iterated::Search;
use filters::robust::InflatedNoise;
use nalgebra::{Matrix2, SVector, Vector1, vector};
use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::gaussian::Follower;
use super::motion::{AnyMotion, Motion};
use super::side::Side;
use super::smoother::{self, Recorder};
use super::{Estimate, Knowledge, Method, Sample, Touch, Tracker};
use crate::frames::Pose;
use crate::settings::{Settings, SettingsError, parse, within};

/// Settings.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub(super) struct Config {
    /// Maximum number of steps of the search.
    pub iterations: usize,
    /// Step, in standard deviations of the result, below which the search ends.
    pub tolerance_sds: f64,
    /// Settings of the filter and smoother that give the initial guess, and the model of the contact's motion.
    pub guess: smoother::Config,
}

impl Default for Config {
    fn default() -> Self {
        Self { iterations: 20, tolerance_sds: 1e-3, guess: smoother::Config::default() }
    }
}

impl Config {
    /// Settings for contacts that slide around objects of any size.
    pub(super) fn sliding() -> Self {
        Self { guess: smoother::Config::sliding(), ..Self::default() }
    }
}

impl Settings for Config {
    fn validate(&self) -> Result<(), SettingsError> {
        within("iterations", self.iterations as f64, 1.0..=1000.0)?;
        within("tolerance_sds", self.tolerance_sds, 0.0..=1.0)?;
        self.guess.validate()
    }
}

struct Batch {
    config: Config,
    knowledge: Arc<Knowledge>,
}

pub(super) fn build(config: &Value, knowledge: &Arc<Knowledge>) -> Result<Box<dyn Method>, SettingsError> {
    let config: Config = parse(config)?;
    smoother::check_used(&config.guess)?;
    Ok(Box::new(Batch { config, knowledge: knowledge.clone() }))
}

impl Method for Batch {
    fn begin(&self, touch: &Touch<'_>) -> Box<dyn Tracker> {
        self.config.guess.motion.begin(self, touch)
    }
}

impl AnyMotion for Batch {
    fn begin_with<Model: Motion<N>, const N: usize>(&self, motion: Model, touch: &Touch<'_>) -> Box<dyn Tracker> {
        let Config { iterations, tolerance_sds, guess } = self.config;
        let search = Search { iterations, tolerance_sds };
        let follower = Follower::new(guess, motion, touch, &self.knowledge);
        Box::new(Collector { search, recorder: Recorder::new(follower), samples: Vec::new() })
    }
}

/// A recorder that keeps the samples too.
struct Collector<Model, const N: usize> {
    search: Search,
    recorder: Recorder<Model, N>,
    /// Samples for which the recorder has a step, each with the factor that inflates the noise of its reading.
    samples: Vec<(Sample, f64)>,
}

impl<Model: Motion<N>, const N: usize> Collector<Model, N> {
    /// The most probable trajectory, from the smoothed one as initial guess. `None` if no prediction is possible along
    /// it.
    fn solved(&self, smoothed: &[Gaussian<N>]) -> Option<Vec<Gaussian<N>>> {
        let Recorder { follower, .. } = &self.recorder;
        let side = &follower.side;
        let reading = follower.reading();
        let instants: Vec<_> = self
            .samples
            .iter()
            .take(self.recorder.touching())
            .map(|(sample, factor)| Instant {
                process: follower.motion.step(side, sample),
                measurement: InflatedNoise { model: &reading, factor: *factor },
                reading: Vector1::new(sample.reading_n_m),
            })
            .collect();
        let guess: Vec<SVector<f64, N>> = smoothed.iter().take(instants.len()).map(|belief| belief.mean).collect();
        let prior = follower.motion.belief(&anywhere(side));
        let mut beliefs = solve(&prior, &instants, guess, &self.search).ok()?;
        beliefs.extend(&smoothed[instants.len()..]);
        Some(beliefs)
    }
}

/// A prior that is diffuse in the contact's position.
fn anywhere(side: &Side) -> Gaussian<2> {
    let (low_m, high_m) = side.face.modelled.arc_range_m();
    let variance_m2 = (high_m - low_m).powi(2);
    Gaussian::new(vector![0.5 * (low_m + high_m), 0.0], Matrix2::identity() * variance_m2)
}

impl<Model: Motion<N>, const N: usize> Tracker for Collector<Model, N> {
    fn step(&mut self, sample: &Sample) -> Option<Estimate> {
        let estimate = self.recorder.step(sample)?;
        let gate = self.recorder.follower.gate_sds();
        let excess = estimate.innovation.map_or(1.0, |innovation| (innovation.nis / (gate * gate)).max(1.0));
        // The first sample of a touch has no preceding position, so its motion does not count.
        let is_first = self.samples.is_empty();
        let motion = if is_first { Pose::new(0.0, 0.0, 0.0) } else { sample.motion };
        self.samples.push((Sample { motion, ..*sample }, excess));
        Some(estimate)
    }

    fn hindsight(&mut self) -> Option<Vec<Option<Estimate>>> {
        let smoothed = self.recorder.smoothed();
        let beliefs = self.solved(&smoothed).unwrap_or(smoothed);
        Some(self.recorder.estimates(&beliefs))
    }
}
