//! Every claim of the documentation, measured again.

use std::path::Path;

use super::{docs, real};
use crate::failure::{Failure, Outcome};
use crate::kept;
use crate::parts::step;
use crate::pipeline::{self, Evaluations, FORCE};
use crate::tools::{run as run_command, whisker};

const SUITE: &str = "standard";

/// Suite of the objects of the standard suite.
const OBJECTS: &str = "objects";

/// Suite of pins for the Monte-Carlo, on the whiskers that the standard suite calibrates.
const PINS: &str = "pins100";

/// Front end with a Hall sensor, through which the pins are replayed.
const HALL: &str = "hall";

/// Suite of lost contacts on a vibrating arm, on the same whiskers.
const LIFT_OFFS: &str = "contact_events";

/// Suite of six whiskers on a robot arm, with their own calibrations.
const ARM: &str = "arm";

/// Suite of scenes in space, the estimators whose scores the documentation shows, and the seeds of their measurement noise.
const SPACE: &str = "spatial";
const SPACE_ESTIMATORS: &str =
    "line,cylinder,sphere,line-fit,cylinder-fit,cone-fit,sphere-fit,recommended,batch-recommended";
const SPACE_SEEDS: u32 = 20;

/// Random scenes in space, and the seeds of their measurement noise.
const RANDOM_SPACE: &str = "random_space";
const RANDOM_SPACE_SEEDS: u32 = 5;

/// Set of claims about contacts in space, and the folder of their table.
const SPACE_CLAIMS: &str = "space";
const SPACE_CLAIMS_OUT: &str = "results/reference/spatial";

/// Standard deviations of the arm's joint encoders (rad).
const ENCODERS: &[&str] = &["0", "1e-5", "3e-5", "1e-4", "3e-4", "1e-3"];

/// Optional clone of the public repository with recordings of real sensors (docs/REAL.md).
const CLONE: &str = "datasets/stanford-clone";

/// Runs whose summaries the documentation shows.
const KEPT: [&str; 6] = [SUITE, OBJECTS, PINS, HALL, LIFT_OFFS, ARM];

pub(crate) fn run(arguments: &[String]) -> Outcome {
    let evaluations = match arguments {
        [] => Evaluations::new(false),
        [option] if option == FORCE => Evaluations::new(true),
        [surplus, ..] => {
            return Err(Failure::new(format!("reproduce: found `{surplus}`, expected {FORCE} or no argument")));
        }
    };
    pipeline::prepare()?;
    pipeline::simulate(SUITE)?;
    pipeline::fit(SUITE)?;
    evaluations.of(SUITE, None)?;
    evaluations.on(OBJECTS, SUITE, SUITE, 20)?;
    pipeline::simulate(PINS)?;
    evaluations.on(PINS, PINS, SUITE, 2)?;
    pipeline::fit_through(HALL, SUITE)?;
    evaluations.through(HALL, PINS, SUITE, HALL, "recommended,ukf", "0.01,0")?;
    pipeline::simulate(LIFT_OFFS)?;
    evaluations.on(LIFT_OFFS, LIFT_OFFS, SUITE, 2)?;
    pipeline::simulate(ARM)?;
    pipeline::fit(ARM)?;
    pipeline::fit_through(HALL, ARM)?;
    evaluations.through(HALL, ARM, ARM, ARM, "recommended,sliding,ukf,paper-ekf", "0.01")?;
    pipeline::page(ARM)?;
    evaluations.with_encoders(ARM, ENCODERS)?;
    pipeline::simulate(SPACE)?;
    pipeline::fit(SPACE)?;
    evaluations.seeded(SPACE, SPACE_ESTIMATORS, SPACE_SEEDS)?;
    kept::keep(SPACE, &["space_run.json", "space_summary.csv", "space_times.csv"])?;
    pipeline::simulate(RANDOM_SPACE)?;
    pipeline::fit(RANDOM_SPACE)?;
    evaluations.seeded(RANDOM_SPACE, "recommended,batch-recommended", RANDOM_SPACE_SEEDS)?;
    if Path::new(CLONE).is_dir() {
        real::measure(evaluations, CLONE)?;
    }
    KEPT.into_iter().try_for_each(|run| kept::keep(run, &["run.json", "summary.csv"]))?;
    // The documentation is written even if a claim does not hold.
    let outcome = step("reproduce", || run_command(whisker(&["reproduce"])));
    let in_space = ["reproduce", "--set", SPACE_CLAIMS, "--out", SPACE_CLAIMS_OUT];
    let in_space = step("reproduce in space", || run_command(whisker(&in_space)));
    step("documentation", docs::run)?;
    outcome.and(in_space)
}
