//! One trial at one noise level and under one seed: sense, replay, score, write.

use std::path::Path;
use std::sync::Arc;

use whisker::estimators::Knowledge;

use super::maps::MapView;
use super::prepared::Prepared;
use super::sense::Sensed;
use super::settings::EvaluateSettings;
use super::shards::TrialResults;
use super::work::{LoadedTrial, caught};
use super::write;
use crate::metrics::{Trial, Unscored, first_touch_s};
use crate::participant::{Participant, Task};
use crate::replay::{Replay, knowledge, read_by};
use crate::results::FailureRow;

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
    /// Runs the trial. A trial that cannot be sensed or scored, or on which a participant fails, is recorded as a failure. Tables by instant are written even of a trial
    /// that cannot be scored, so that every run has the same files.
    ///
    /// # Errors
    /// If a table cannot be written.
    pub(super) fn run(&self) -> anyhow::Result<TrialOutput> {
        let sensed = match self.sense() {
            Ok(sensed) => sensed,
            Err(error) => return Ok(TrialOutput::failed(self.failure(None, format!("{error:#}")))),
        };
        if let Some(folder) = self.out {
            write::sensed(folder, &sensed, self.settings.touch)?;
        }
        let mut output = TrialOutput::default();
        let never_touches = first_touch_s(&sensed.trace).err().filter(|reason| *reason == Unscored::NeverTouches);
        output.results.failures.extend(never_touches.map(|reason| self.failure(None, reason.to_string())));
        for (participant, name) in self.prepared.participants.iter().zip(&self.prepared.names) {
            let replayed = self.replay(participant.as_ref(), name, &sensed);
            self.score(&sensed, &replayed, &mut output)?;
        }
        Ok(output)
    }

    /// Replays the trial through one participant. A failure to replay leaves no estimates.
    fn replay<'a>(&self, participant: &dyn Participant, estimator: &'a str, sensed: &Sensed<'_>) -> Replayed<'a> {
        let (spec, sidecar) = (self.loaded.spec, &sensed.trace.sidecar);
        let faces = self.prepared.calibration(spec).faces(participant.sensor_model());
        let faces = read_by(spec.sensor.as_ref(), faces);
        let known = Arc::unwrap_or_clone(knowledge(sidecar, &faces, sensed.noise_sd_n_m));
        let knowledge =
            Arc::new(Knowledge { contact_prior: spec.contact_prior, base_noise: spec.base_noise(), ..known });
        let task = Task {
            knowledge: &knowledge,
            samples: &sensed.samples,
            touched: &sensed.touched,
            trace: &sidecar.name,
            seed: self.seed,
        };
        let answer = caught(|| participant.replay(&task).map_err(|error| format!("{error:#}"))).flatten();
        let replay = answer.unwrap_or_else(|reason| Replay::silent(sensed.samples.len(), reason));
        Replayed { estimator, knowledge, replay }
    }

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

    /// The trial as metrics see it.
    pub(super) fn trial<'a>(&'a self, sensed: &'a Sensed<'_>, replayed: &'a Replayed<'_>) -> Trial<'a> {
        Trial {
            trace: &sensed.trace,
            outline: self.loaded.spec.outline.as_ref(),
            knowledge: &replayed.knowledge,
            readings_n_m: &sensed.readings_n_m,
            events: sensed.events.as_ref(),
            bound: sensed.bound,
            ground_truth: &sensed.ground_truth,
        }
    }
}
