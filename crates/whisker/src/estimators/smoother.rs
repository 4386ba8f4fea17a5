//! Fixed-interval smoother: the iterated filter forwards, the smoother backwards.

use std::sync::Arc;

use filters::smoother::{Step, smooth};
use filters::{Gaussian, Innovation, Process};
use nalgebra::SMatrix;
use serde_json::Value;

use super::gaussian::{self, Follower};
use super::iterated::Iterated;
use super::motion::{AnyMotion, Motion};
use super::{Estimate, Knowledge, Method, Sample, Touch, Tracker};
use crate::settings::{SettingsError, parse, within};

/// Settings: those of the filter.
pub(super) type Config = gaussian::Config<Iterated>;

struct Smoother {
    config: Config,
    knowledge: Arc<Knowledge>,
}

pub(super) fn build(config: &Value, knowledge: &Arc<Knowledge>) -> Result<Box<dyn Method>, SettingsError> {
    let config = parse(config)?;
    check_used(&config)?;
    Ok(Box::new(Smoother { config, knowledge: knowledge.clone() }))
}

/// Refuses settings of the filter that have no effect here: each touch begins anew, and no systematic errors are stated.
pub(super) fn check_used(config: &Config) -> Result<(), SettingsError> {
    within("kept_share", config.kept_share, 0.0..=0.0)?;
    within("return_rate", config.return_rate, 0.0..=0.0)?;
    within("systematic.offset", config.systematic.offset, 0.0..=0.0)?;
    within("systematic.drift_per_s", config.systematic.drift_per_s, 0.0..=0.0)?;
    within("systematic.latency_s", config.systematic.latency_s, 0.0..=0.0)
}

impl Method for Smoother {
    fn begin(&self, touch: &Touch<'_>) -> Box<dyn Tracker> {
        self.config.motion.begin(self, touch)
    }
}

impl AnyMotion for Smoother {
    fn begin_with<Model: Motion<N>, const N: usize>(&self, motion: Model, touch: &Touch<'_>) -> Box<dyn Tracker> {
        Box::new(Recorder::new(Follower::new(self.config, motion, touch, &self.knowledge)))
    }
}

/// A filter that keeps its steps.
pub(super) struct Recorder<Model, const N: usize> {
    pub(super) follower: Follower<Iterated, Model, N>,
    steps: Vec<Step<N>>,
    /// Index of each sample's step. `None` if the filter had none.
    places: Vec<Option<usize>>,
}

impl<Model: Motion<N>, const N: usize> Recorder<Model, N> {
    pub(super) fn new(follower: Follower<Iterated, Model, N>) -> Self {
        Self { follower, steps: Vec::new(), places: Vec::new() }
    }

    /// Number of steps up to the last at which the whisker was deflected: between the loss of a contact and its
    /// detection the smoother has no information.
    pub(super) fn touching(&self) -> usize {
        self.steps.iter().rposition(|step| step.filtered.mean[1] > 0.0).map_or(0, |last| last + 1)
    }

    /// Beliefs of all steps, those with a contact smoothed.
    pub(super) fn smoothed(&self) -> Vec<Gaussian<N>> {
        let (touching, lost) = self.steps.split_at(self.touching());
        let mut beliefs = smooth(touching);
        beliefs.extend(lost.iter().map(|step| step.filtered));
        beliefs
    }

    /// Estimates of all samples from beliefs of all steps.
    pub(super) fn estimates(&self, beliefs: &[Gaussian<N>]) -> Vec<Option<Estimate>> {
        self.places.iter().map(|place| place.map(|step| self.estimate(&beliefs[step], None))).collect()
    }

    fn estimate(&self, belief: &Gaussian<N>, innovation: Option<Innovation<1>>) -> Estimate {
        let Follower { side, motion, .. } = &self.follower;
        motion.place(side, belief, side.estimate(motion.radius(), belief, innovation))
    }
}

impl<Model: Motion<N>, const N: usize> Tracker for Recorder<Model, N> {
    fn step(&mut self, sample: &Sample) -> Option<Estimate> {
        let advance = self.follower.advance(sample);
        self.places.push(advance.as_ref().map(|_| self.steps.len()));
        let advance = advance?;
        let jacobian = self.steps.last().map_or_else(SMatrix::identity, |last| {
            self.follower.motion.step(&self.follower.side, sample).jacobian(&last.filtered.mean)
        });
        self.steps.push(Step { jacobian, predicted: advance.predicted, filtered: advance.filtered });
        Some(self.estimate(&advance.filtered, advance.innovation))
    }

    fn hindsight(&mut self) -> Option<Vec<Option<Estimate>>> {
        Some(self.estimates(&self.smoothed()))
    }
}
