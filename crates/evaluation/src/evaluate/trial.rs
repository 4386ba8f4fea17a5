//! One trial at one noise level and under one seed: sense, replay, score, write.

use std::sync::Arc;

use testbed::metrics::{Trial, Unscored, first_touch_s};
use testbed::replay::{Replay, knowledge, read_by};
use whisker::estimators::Knowledge;

use super::job::{Replayed, TrialJob, TrialOutput};
use super::loaded_trial::caught;
use super::sense::Sensed;
use super::write;
use crate::participant::{Participant, Task};

impl TrialJob<'_> {
    /// Runs the trial. A trial that cannot be sensed or scored, or on which a participant fails, is recorded as a
    /// failure. Tables by instant are written even of a trial that cannot be scored, so that every run has the same
    /// files.
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
