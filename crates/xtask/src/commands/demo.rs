//! The main job on the standard suite, from an empty checkout to figures.

use std::time::Instant;

use crate::failure::Outcome;
use crate::pipeline;

const SUITE: &str = "standard";

pub(crate) fn run() -> Outcome {
    let started = Instant::now();
    pipeline::prepare()?;
    pipeline::simulate(SUITE)?;
    pipeline::animate(SUITE)?;
    pipeline::fit(SUITE)?;
    pipeline::evaluate(SUITE)?;
    pipeline::report(SUITE)?;
    println!(
        "\nPage and figures in {:.0} s: results/{SUITE}/index.html, results/{SUITE}/figures/",
        started.elapsed().as_secs_f64()
    );
    Ok(())
}
