//! A trial to be run, its estimates and its results.

use std::path::Path;
use std::sync::Arc;

use testbed::replay::Replay;
use testbed::results::FailureRow;
use whisker::estimators::Knowledge;

use super::loaded_trial::LoadedTrial;
use super::maps::MapView;
use super::prepared::Prepared;
use super::settings::EvaluateSettings;
use super::shards::TrialResults;

/// A trial to be run through every participant.
pub(super) struct TrialJob<'a> {
    pub(super) prepared: &'a Prepared,
    pub(super) settings: &'a EvaluateSettings,
    pub(super) loaded: &'a LoadedTrial<'a>,
    /// All trials of its scene, itself included.
    pub(super) scene: &'a [LoadedTrial<'a>],
    /// Index of the noise level in the settings.
    pub(super) level: usize,
    /// Seed of the measurement noise.
    pub(super) seed: u64,
    /// Folder of the run for tables by instant. `None` except at the first noise level and seed.
    pub(super) out: Option<&'a Path>,
}

/// Results of one trial, and its contributions to maps.
#[derive(Default)]
pub(super) struct TrialOutput {
    pub(super) results: TrialResults,
    pub(super) views: Vec<MapView>,
}

/// One estimator's replay of a trial.
pub(super) struct Replayed<'a> {
    pub(super) estimator: &'a str,
    /// Prior information that the estimator was given.
    pub(super) knowledge: Arc<Knowledge>,
    pub(super) replay: Replay,
}

impl TrialOutput {
    /// Output of a trial that failed as a whole.
    pub(super) fn failed(failure: FailureRow) -> Self {
        Self { results: TrialResults { failures: vec![failure], ..TrialResults::default() }, views: Vec::new() }
    }
}

impl TrialJob<'_> {
    /// A failure of an estimator, or of the whole trial without one.
    pub(super) fn failure(&self, estimator: Option<&str>, reason: String) -> FailureRow {
        FailureRow {
            trace: self.loaded.spec.sidecar.name.clone(),
            estimator: estimator.map(Into::into),
            noise: self.noise(),
            seed: self.seed,
            reason,
        }
    }

    /// Noise level as a fraction of the set's largest reading.
    pub(super) fn noise(&self) -> f64 {
        self.settings.noise[self.level]
    }
}
