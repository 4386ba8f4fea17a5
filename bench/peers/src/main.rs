//! One problem for filters of several makers, and the filters of this project and of the crate `smelly` on it.
//!
//! `peers TRACE CALIBRATION SEEDS OUT` writes the problem to a file, for filters in other languages, and prints as JSON what every filter here
//! estimates and how long a step takes it.

mod filter;
mod ours;
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
    trace::write_json(Path::new(out), &problem)?;
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
