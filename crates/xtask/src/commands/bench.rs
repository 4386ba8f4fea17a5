//! The benchmarks of every crate, and the speed of the generator.

use super::test::TESTED;
use crate::failure::Outcome;
use crate::parts::step;
use crate::python::{self, Progress, Requirements};
use crate::tools::{cargo, python as python_command, run as run_command};

pub(crate) fn run() -> Outcome {
    run_command(cargo(&[&["bench"], &TESTED[..]].concat()))?;
    // What states the claims comes with the studies, and these with SciPy.
    python::install(Requirements::Development, Progress::Counter)?;
    step("speed of the generator", || run_command(python_command(&["-m", "whisker_sim.physics.speed"])))
}
