//! `whisker evaluate`: every estimator on every trial.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::{ExitCode, exit};
use std::sync::atomic::Ordering;
use std::thread::{self, sleep};
use std::time::Duration;

use anyhow::{Context, anyhow, bail, ensure};
use evaluation::evaluate::{
    EvaluateSettings, Evaluated, OmittedEstimator, Share, Workload, evaluate, evaluate_share, run_folder,
};
use evaluation::participant::{Program, end_programs};
use files::read_json;
use platform::interrupt;
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use serde_json::Value;
use testbed::dataset::Dataset;
use testbed::encoders::Encoders;
use testbed::front_end::FrontEnd;
use testbed::map::MapConfig;
use testbed::metrics::{bound, consistency, error};
use testbed::noise::NoiseUnit;
use testbed::results::SummaryRow;
use trace::Miscalibration;
use whisker::events::{FORMER_NAMES, TouchConfig};

use super::output::{check_apart, lies_in, reserve_folder};
use super::progress::Progress;
use super::remarks::conclusion;
use super::space::{Evaluation, evaluate_in_space};
use super::{front_end, in_file, is_literal, json, noise_fraction, print, table, trimmed};

/// Default number of noise seeds per trial.
const DEFAULT_SEEDS: u64 = 5;

/// Largest number of noise seeds per trial: each is a replay of every trial by every estimator.
const MOST_SEEDS: u64 = 1_000_000;

/// Polling interval of interrupts.
const TICK: Duration = Duration::from_millis(20);

/// Exit code of an interrupted evaluation, that of shells for SIGINT.
const INTERRUPTED: i32 = 130;

/// Prior information on the first contact.
#[derive(Clone, Copy, Default, clap::ValueEnum)]
enum Starts {
    /// The first contact lies along the undeflected whisker
    #[default]
    #[value(alias = "honest")]
    Undeflected,
    /// The same, and six further trials with a prior 4 to 5 mm off the true contact, scored as separate groups
    Wrong,
}

impl From<Starts> for evaluation::evaluate::Starts {
    fn from(starts: Starts) -> Self {
        match starts {
            Starts::Undeflected => Self::Undeflected,
            Starts::Wrong => Self::Wrong,
        }
    }
}

/// Unit of noise levels.
#[derive(Clone, Copy, clap::ValueEnum)]
enum Unit {
    /// Largest reading of each set
    Set,
    /// Largest calibrated reading of the face that touches
    Range,
    /// Newton metre
    NewtonMetre,
    /// Noise that each trace states
    Stated,
}

