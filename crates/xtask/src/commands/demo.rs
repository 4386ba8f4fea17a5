//! The standard suite from an empty checkout to figures: simulate, fit, evaluate, report.

use std::time::Instant;

use crate::failure::{Failure, Outcome};
use crate::pipeline::{self, Evaluations, FORCE};

const SUITE: &str = "standard";

/// Estimators of the demo: one of each kind, few enough to be distinguished in a figure.
const ESTIMATORS: &[&str] = &[
    "recommended",
    "batch-recommended",
    "ekf",
    "paper-ekf",
    "paper-ukf",
    "euler-bernoulli",
    "euler-bernoulli-calibrated",
];

pub(crate) fn run(arguments: &[String]) -> Outcome {
    const ALL: &str = "--all";
    if let Some(surplus) = arguments.iter().find(|option| ![ALL, FORCE].contains(&option.as_str())) {
        return Err(Failure::new(format!("demo: found `{surplus}`, expected {ALL}, {FORCE} or no argument")));
    }
    let has = |name: &str| arguments.iter().any(|option| option == name);
    let estimators = (!has(ALL)).then_some(ESTIMATORS);
    let started = Instant::now();
    pipeline::prepare_with(|| pipeline::simulate_with_animations(SUITE))?;
    pipeline::fit(SUITE)?;
    Evaluations::new(has(FORCE)).of(SUITE, estimators)?;
    pipeline::report(SUITE)?;
    println!(
        "\nPage and figures in {:.0} s: results/{SUITE}/index.html, results/{SUITE}/figures/",
        started.elapsed().as_secs_f64()
    );
    if estimators.is_some() {
        println!("Every registered estimator: cargo xtask demo --all {FORCE}");
    }
    Ok(())
}
