//! `whisker evaluate`: every estimator on every trial.

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::process::ExitCode;
use std::time::Duration;

use anyhow::Context;
use files::read_json;
use serde::{Deserialize, Serialize};
use serde_json::Value;
use strict_json::parse_json;
use testbed::dataset::Dataset;
use testbed::encoders::Encoders;
use testbed::evaluate::{EvaluateSettings, OmittedEstimator, Share, Workload, evaluate, evaluate_share};
use testbed::front_end::FrontEnd;
use testbed::map::MapConfig;
use testbed::metrics::{bound, consistency, error};
use testbed::participant::Program;
use testbed::results::{FailureRow, SummaryRow};
use whisker::events::TouchConfig;

use super::{FINISHED_WITH_FAILURES, front_end, noise_fraction, print, progress_bar, table};

/// Default number of noise seeds per trial.
const DEFAULT_SEEDS: u64 = 5;

/// Prior information on the first contact.
#[derive(Clone, Copy, Default, clap::ValueEnum)]
enum Starts {
    /// The first contact lies along the undeflected whisker
    #[default]
    Honest,
    /// The same, and six further trials with a prior 4 to 5 mm off the true contact, scored as separate groups
    Wrong,
}

impl From<Starts> for testbed::evaluate::Starts {
    fn from(starts: Starts) -> Self {
        match starts {
            Starts::Honest => Self::Honest,
            Starts::Wrong => Self::Wrong,
        }
    }
}

/// Replay every trial of a suite or folder through the estimators and score them against the truth
#[derive(clap::Args)]
pub(super) struct Arguments {
    /// Suites (JSON) or folders of traces
    #[arg(required = true)]
    inputs: Vec<PathBuf>,
    /// Folder of the traces of the suites [default: datasets/<suite>]
    #[arg(long)]
    traces: Option<PathBuf>,
    /// Folder of the calibrations [default: calibrations/ beside the traces, calibrations/<front end>/ for a front end other than the default]
    #[arg(long)]
    calibrations: Option<PathBuf>,
    /// Estimators, separated by commas (`whisker list estimators`) [default: all]
    #[arg(long, value_delimiter = ',')]
    estimators: Option<Vec<String>>,
    /// External estimator, a program that reads samples and writes estimates as JSON lines (docs/your-estimator.md); may be repeated
    #[arg(long, value_name = "[NAME=]COMMAND")]
    exec: Vec<String>,
    /// Longest wait for one answer of an external estimator
    #[arg(long, value_name = "SECONDS", default_value = "10", value_parser = seconds)]
    exec_timeout: Duration,
    /// JSON file with settings by estimator, of the contact detection and of maps: {"ekf": {"fading": 1.01}, "touch": {"detector": "band-pass"}, "map": {"cell_m": 0.001}}
    #[arg(long)]
    config: Option<PathBuf>,
    #[command(flatten)]
    front_end: front_end::Arguments,
    /// Noise levels to add, as fractions of the largest reading of each set, separated by commas [default: 0.01; 0 for a front end with its
    /// own noise and for recordings]
    #[arg(long, value_delimiter = ',', value_parser = noise_fraction)]
    noise: Option<Vec<f64>>,
    /// Number of noise seeds per trial [default: 5; 1 if neither readings nor encoders are noisy]
    #[arg(long, value_parser = clap::value_parser!(u64).range(1..))]
    seeds: Option<u64>,
    /// Prior information on the first contact
    #[arg(long, value_enum, default_value_t)]
    starts: Starts,
    /// Joint encoders of an arm: '{"resolution_rad": 1e-5, "noise_rad": 1e-4}', or '{}' for perfect ones; may be repeated; applies to recordings
    /// with an arm [default: perfect]
    #[arg(long, value_name = "JSON", value_parser = encoders)]
    encoders: Vec<Encoders>,
    /// Name of the run [default: name of the suite or folder; several are joined by +]
    #[arg(long)]
    name: Option<String>,
    /// Parent folder of the run
    #[arg(long, default_value = "results")]
    results: PathBuf,
    /// Compute share K (1 to N) of N equal shares of the work; other processes compute the others, on this machine or on machines with the same
    /// file system, and the command without --share then merges the run
    #[arg(long, value_name = "K/N")]
    share: Option<Share>,
    /// Number of threads [default: number of cores]
    #[arg(long, value_parser = clap::value_parser!(u16).range(1..=1024))]
    threads: Option<u16>,
}

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<ExitCode> {
    let traces = arguments.traces.as_deref();
    let datasets: Vec<Dataset> =
        arguments.inputs.iter().map(|input| Dataset::open(input, traces)).collect::<anyhow::Result<_>>()?;
    let Config { touch, map, estimators: config } =
        arguments.config.as_deref().map(read_json).transpose()?.unwrap_or_default();
    let joined = || datasets.iter().map(|dataset| dataset.name.as_str()).collect::<Vec<_>>().join("+");
    let program = |text: &String| Program::new(text, arguments.exec_timeout);
    let choice = arguments.front_end.choice();
    let front_end = FrontEnd::new(&choice)?;
    let noise = match &arguments.noise {
        Some(levels) => levels.clone(),
        None => vec![default_noise(&datasets, &front_end)?],
    };
    // Without noise every seed replays the same readings, and the copies would count as trials.
    let are_exact = arguments.encoders.iter().all(Encoders::are_perfect);
    let is_silent = !front_end.is_noisy() && are_exact && noise.iter().all(|level| *level == 0.0);
    let seeds = if is_silent { 1 } else { DEFAULT_SEEDS };
    let settings = EvaluateSettings {
        name: arguments.name.clone().unwrap_or_else(joined),
        estimators: arguments.estimators.clone(),
        programs: arguments.exec.iter().map(program).collect::<anyhow::Result<_>>()?,
        config,
        front_end: choice,
        touch,
        starts: arguments.starts.into(),
        encoders: arguments.encoders.clone(),
        map,
        seeds: (1..=arguments.seeds.unwrap_or(seeds)).collect(),
        noise,
        calibrations: arguments.calibrations.clone(),
        results: arguments.results.clone(),
        on_start: Some(announce),
    };
    let threads = rayon::ThreadPoolBuilder::new()
        .num_threads(arguments.threads.map_or(0, usize::from))
        .build()
        .context("cannot start threads")?;
    let progress = progress_bar("evaluating");
    if let Some(share) = arguments.share {
        threads.install(|| evaluate_share(&datasets, &settings, share, &progress))?;
        progress.finish_and_clear();
        print(&format!("share {share} done\n"))?;
        return Ok(ExitCode::SUCCESS);
    }
    let evaluated = threads.install(|| evaluate(&datasets, &settings, &progress))?;
    progress.finish_and_clear();
    let state = if evaluated.is_new { "" } else { " (up to date)" };
    print(&format!("{}{}{state}\n", summary_table(&evaluated.summary), evaluated.folder.display()))?;
    for failure in &evaluated.failures {
        let estimator = failure.estimator.as_ref().map_or_else(String::new, |name| format!("{name} on "));
        let FailureRow { trace, noise, seed, reason, .. } = failure;
        eprintln!("failed: {estimator}{trace} at noise {noise}, seed {seed}: {reason}");
    }
    for OmittedEstimator { estimator, sensor_model, calibration } in &evaluated.omitted {
        let calibration = calibration.display();
        eprintln!("left out: {estimator}, which needs the sensor model `{sensor_model}` that {calibration} lacks");
    }
    if !evaluated.unscored.is_empty() {
        eprintln!("not scored, since their true contact is not known: {}", evaluated.unscored.join(", "));
    }
    Ok(if evaluated.failures.is_empty() { ExitCode::SUCCESS } else { ExitCode::from(FINISHED_WITH_FAILURES) })
}

