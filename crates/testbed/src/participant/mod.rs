//! What can be put to the test: registered estimators, and programs of other people.
//!
//! An [`Participant`] is given what an honest robot knows and reads, and answers with estimates. Whether it runs in this process or is talked to
//! through pipes is its own affair; noise, seeds, scores, tables and figures are the same for all.

mod process;
mod program;
mod protocol;
mod registered;

use std::sync::Arc;

use whisker::estimators::{Knowledge, Sample};
use whisker::sensor::Face;

use crate::replay::Replay;
use crate::results::RunEstimator;

pub use program::Program;
pub use protocol::{PROTOCOL, estimate};
pub use registered::Registered;

/// One trial as an participant meets it.
#[derive(Clone, Copy, Debug)]
pub struct Task<'a> {
    /// What the robot knows before it touches anything.
    pub knowledge: &'a Arc<Knowledge>,
    /// What it learns, in the order of time.
    pub samples: &'a [Sample],
    /// What the detection of contacts, the same for all, says of each sample: the side on which the object lies while the whisker touches.
    pub touched: &'a [Option<Face>],
    /// Name of the trace, from which and the seed each participant's own randomness follows.
    pub trace: &'a str,
    /// Seed of the trial.
    pub seed: u64,
}

/// Takes part in an evaluation.
pub trait Participant: Send + Sync {
    /// What a run records of it; the name is that of its rows and files.
    fn describe(&self) -> RunEstimator;

    /// Label of the sensor model that it insists on; without one it is given the calibration's choice.
    fn sensor_model(&self) -> Option<&'static str> {
        None
    }

    /// Finds out before anything is run whether it can run at all.
    ///
    /// # Errors
    /// If its settings are wrong, or its program does not start.
    fn check(&self, knowledge: &Arc<Knowledge>) -> anyhow::Result<()>;

    /// Replays one trial. A failure on the way is a part of the answer: [`Replay::failure`].
    ///
    /// # Errors
    /// If it cannot even begin.
    fn replay(&self, task: &Task<'_>) -> anyhow::Result<Replay>;
}
