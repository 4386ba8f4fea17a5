//! The main job on a suite, step by step. The steps themselves leave alone what is up to date.

use std::thread;

use crate::failure::Outcome;
use crate::parts::step;
use crate::python::{self, Progress, Requirements};
use crate::tools::{cargo, python, run, start, whisker};

/// Builds `whisker` while pip fetches the packages: one keeps the processor busy, the other the network.
pub(crate) fn prepare() -> Outcome {
    step("Python packages and the command whisker", || {
        let build = start(cargo(&["build", "--release", "--package", "testbed"]))?;
        if let Err(failure) = python::install(Requirements::Runtime, Progress::Lines) {
            build.abandon();
            return Err(failure);
        }
        build.finish()
    })
}

/// Scenes to traces: `scenes/suites/<suite>.json` to `datasets/<suite>/`.
pub(crate) fn simulate(suite: &str) -> Outcome {
    let jobs = thread::available_parallelism().map_or(1, usize::from).to_string();
    let (scenes, traces) = (suite_file(suite), format!("datasets/{suite}"));
    step("simulate", || run(python(&["-m", "whisker_sim", "simulate", &scenes, "--out", &traces, "--jobs", &jobs])))
}

/// Calibration traces to sensor models: `datasets/<suite>/calibrations/`.
pub(crate) fn fit(suite: &str) -> Outcome {
    step("fit", || run(whisker(&["fit", &suite_file(suite)])))
}

/// Every estimator on every trial, scored: `results/<suite>/`.
pub(crate) fn evaluate(suite: &str) -> Outcome {
    step("evaluate", || run(whisker(&["evaluate", &suite_file(suite)])))
}

/// Scores to figures and a page: `results/<suite>/`.
pub(crate) fn report(suite: &str) -> Outcome {
    step("report", || run(whisker(&["report", &format!("results/{suite}")])))
}

fn suite_file(suite: &str) -> String {
    format!("scenes/suites/{suite}.json")
}
