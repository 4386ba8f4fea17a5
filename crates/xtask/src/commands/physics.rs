//! The simulator compared with theory: the chain with the elastica, its dynamics with the analytic beam; and the figures.

use std::fs;

use super::docs;
use crate::failure::Outcome;
use crate::kept;
use crate::parts::step;
use crate::pipeline;
use crate::python::{self, Requirements};
use crate::repository::root;
use crate::tools::{python as python_command, run as run_command, whisker};

const SUITE: &str = "standard";
/// Suite of scenes in space, whose traces a study expects beside those of [`SUITE`].
const SPATIAL_SUITE: &str = "spatial";
/// Name of the folder of results: tables, figures and page.
const NAME: &str = "physics";
const RESULTS: &str = "results/physics";
/// Files that the documentation shows.
const KEPT: [&str; 14] = [
    "claims.csv",
    "figures/convergence.svg",
    "figures/sweeps.svg",
    "figures/ringing.svg",
    "figures/speeds.svg",
    "figures/disturbance_approach.svg",
    "figures/disturbance_sideways.svg",
    "figures/disturbance_head_on.svg",
    "figures/disturbance_speed.svg",
    "figures/rig.svg",
    "figures/friction.svg",
    "figures/space_chain.svg",
    "figures/space_scenes.svg",
    "figures/space_suite.svg",
];

pub(crate) fn run() -> Outcome {
    // The studies need SciPy, one of the packages for development.
    python::install(Requirements::Development)?;
    pipeline::simulate(SUITE)?;
    pipeline::simulate(SPATIAL_SUITE)?;
    let traces = format!("datasets/{SUITE}");
    let results = root().join(RESULTS);
    let written = || fs::metadata(results.join("claims.csv")).and_then(|file| file.modified()).ok();
    let before = written();
    let outcome = step("physics", || {
        run_command(python_command(&["-m", "whisker_sim.physics", "--dataset", &traces, "--out", RESULTS]))
    });
    // The report is drawn even if a claim fails, but not from the claims of an earlier run.
    if written() != before {
        step("report", || run_command(whisker(&["report", RESULTS])))?;
        kept::keep(NAME, &KEPT)?;
        step("documentation", docs::run)?;
    }
    outcome
}
