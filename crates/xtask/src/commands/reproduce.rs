//! Every claim of the documentation, measured again.

use std::path::Path;

use crate::failure::Outcome;
use crate::parts::step;
use crate::pipeline;
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

/// Standard deviations of the arm's joint encoders (rad).
const ENCODERS: &[&str] = &["0", "1e-5", "3e-5", "1e-4", "3e-4", "1e-3"];

/// Optional clone of the public repository with recordings of real sensors (docs/REAL.md), and the name of the run on it.
const CLONE: &str = "datasets/stanford-clone";
const RECORDINGS: &str = "stanford";

pub(crate) fn run() -> Outcome {
    pipeline::prepare()?;
    pipeline::simulate(SUITE)?;
    pipeline::fit(SUITE)?;
    pipeline::evaluate(SUITE, None)?;
    pipeline::evaluate_on(OBJECTS, SUITE, SUITE, 20)?;
    pipeline::simulate(PINS)?;
    pipeline::evaluate_on(PINS, PINS, SUITE, 2)?;
    pipeline::fit_through(HALL, SUITE)?;
    pipeline::evaluate_through(HALL, PINS, SUITE, HALL, "recommended,ukf", "0.01,0")?;
    pipeline::simulate(LIFT_OFFS)?;
    pipeline::evaluate_on(LIFT_OFFS, LIFT_OFFS, SUITE, 2)?;
    pipeline::simulate(ARM)?;
    pipeline::fit(ARM)?;
    pipeline::fit_through(HALL, ARM)?;
    pipeline::evaluate_through(HALL, ARM, ARM, ARM, "recommended,sliding,ukf,paper-ekf", "0.01")?;
    pipeline::page(ARM)?;
    pipeline::evaluate_encoders(ARM, ENCODERS)?;
    if Path::new(CLONE).is_dir() {
        pipeline::recordings("stanford-whisker", CLONE, RECORDINGS)?;
    }
    step("reproduce", || run_command(whisker(&["reproduce"])))
}
