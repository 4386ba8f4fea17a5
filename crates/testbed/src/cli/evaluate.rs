//! `whisker evaluate`: every estimator over every trial.

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::Context;
use serde_json::Value;
use trace::read_json;
use whisker::estimators::ESTIMATORS;

use super::{noise_fraction, progress_bar, table};
use crate::dataset::Dataset;
use crate::evaluate::{EvaluateSettings, evaluate};
use crate::results::SummaryRow;

/// Replay every trial of a suite or folder through the estimators and score them against the truth
#[derive(clap::Args)]
pub(super) struct Arguments {
    /// Suite (JSON) or folder of traces
    input: PathBuf,
    /// Folder of the suite's traces [default: datasets/<suite>]
    #[arg(long)]
    traces: Option<PathBuf>,
    /// Folder of the calibrations [default: calibrations/ beside the traces]
    #[arg(long)]
    calibrations: Option<PathBuf>,
    /// Estimators, by comma [default: all; `whisker list` names them]
    #[arg(long, value_delimiter = ',')]
    estimators: Option<Vec<String>>,
    /// File with settings by estimator: {"ekf": {"fading": 1.01}}
    #[arg(long)]
    config: Option<PathBuf>,
    /// Noise levels, as fractions of the largest reading of each set, by comma
    #[arg(long, value_delimiter = ',', default_value = "0.01", value_parser = noise_fraction)]
    noise: Vec<f64>,
    /// Number of noise seeds a trial, from 1 upwards
    #[arg(long, default_value_t = 5, value_parser = clap::value_parser!(u64).range(1..))]
    seeds: u64,
    /// Name of the run [default: the suite's or folder's]
    #[arg(long)]
    name: Option<String>,
    /// Folder under which the run's folder is made
    #[arg(long, default_value = "results")]
    results: PathBuf,
    /// Threads [default: one a core]
    #[arg(long)]
    threads: Option<usize>,
}

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<ExitCode> {
    let dataset = Dataset::open(&arguments.input, arguments.traces.as_deref())?;
    let config: BTreeMap<String, Value> = arguments.config.as_deref().map(read_json).transpose()?.unwrap_or_default();
    let settings = EvaluateSettings {
        name: arguments.name.clone().unwrap_or_else(|| dataset.name.clone()),
        estimators: arguments
            .estimators
            .clone()
            .unwrap_or_else(|| ESTIMATORS.iter().map(|row| row.name.to_owned()).collect()),
        config,
        noise: arguments.noise.clone(),
        seeds: (1..=arguments.seeds).collect(),
        calibrations: arguments.calibrations.clone().unwrap_or_else(|| dataset.calibrations()),
        results: arguments.results.clone(),
    };
    let threads = rayon::ThreadPoolBuilder::new()
        .num_threads(arguments.threads.unwrap_or(0))
        .build()
        .context("cannot start threads")?;
    let progress = progress_bar("evaluating");
    let evaluated = threads.install(|| evaluate(&dataset, &settings, &progress))?;
    progress.finish_and_clear();
    print!("{}", summary_table(&evaluated.summary));
    println!("{}{}", evaluated.folder.display(), if evaluated.is_new { "" } else { " (up to date)" });
    Ok(ExitCode::SUCCESS)
}

/// The summary for people, in millimetres.
fn summary_table(summary: &[SummaryRow]) -> String {
    let header = [
        "group",
        "whisker",
        "estimator",
        "noise",
        "trials",
        "RMSE, mm",
        "median, mm",
        "95 %, mm",
        "worst, mm",
        "< 1 mm, s",
        "< 0.3 mm, s",
        "never < 1 mm",
        "step, ns",
    ];
    let rows: Vec<Vec<String>> = summary
        .iter()
        .map(|row| {
            vec![
                row.group.clone(),
                row.whisker.clone(),
                row.estimator.clone(),
                format!("{} %", row.noise * 100.0),
                row.trials.to_string(),
                table::millimetres(row.rmse_m),
                table::millimetres(row.median_m),
                table::millimetres(row.p95_m),
                table::millimetres(row.worst_m),
                table::seconds(row.time_to_1mm_s),
                table::seconds(row.time_to_0p3mm_s),
                format!("{:.0} %", row.never_1mm * 100.0),
                format!("{:.0}", row.step_ns),
            ]
        })
        .collect();
    table::render(&header, &rows, 3)
}
