//! The benchmarks of every crate.

use crate::failure::Outcome;
use crate::tools::{cargo, run as run_command};

pub(crate) fn run() -> Outcome {
    run_command(cargo(&["bench", "--workspace"]))
}
