//! Comparison of this project's filters with those of the crate `smelly` on one problem.
//!
//! `peers TRACE CALIBRATION SEEDS OUT` writes the problem to the file OUT, for filters in other languages, and prints
//! the estimates of every filter and the time of one step as JSON.

mod filter;
mod ours;
mod polynomial;
mod problem;
mod smellys;

use std::path::Path;

use anyhow::bail;

use crate::filter::timed;
use crate::problem::Problem;

fn main() -> anyhow::Result<()> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [trace, calibration, seeds, out] = &arguments[..] else {
        bail!("found {} arguments, expected TRACE CALIBRATION SEEDS OUT", arguments.len());
    };
    let problem = Problem::new(Path::new(trace), Path::new(calibration))?;
    files::write_json(Path::new(out), &problem)?;
    let seeds = seeds.parse()?;
    let answers = [
        timed("whisker", "ekf", 1, &problem, |_| ours::extended(&problem)),
        timed("smelly", "ekf", 1, &problem, |_| smellys::extended(&problem)),
        timed("whisker", "ukf", 1, &problem, |_| ours::unscented(&problem)),
        timed("smelly", "ukf", 1, &problem, |_| smellys::unscented(&problem)),
        timed("whisker", "particle", seeds, &problem, |seed| ours::particle(&problem, seed)),
        timed("smelly", "particle", seeds, &problem, |seed| smellys::particle(&problem, seed)),
    ];
    println!("{}", serde_json::to_string(&answers)?);
    Ok(())
}
