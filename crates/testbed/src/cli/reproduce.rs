//! `whisker reproduce`: every figure that the documentation claims, measured again.

use std::path::PathBuf;
use std::process::ExitCode;

use super::table;
use crate::claims::{Context, measure};

/// Measure every claim of the documentation and write results/reference/claims.csv
#[derive(clap::Args)]
pub(super) struct Arguments {
    /// Evaluated run of the standard suite
    #[arg(long, default_value = "results/standard")]
    run: PathBuf,
    /// Suite of that run
    #[arg(long, default_value = "scenes/suites/standard.json")]
    suite: PathBuf,
    /// File for the table
    #[arg(long, default_value = "results/reference/claims.csv")]
    out: PathBuf,
}

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<ExitCode> {
    let context = Context::open(&arguments.run, &arguments.suite)?;
    let claims = measure(&context, &arguments.out)?;
    let rows: Vec<Vec<String>> = claims
        .iter()
        .map(|claim| {
            vec![
                claim.claim.clone(),
                claim.measured.map_or("-".into(), |measured| format!("{measured:.3}")),
                format!("{} {}", claim.relation, claim.bound),
                claim.unit.clone(),
                if claim.holds { "holds" } else { "DOES NOT HOLD" }.into(),
            ]
        })
        .collect();
    print!("{}", table::render(&["claim", "measured", "bound", "unit", ""], &rows, 1));
    println!("{}", arguments.out.display());
    Ok(if claims.iter().all(|claim| claim.holds) { ExitCode::SUCCESS } else { ExitCode::FAILURE })
}
