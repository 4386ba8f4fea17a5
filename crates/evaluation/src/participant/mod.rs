//! Participants of an evaluation: registered estimators and external programs.
//!
//! A [`Participant`] receives the prior information and the samples of a trial and returns estimates. Whether it runs
//! in this process or communicates through pipes is an implementation detail; noise, seeds, scores, tables and figures
//! are the same for all.

#[cfg(target_os = "linux")]
mod descendants;
mod process;
mod program;
mod protocol;
mod registered;
mod spatial;

use std::sync::Arc;

use testbed::replay::Replay;
use testbed::results::RunEstimator;
use whisker::estimators::{Knowledge, Sample};
use whisker::sensor::Face;

pub use program::Program;
pub use registered::Registered;
pub use spatial::SpatialTask;

/// Kills the external programs of all running trials, on Linux with every process that they started, since they do not end with
/// this process. Trials with a program do not return any more, so that none is recorded as failed: the caller ends this process.
pub fn end_programs() {
    #[cfg(target_os = "linux")]
    descendants::end_all();
}

/// One trial from the view of a participant.
#[derive(Clone, Copy, Debug)]
pub struct Task<'a> {
    /// Prior information available to the estimator.
    pub knowledge: &'a Arc<Knowledge>,
    /// Samples in order of time.
    pub samples: &'a [Sample],
    /// Output of the common contact detector per sample: the face in contact, or `None` while the whisker is free.
    pub touched: &'a [Option<Face>],
    /// Name of the trace. A participant's random seed is derived from it and the trial's seed.
    pub trace: &'a str,
    /// Seed of the trial.
    pub seed: u64,
}

/// Participant of an evaluation.
pub trait Participant: Send + Sync {
    /// Description for the run's record; the name identifies its rows and files.
    fn describe(&self) -> RunEstimator;

    /// Label of the sensor model that it requires. `None`: the calibration's chosen model.
    fn sensor_model(&self) -> Option<&'static str> {
        None
    }

    /// Checks before the evaluation whether the participant can run.
    ///
    /// # Errors
    /// If its settings are invalid or its program does not start.
    fn check(&self, knowledge: &Arc<Knowledge>) -> anyhow::Result<()>;

    /// Replays one trial. A failure during the trial is part of the result: [`Replay::failure`].
    ///
    /// # Errors
    /// If the trial cannot be started.
    fn replay(&self, task: &Task<'_>) -> anyhow::Result<Replay>;
}
