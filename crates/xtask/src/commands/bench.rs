//! The benchmarks of every crate, and the speed of the generator.

use super::test::TESTED;
use crate::failure::Outcome;
use crate::parts::step;
use crate::python::{self, Requirements};
use crate::tools::{cargo, python as python_command, run as run_command};

pub(crate) fn run() -> Outcome {
    run_command(cargo(&[&["bench"], &TESTED[..]].concat()))?;
    // The module imports the studies, which need SciPy.
    python::install(Requirements::Development)?;
    step("speed of the generator", || run_command(python_command(&["-m", "whisker_sim.physics.speed"])))
}
