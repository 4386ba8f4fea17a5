//! Certainty on random scenes on which no setting was chosen, on contacts with friction, and on objects that are not convex or move.

use super::docs;
use crate::failure::{Failure, Outcome};
use crate::kept;
use crate::parts::step;
use crate::pipeline::{self, Evaluations, FORCE};
use crate::tools::{run as run_command, whisker};

/// Suite for reports; settings were chosen on `random_training`.
const RANDOM: &str = "random";

/// Random suite whose contacts are not ideal, for reports; settings were chosen on `random_contacts_training`.
const RANDOM_CONTACTS: &str = "random_contacts";

/// Suite whose pins are evaluated with miscalibrations, and with noise of the calibrated range.
const STANDARD: &str = "standard";

/// Suite of contacts with friction.
const FRICTION: &str = "friction";

/// Suite of objects that are not convex or move.
const HOLLOW: &str = "hollow";

/// Seeds of the measurement noise of the suites `friction` and `hollow`, as docs/CERTAINTY.md states.
const SEEDS: u32 = 20;

/// Set of claims, and the folder of their table.
const CLAIMS: &str = "certainty";
const OUT: &str = "results/reference/certainty";

pub(crate) fn run(arguments: &[String]) -> Outcome {
    let evaluations = match arguments {
        [] => Evaluations::new(false),
        [option] if option == FORCE => Evaluations::new(true),
        [surplus, ..] => {
            return Err(Failure::new(format!("random: found `{surplus}`, expected {FORCE} or nothing")));
        }
    };
    pipeline::prepare()?;
    pipeline::simulate(STANDARD)?;
    pipeline::fit(STANDARD)?;
    evaluations.miscalibrated(STANDARD)?;
    evaluations.of_range(STANDARD)?;
    kept::keep("range", &["run.json", "summary.csv"])?;
    pipeline::simulate(RANDOM)?;
    pipeline::fit(RANDOM)?;
    // `outline-batch` shows which readings have several explanations.
    evaluations.as_stated(RANDOM, "recommended,outline-batch")?;
    pipeline::simulate(RANDOM_CONTACTS)?;
    pipeline::fit(RANDOM_CONTACTS)?;
    evaluations.as_stated(RANDOM_CONTACTS, "recommended")?;
    for suite in [FRICTION, HOLLOW] {
        pipeline::simulate(suite)?;
        pipeline::fit(suite)?;
        evaluations.recommended(suite, SEEDS)?;
        kept::keep(suite, &["run.json", "summary.csv"])?;
    }
    // The documentation is written even if a claim does not hold.
    let outcome = step("measure", || run_command(whisker(&["reproduce", "--set", CLAIMS, "--out", OUT])));
    step("documentation", docs::run)?;
    outcome
}
