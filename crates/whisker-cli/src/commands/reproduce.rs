//! `whisker reproduce`: measures every claim of the documentation.

use std::fs;
use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::Context as _;
use files::write_atomically;
use report::report;

use super::output::reserve;
use super::print;
use super::progress::Progress;
use super::table::render;
use crate::claims::{ARM, Context, STANDARD, measure};

/// Run and file of each figure that the documentation shows.
const README_FIGURES: &[(&str, &str)] = &[(STANDARD, "physical_limit.svg"), (ARM, "scene_map.svg")];

/// Measure every claim of the documentation and write results/reference/
#[derive(clap::Args)]
pub(super) struct Arguments {
    /// Folder of the evaluated runs
    #[arg(long, default_value = "results")]
    results: PathBuf,
    /// Folder for the table of claims and the figures that the documentation shows
    #[arg(long, default_value = "results/reference")]
    out: PathBuf,
}

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<ExitCode> {
    let _lock = reserve(&arguments.out, &[])?;
    let context = Context::open(&arguments.results)?;
    let table = arguments.out.join("claims.csv");
    let progress = Progress::of("measuring");
    let claims = measure(&context, &table, &progress)?;
    drop(progress);
    for run in context.runs() {
        report(&arguments.results.join(run), &Progress::of("drawing"))?;
    }
    for (run, name) in README_FIGURES {
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
