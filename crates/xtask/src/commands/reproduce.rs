//! Every published figure, measured again.

use crate::failure::Outcome;
use crate::parts::step;
use crate::pipeline;
use crate::tools::{run as run_command, whisker};

const SUITE: &str = "standard";

pub(crate) fn run() -> Outcome {
    pipeline::prepare()?;
    pipeline::simulate(SUITE)?;
    pipeline::fit(SUITE)?;
    pipeline::evaluate(SUITE)?;
    step("reproduce", || run_command(whisker(&["reproduce"])))
}
