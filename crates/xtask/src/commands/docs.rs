//! The measured values of the documentation, written into its files from `results/reference/`.

use crate::failure::Outcome;
use crate::tools::{python, run as run_command};

pub(crate) fn run() -> Outcome {
    run_command(python(&["docs/figures.py"]))
}
