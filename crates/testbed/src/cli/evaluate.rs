//! `whisker evaluate`: every estimator over every trial.

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::Context;
use serde::Deserialize;
use serde_json::Value;
use trace::read_json;
use whisker::estimators::ESTIMATORS;
use whisker::touch::TouchConfig;

use super::{FINISHED_WITH_FAILURES, noise_fraction, print, progress_bar, table};
use crate::dataset::Dataset;
use crate::evaluate::{EvaluateSettings, evaluate};
use crate::results::SummaryRow;

/// Replay every trial of a suite or folder through the estimators and score them against the truth
#[derive(clap::Args)]
pub(super) struct Arguments {
    /// Suites (JSON) or folders of traces
    #[arg(required = true)]
    inputs: Vec<PathBuf>,
    /// Folder of the suites' traces [default: datasets/<suite>]
    #[arg(long)]
    traces: Option<PathBuf>,
    /// Folder of the calibrations [default: calibrations/ beside the traces]
    #[arg(long)]
    calibrations: Option<PathBuf>,
    /// Estimators, by comma [default: all; `whisker list` names them]
    #[arg(long, value_delimiter = ',')]
    estimators: Option<Vec<String>>,
    /// File with settings by estimator, and of the touch detection: {"ekf": {"fading": 1.01}, "touch": {"samples": 3}}
    #[arg(long)]
    config: Option<PathBuf>,
    /// Noise levels, as fractions of the largest reading of each set, by comma
    #[arg(long, value_delimiter = ',', default_value = "0.01", value_parser = noise_fraction)]
    noise: Vec<f64>,
    /// Number of noise seeds a trial, from 1 upwards
    #[arg(long, default_value_t = 5, value_parser = clap::value_parser!(u64).range(1..))]
    seeds: u64,
    /// Name of the run [default: that of the suite or folder, several joined by +]
    #[arg(long)]
    name: Option<String>,
    /// Folder under which the run's folder is made
    #[arg(long, default_value = "results")]
    results: PathBuf,
    /// Threads [default: one a core]
    #[arg(long, value_parser = clap::value_parser!(u16).range(1..=1024))]
    threads: Option<u16>,
}

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<ExitCode> {
    let traces = arguments.traces.as_deref();
    let datasets: Vec<Dataset> =
        arguments.inputs.iter().map(|input| Dataset::open(input, traces)).collect::<anyhow::Result<_>>()?;
    let Config { touch, estimators: config } =
        arguments.config.as_deref().map(read_json).transpose()?.unwrap_or_default();
    let joined = || datasets.iter().map(|dataset| dataset.name.as_str()).collect::<Vec<_>>().join("+");
    let all = || ESTIMATORS.iter().map(|row| row.name.to_owned()).collect();
    let settings = EvaluateSettings {
        name: arguments.name.clone().unwrap_or_else(joined),
        estimators: arguments.estimators.clone().unwrap_or_else(all),
        config,
        touch,
        noise: arguments.noise.clone(),
        seeds: (1..=arguments.seeds).collect(),
        calibrations: arguments.calibrations.clone(),
        results: arguments.results.clone(),
    };
    let threads = rayon::ThreadPoolBuilder::new()
        .num_threads(arguments.threads.map_or(0, usize::from))
        .build()
        .context("cannot start threads")?;
    let progress = progress_bar("evaluating");
    let evaluated = threads.install(|| evaluate(&datasets, &settings, &progress))?;
    progress.finish_and_clear();
    let state = if evaluated.is_new { "" } else { " (up to date)" };
    print(&format!("{}{}{state}\n", summary_table(&evaluated.summary), evaluated.folder.display()))?;
    for failure in &evaluated.failures {
        eprintln!("failed: {} at noise {}, seed {}: {}", failure.trace, failure.noise, failure.seed, failure.reason);
    }
    Ok(if evaluated.failures.is_empty() { ExitCode::SUCCESS } else { ExitCode::from(FINISHED_WITH_FAILURES) })
}

/// A file of settings.
#[derive(Default, Deserialize)]
struct Config {
    #[serde(default)]
    touch: TouchConfig,
    #[serde(flatten)]
    estimators: BTreeMap<String, Value>,
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
