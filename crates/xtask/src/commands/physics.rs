//! The simulator against theory: the chain against the elastica, its dynamics against the analytic beam.

use crate::failure::Outcome;
use crate::parts::step;
use crate::pipeline;
use crate::python::{self, Progress, Requirements};
use crate::tools::{python as python_command, run as run_command};

const SUITE: &str = "standard";

pub(crate) fn run() -> Outcome {
    // SciPy, by which the studies find roots and eigenvalues, comes with the packages for development.
    python::install(Requirements::Development, Progress::Counter)?;
    pipeline::simulate(SUITE)?;
    let traces = format!("datasets/{SUITE}");
    step("physics", || {
        run_command(python_command(&["-m", "whisker_sim.physics", "--dataset", &traces, "--out", "results/physics"]))
    })
}
