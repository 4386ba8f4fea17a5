//! The simulator compared with theory: the chain with the elastica, its dynamics with the analytic beam; and the figures.

use std::fs;
use std::path::Path;

use crate::failure::{Failure, Outcome};
use crate::parts::step;
use crate::pipeline;
use crate::python::{self, Requirements};
use crate::repository::root;
use crate::tools::{python as python_command, run as run_command, whisker};

const SUITE: &str = "standard";
/// Tables, figures and page.
const RESULTS: &str = "results/physics";
/// Files that `docs/PHYSICS.md` shows, and the folder that keeps them.
const KEPT: [&str; 10] = [
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
];
const REFERENCE: &str = "results/reference/physics";

pub(crate) fn run() -> Outcome {
    // The studies need SciPy, one of the packages for development.
    python::install(Requirements::Development)?;
    pipeline::simulate(SUITE)?;
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
        keep(&results, &root().join(REFERENCE))?;
    }
    outcome
}

/// Copies the files that the documentation shows.
fn keep(results: &Path, reference: &Path) -> Outcome {
    let copy = |path: &str| {
        let kept = reference.join(Path::new(path).file_name().unwrap_or_default());
        let unfinished = kept.with_extension("partial");
        fs::create_dir_all(reference)
            .and_then(|()| fs::copy(results.join(path), &unfinished))
            .and_then(|_| fs::rename(&unfinished, &kept))
            .map_err(|error| Failure::new(format!("{}: cannot be written: {error}", kept.display())))
    };
    KEPT.into_iter().try_for_each(copy)
}
