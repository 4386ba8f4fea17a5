//! `whisker reproduce`: measures every claim of the documentation.

use std::collections::BTreeSet;
use std::fs;
use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::Context as _;
use files::write_atomically;
use report::report;

use super::output::reserve_folder;
use super::print;
use super::progress::Progress;
use super::table::render;
use crate::claims::{ClaimSet, Context, SETS, measure};

/// Measure every claim of the documentation and write results/reference/
#[derive(clap::Args)]
pub(super) struct Arguments {
    /// Set of claims: standard, certainty, contacts, quantities, yielding or space
    #[arg(long, value_parser = set_of, default_value = SETS[0].name)]
    set: &'static ClaimSet,
    /// Folder of the evaluated runs
    #[arg(long, default_value = "results")]
    results: PathBuf,
    /// Folder for the table of claims and the figures that the documentation shows
    #[arg(long, default_value = "results/reference")]
    out: PathBuf,
}

fn set_of(name: &str) -> Result<&'static ClaimSet, String> {
    SETS.iter().find(|set| set.name == name).ok_or_else(|| {
        let known: Vec<_> = SETS.iter().map(|set| set.name).collect();
        format!("expected one of: {}", known.join(", "))
    })
}

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<ExitCode> {
    let _lock = reserve_folder(&arguments.out, &[])?;
    let context = Context::open(arguments.set, &arguments.results)?;
    let table = arguments.out.join("claims.csv");
    let progress = Progress::of("measuring");
    let claims = measure(arguments.set, &context, &table, &progress)?;
    drop(progress);
    let drawn: BTreeSet<&str> = arguments.set.figures.iter().map(|(run, _)| *run).collect();
    for run in drawn {
        report(&arguments.results.join(run), &Progress::of("drawing"))?;
    }
    for (run, name) in arguments.set.figures {
        let figure = arguments.results.join(run).join("figures").join(name);
        let picture = fs::read(&figure).with_context(|| figure.display().to_string())?;
        write_atomically(&arguments.out.join(name), &picture)?;
    }
    let rows: Vec<Vec<String>> = claims
        .iter()
        .map(|claim| {
            vec![
                claim.claim.clone(),
                claim.measured.map_or("-".into(), |measured| format!("{measured:.3}")),
                format!("{} {}", claim.relation, claim.bound),
                claim.unit.clone(),
                match claim.holds {
                    Some(true) => "holds",
                    Some(false) => "DOES NOT HOLD",
                    None => "not measured: needs the recordings (docs/REAL.md)",
                }
                .into(),
            ]
        })
        .collect();
    let lines = render(&["claim", "measured", "bound", "unit", ""], &rows, 1);
    print(&format!("{lines}{}\n", table.display()))?;
    Ok(if claims.iter().all(|claim| claim.holds != Some(false)) { ExitCode::SUCCESS } else { ExitCode::FAILURE })
}