impl From<Unit> for NoiseUnit {
    fn from(unit: Unit) -> Self {
        match unit {
            Unit::Set => Self::Set,
            Unit::Range => Self::Range,
            Unit::NewtonMetre => Self::NewtonMetre,
            Unit::Stated => Self::Stated,
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
    /// Folder of the calibrations [default: calibrations/ beside the traces, calibrations/<front end>/ for a front end
    /// other than the default]
    #[arg(long)]
    calibrations: Option<PathBuf>,
    /// Estimators, separated by commas (`whisker list estimators`; for traces in space `space-estimators`) [default: all]
    #[arg(long, value_delimiter = ',', value_parser = trimmed)]
    estimators: Option<Vec<String>>,
    /// External estimator, a program that reads samples and writes estimates as JSON lines (docs/your-estimator.md);
    /// may be repeated
    #[arg(long, value_name = "[NAME=]COMMAND")]
    exec: Vec<String>,
    /// Longest wait for one answer of an external estimator
    #[arg(long, value_name = "SECONDS", default_value = "10", value_parser = seconds)]
    exec_timeout: Duration,
    /// Settings by estimator, of the contact detection and of maps, as JSON or as a JSON file: '{"ekf": {"fading": 1.01},
    /// "touch": {"detector": "band-pass"}, "map": {"cell_m": 0.001}}' [default: those of `whisker list estimators` and
    /// `detectors`; for traces in space `space-estimators`]
    #[arg(long, value_name = "JSON or FILE")]
    config: Option<String>,
    #[command(flatten)]
    front_end: front_end::Arguments,
    /// Noise levels to add in the unit of --noise-unit, separated by commas [default: 0.01; 0 for a front end with its
    /// own noise and for recordings; 1, that is the stated noise, for traces that state theirs]
    #[arg(long, value_delimiter = ',', value_parser = noise_fraction)]
    noise: Option<Vec<f64>>,
    /// Unit of the noise levels [default: set, or stated for traces that state their noise]
    #[arg(long, value_enum, requires = "noise")]
    noise_unit: Option<Unit>,
    /// Deviations of sensor, whisker and mounting from the calibration: '{"gain": 0.01, "mount_rad": 0.008}', or '{}'
    /// for none; keys are gain, offset, drift_per_s, stiffness, mount_rad, mount_x_m, mount_y_m, latency_s; may be
    /// repeated [default: those that each trace states]
    #[arg(long, value_name = "JSON", value_parser = json::<Miscalibration>)]
    miscalibrate: Vec<Miscalibration>,
    /// Number of noise seeds per trial, at most a million [default: 5; 1 if neither readings nor encoders are noisy]
    #[arg(long, value_parser = seeds)]
    seeds: Option<u64>,
    /// Prior information on the first contact
    #[arg(long, value_enum, default_value_t)]
    starts: Starts,
    /// Joint encoders of an arm: '{"resolution_rad": 1e-5, "noise_rad": 1e-4}', or '{}' for perfect ones; may be
    /// repeated; applies to recordings with an arm [default: perfect]
    #[arg(long, value_name = "JSON", value_parser = json::<Encoders>)]
    encoders: Vec<Encoders>,
    /// Name of the run [default: name of the suite or folder; several are joined by +]
    #[arg(long)]
    name: Option<String>,
    /// Parent folder of the run
    #[arg(long, default_value = "results")]
    results: PathBuf,
    /// Replace a finished run of the same name that has other settings, or external programs; a run of registered estimators with
    /// the same inputs is up to date and stays
    #[arg(long)]
    force: bool,
    /// Compute share K (1 to N) of N equal shares of the work; other processes compute the others, on this machine or
    /// on machines with the same file system, and the command without --share then merges the run
    #[arg(long, value_name = "K/N")]
    share: Option<Share>,
    /// Number of threads [default: number of cores]
    #[arg(long, value_parser = clap::value_parser!(u16).range(1..=1024))]
    threads: Option<u16>,
}

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<ExitCode> {
    in_file(config_file(arguments), evaluate_all(arguments))
}

fn evaluate_all(arguments: &Arguments) -> anyhow::Result<ExitCode> {
    let traces = arguments.traces.as_deref();
    let datasets: Vec<Dataset> =
        arguments.inputs.iter().map(|input| Dataset::open(input, traces)).collect::<anyhow::Result<_>>()?;
    let Config { touch, map, estimators: config } = configured(arguments)?.unwrap_or_default();
    note_former_names(arguments)?;
    let joined = || datasets.iter().map(|dataset| dataset.name.as_str()).collect::<Vec<_>>().join("+");
    let program = |text: &String| Program::new(text, arguments.exec_timeout);
    let programs: Vec<Program> = arguments.exec.iter().map(program).collect::<anyhow::Result<_>>()?;
    if !programs.is_empty() {
        end_programs_with_this()?;
    }
    let choice = arguments.front_end.choice();
    if datasets.iter().map(Dataset::is_spatial).collect::<anyhow::Result<Vec<_>>>()?.contains(&true) {
        let of_plane = [("touch", touch.is_some()), ("map", map.is_some())];
        if let Some((key, _)) = of_plane.into_iter().find(|(_, is_given)| *is_given) {
            bail!(
                "{}: {key}: found settings that do not apply to traces in space, expected those of estimators",
                config_source(arguments)
            );
        }
        return in_space(arguments, &datasets, config, programs);
    }
    let front_end = arguments.front_end.in_plane()?;
    let (noise, noise_unit) = match &arguments.noise {
        Some(levels) => (levels.clone(), arguments.noise_unit.map_or_else(NoiseUnit::default, Into::into)),
        None if states_noise(&datasets, &front_end)? => (vec![1.0], NoiseUnit::Stated),
        None => (vec![Dataset::default_noise(&datasets, &front_end)?], NoiseUnit::Set),
    };
    // Without noise every seed replays the same readings, and the copies would count as trials.
    let are_exact = arguments.encoders.iter().all(Encoders::are_perfect);
    let silent = noise.iter().filter(|level| !front_end.has_sensor() && are_exact && **level == 0.0).count();
    let seeds = arguments.seeds.unwrap_or(if silent == noise.len() { 1 } else { DEFAULT_SEEDS });
    ensure!(
        silent == 0 || silent == noise.len() || seeds == 1,
        "--noise: found 0 beside other levels with {seeds} seeds, expected 0 alone or --seeds 1: without noise every seed gives the \
         same readings"
    );
    let settings = EvaluateSettings {
        name: arguments.name.clone().unwrap_or_else(joined),
        estimators: arguments.estimators.clone(),
        programs,
        config,
        front_end: choice,
        touch: touch.unwrap_or_default(),
        starts: arguments.starts.into(),
        encoders: arguments.encoders.clone(),
        map: map.unwrap_or_default(),
        seeds: (1..=seeds).collect(),
        noise,
        noise_unit,
        miscalibrations: arguments.miscalibrate.clone(),
        calibrations: arguments.calibrations.clone(),
        results: arguments.results.clone(),
        force: arguments.force,
        on_start: Some(announce),
    };
    let folder = settings.folder()?;
    let inputs = inputs(arguments, &datasets);
    check_run_folder(&folder, &inputs, &datasets)?;
    let threads = rayon::ThreadPoolBuilder::new()
        .num_threads(arguments.threads.map_or(0, usize::from))
        .build()
        .context("cannot start threads")?;
    let progress = Progress::of("evaluating");
    if let Some(share) = arguments.share {
        threads.install(|| evaluate_share(&datasets, &settings, share, &progress))?;
        drop(progress);
        print(&format!("share {share} done\n"))?;
        return Ok(ExitCode::SUCCESS);
    }
    let _lock = reserve_folder(&folder, &inputs)?;
    let is_there = folder.join("run.json").is_file();
    let evaluated = threads.install(|| evaluate(&datasets, &settings, &progress))?;
    drop(progress);
    if is_there && evaluated.is_new {
        eprintln!("{}: replaced the former run", folder.display());
    }
    conclude(&evaluated, noise_unit)
}

/// Evaluation of traces in space.
fn in_space(
    arguments: &Arguments,
    datasets: &[Dataset],
    config: BTreeMap<String, Value>,
    programs: Vec<Program>,
) -> anyhow::Result<ExitCode> {
    let choice = arguments.front_end.choice();
    let front_end = arguments.front_end.in_space()?;
    let [dataset] = datasets else {
        bail!("found {} inputs, expected one suite or folder of traces in space", datasets.len())
    };
    let noise = match arguments.noise.as_deref() {
        None => dataset.default_noise_in_space(&front_end)?,
        Some([noise]) => *noise,
        Some(levels) => bail!("--noise: found {} levels, expected one for traces in space", levels.len()),
    };
    let options = [
        ("--miscalibrate", !arguments.miscalibrate.is_empty()),
        ("--encoders", !arguments.encoders.is_empty()),
        ("--share", arguments.share.is_some()),
        ("--noise-unit", arguments.noise_unit.is_some_and(|unit| !matches!(unit, Unit::Set))),
        ("--starts", matches!(arguments.starts, Starts::Wrong)),
    ];
    if let Some((option, _)) = options.into_iter().find(|(_, is_given)| *is_given) {
        bail!(
            "{option}: does not apply to traces in space; their noise is relative to each set, or that of a front end, and a run \
             is computed by one process"
        );
    }
    let folder = run_folder(&arguments.results, arguments.name.as_ref().unwrap_or(&dataset.name))?;
    let inputs = inputs(arguments, datasets);
    check_run_folder(&folder, &inputs, datasets)?;
    let _lock = reserve_folder(&folder, &inputs)?;
    let evaluation = Evaluation {
        estimators: arguments.estimators.clone(),
        config,
        noise,
        seeds: arguments.seeds.unwrap_or(if noise > 0.0 || front_end.is_noisy() { DEFAULT_SEEDS } else { 1 }),
        front_end: choice,
        calibrations: arguments.calibrations.clone(),
        programs,
        force: arguments.force,
    };
    let threads = rayon::ThreadPoolBuilder::new()
        .num_threads(arguments.threads.map_or(0, usize::from))
        .build()
        .context("cannot start threads")?;
    threads.install(|| evaluate_in_space(dataset, evaluation, &folder))
}

/// Ends the external programs if an interrupt ends the evaluation.
fn end_programs_with_this() -> anyhow::Result<()> {
    let asked = interrupt::asked()?;
    let waits = move || {
        while !asked.load(Ordering::Relaxed) {
            sleep(TICK);
        }
        end_programs();
        exit(INTERRUPTED);
    };
    thread::Builder::new().name("end of programs".into()).spawn(waits).context("cannot start threads")?;
    Ok(())
}

/// Prints the summary to stdout, and failures and omissions to stderr. Returns the exit code.
fn conclude(evaluated: &Evaluated, noise_unit: NoiseUnit) -> anyhow::Result<ExitCode> {
    let state = if evaluated.is_new { "" } else { " (up to date)" };
    print(&format!("{}{}{state}\n", summary_table(&evaluated.summary, noise_unit), evaluated.folder.display()))?;
    let code = conclusion(&evaluated.failures);
    for OmittedEstimator { estimator, sensor_model, calibration } in &evaluated.omitted {
        let calibration = calibration.display();
        eprintln!("left out: {estimator}, which needs the sensor model `{sensor_model}` that {calibration} lacks");
    }
    for (trace, gated, rows) in &evaluated.gated {
        eprintln!("gated: {gated} of {rows} readings of {trace}, beyond the largest plausible one");
    }
    if !evaluated.unscored.is_empty() {
        eprintln!("not scored, since their true contact is not known: {}", evaluated.unscored.join(", "));
    }
    evaluated.remarks.lines().iter().for_each(|remark| eprintln!("note: {remark}"));
    Ok(code)
}

/// File of the settings. `None` if there are none, or they are given literally.
fn config_file(arguments: &Arguments) -> Option<&Path> {
    arguments.config.as_deref().filter(|text| !is_literal(text)).map(Path::new)
}

/// Where the settings come from, for messages.
fn config_source(arguments: &Arguments) -> String {
    config_file(arguments).map_or_else(|| "--config".into(), |path| path.display().to_string())
}

/// The settings, if there are any.
fn configured<T: DeserializeOwned + Serialize>(arguments: &Arguments) -> anyhow::Result<Option<T>> {
    let Some(text) = &arguments.config else { return Ok(None) };
    match config_file(arguments) {
        Some(path) => Ok(Some(read_json(path)?)),
        None => Ok(Some(json(text).map_err(|error| anyhow!("--config: {error}"))?)),
    }
}

/// Prints a note for each setting of contact detection that is stated under its former name.
fn note_former_names(arguments: &Arguments) -> anyhow::Result<()> {
    let settings: Option<Value> = configured(arguments)?;
    let Some(touch) = settings.as_ref().and_then(|all| all.get("touch")?.as_object()) else { return Ok(()) };
    for (former, present) in FORMER_NAMES {
        if touch.contains_key(former) || touch.get("detector").is_some_and(|name| name == former) {
            eprintln!("{}: `{former}` is the former name of `{present}`", config_source(arguments));
        }
    }
    Ok(())
}

/// Checks that the folder of a run is none of the inputs, and that neither contains the other.
fn check_run_folder(folder: &Path, inputs: &[PathBuf], datasets: &[Dataset]) -> anyhow::Result<()> {
    check_apart(folder, inputs)?;
    for dataset in datasets {
        if lies_in(&dataset.folder, folder)? {
            let (traces, run) = (dataset.folder.display(), folder.display());
            bail!("{traces}: lies in {run}, which the run would replace; give another --name or --results");
        }
    }
    Ok(())
}

/// Files and folders that the evaluation reads.
fn inputs(arguments: &Arguments, datasets: &[Dataset]) -> Vec<PathBuf> {
    let of_datasets = datasets.iter().flat_map(|dataset| [dataset.input.clone(), dataset.folder.clone()]);
    of_datasets.chain(arguments.calibrations.clone()).chain(config_file(arguments).map(Path::to_owned)).collect()
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

/// Parses a number of seeds.
fn seeds(text: &str) -> Result<u64, String> {
    match text.parse::<u64>() {
        Ok(count) if (1..=MOST_SEEDS).contains(&count) => Ok(count),
        _ => Err(format!("expected 1 to {MOST_SEEDS}, since every seed replays every trial through every estimator")),
    }
}

/// Parses a duration in seconds.
fn seconds(text: &str) -> Result<Duration, String> {
    match text.parse::<f64>() {
        Ok(value) if (0.001..=86_400.0).contains(&value) => Ok(Duration::from_secs_f64(value)),
        _ => Err("expected seconds, 0.001 to 86400, for example 10".into()),
    }
}

/// Whether every trial states the noise that is to be added to it, and the front end has none of its own.
fn states_noise(datasets: &[Dataset], front_end: &FrontEnd) -> anyhow::Result<bool> {
    datasets.iter().try_fold(!front_end.has_sensor(), |stated, dataset| Ok(stated && dataset.states_noise()?))
}

/// Contents of the file of settings.
#[derive(Default, Deserialize, Serialize)]
struct Config {
    #[serde(default, skip_serializing_if = "Option::is_none")]
    touch: Option<TouchConfig>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    map: Option<MapConfig>,
    #[serde(flatten)]
    estimators: BTreeMap<String, Value>,
}

/// Table of the summary, errors in millimetres.
fn summary_table(summary: &[SummaryRow], noise_unit: NoiseUnit) -> String {
    let header = [
        "group",
        "whisker",
        "estimator",
        "noise",
        "trials",
        "RMSE, mm",
        "mean, mm",
        "90 %, mm",
        "> 0.5 mm",
        "answered",
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
                format!("{} {}", noise_unit.printed(row.head.noise), noise_unit.symbol()),
                row.head.trials.to_string(),
                table::millimetres(row.get(&error::RMSE)),
                table::millimetres(row.head.rmse_mean_m),
                table::millimetres(row.head.rmse_p90_m),
                table::percent(Some(row.head.above_0p5mm)),
                table::percent(row.get(&error::ANSWERED)),
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
