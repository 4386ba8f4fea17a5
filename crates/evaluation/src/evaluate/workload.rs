//! Amount of work of an evaluation.

use std::time::Duration;

/// Work that an evaluation is about to do.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Workload {
    /// Number of trials, each counted once per noise level and seed.
    pub trials: usize,
    /// Number of estimators.
    pub estimators: usize,
    /// Number of threads.
    pub threads: usize,
    /// Expected duration. `None` for little work and for external programs, whose speed is unknown.
    pub duration: Option<Duration>,
}