/// Prints the amount of work and its expected duration to stderr, if the duration is known.
fn announce(workload: &Workload) {
    let Workload { trials, estimators, threads, duration } = workload;
    if let Some(duration) = duration {
        eprintln!("{trials} trials x {estimators} estimators on {threads} threads: {}", about(*duration));
    }
}

/// A duration in words, rounded.
fn about(duration: Duration) -> String {
    match duration.as_secs_f64() {
        seconds if seconds < 1.0 => "about a second".into(),
        seconds if seconds < 90.0 => format!("about {seconds:.0} s"),
        seconds if seconds < 5400.0 => format!("about {:.0} min", seconds / 60.0),
        seconds => format!("about {:.1} h", seconds / 3600.0),
    }
}

/// Parses joint encoders.
fn encoders(text: &str) -> Result<Encoders, String> {
    parse_json(text.as_bytes()).map_err(|error| error.to_string())
}

/// Parses a duration in seconds.
fn seconds(text: &str) -> Result<Duration, String> {
    match text.parse::<f64>() {
        Ok(value) if (0.001..=86_400.0).contains(&value) => Ok(Duration::from_secs_f64(value)),
        _ => Err("expected seconds, 0.001 to 86400, for example 10".into()),
    }
}

/// Largest default noise of the datasets.
fn default_noise(datasets: &[Dataset], front_end: &FrontEnd) -> anyhow::Result<f64> {
    datasets.iter().try_fold(0.0, |noise: f64, dataset| Ok(noise.max(dataset.default_noise(front_end)?)))
}

/// Contents of the file of settings.
#[derive(Default, Deserialize, Serialize)]
struct Config {
    #[serde(default)]
    touch: TouchConfig,
    #[serde(default)]
    map: MapConfig,
    #[serde(flatten)]
    estimators: BTreeMap<String, Value>,
}

/// Table of the summary, errors in millimetres.
fn summary_table(summary: &[SummaryRow]) -> String {
    let header = [
        "group",
        "whisker",
        "estimator",
        "noise",
        "trials",
        "RMSE, mm",
        "over bound",
        "95 %, mm",
        "worst, mm",
        "< 1 mm, s",
        "< 0.3 mm, s",
        "never < 1 mm",
        "NEES",
        "NIS",
        "in 95 %",
        "step, ns",
    ];
    let rows: Vec<Vec<String>> = summary
        .iter()
        .map(|row| {
            vec![
                row.head.group.clone(),
                row.head.whisker.clone(),
                row.head.estimator.clone(),
                format!("{} %", row.head.noise * 100.0),
                row.head.trials.to_string(),
                table::millimetres(row.get(&error::RMSE)),
                table::number(row.get(&bound::RATIO)),
                table::millimetres(row.get(&error::P95)),
                table::millimetres(row.get(&error::WORST)),
                table::number(row.get(&error::TIME_TO_1MM)),
                table::number(row.get(&error::TIME_TO_0P3MM)),
                table::percent(row.get(&error::NEVER_1MM)),
                table::number(row.get(&consistency::NEES)),
                table::number(row.get(&consistency::NIS)),
                table::percent(row.get(&consistency::COVERAGE)),
                format!("{:.0}", row.head.step_ns),
            ]
        })
        .collect();
    table::render(&header, &rows, 3)
}
