//! Certainty on random scenes on which no setting was chosen, on contacts with friction, on objects that are not convex, move or
//! give way, and of a sensor that deviates from its calibration.

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

/// Suite of objects that give way; settings were chosen on `yielding_training`.
const YIELDING: &str = "yielding";

/// Suite of contacts of 22 s, for a sensor whose gain and mounting deviate.
const DEVIATIONS: &str = "deviations";

/// Seeds of the measurement noise of the suites `friction`, `hollow` and `yielding`, as docs/CERTAINTY.md states.
const SEEDS: u32 = 20;

/// Sets of claims, each with the folder of its table.
const CLAIMS: [(&str, &str); 4] = [
    ("certainty", "results/reference/certainty"),
    ("contacts", "results/reference/contacts"),
    ("quantities", "results/reference/quantities"),
    ("yielding", "results/reference/yielding"),
];

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
    evaluations.trusted(STANDARD)?;
    for run in ["range", "trusted"] {
        kept::keep(run, &["run.json", "summary.csv"])?;
    }
    pipeline::simulate(RANDOM)?;
    pipeline::fit(RANDOM)?;
    // `outline-batch` shows which readings have several explanations.
    evaluations.as_stated(RANDOM, "recommended,outline-batch")?;
    pipeline::simulate(RANDOM_CONTACTS)?;
    pipeline::fit(RANDOM_CONTACTS)?;
    evaluations.as_stated(RANDOM_CONTACTS, "recommended")?;
    for (suite, estimators) in [(FRICTION, "recommended"), (HOLLOW, "recommended"), (YIELDING, "recommended,pushed")] {
        pipeline::simulate(suite)?;
        pipeline::fit(suite)?;
        evaluations.seeded(suite, estimators, SEEDS)?;
        kept::keep(suite, &["run.json", "summary.csv"])?;
    }
    pipeline::simulate(DEVIATIONS)?;
    pipeline::fit(DEVIATIONS)?;
    evaluations.installed(DEVIATIONS)?;
    kept::keep(DEVIATIONS, &["run.json", "summary.csv", "quantities.csv"])?;
    // All claims are measured, and the documentation is written, even if a claim does not hold.
    let outcomes =
        CLAIMS.map(|(set, out)| step("measure", || run_command(whisker(&["reproduce", "--set", set, "--out", out]))));
    step("documentation", docs::run)?;
    outcomes.into_iter().collect()
}
