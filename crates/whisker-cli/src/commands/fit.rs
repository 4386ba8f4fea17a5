//! `whisker fit`: fit of sensor models to calibration traces.

use std::hint::black_box;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::Instant;

use anyhow::{Context, bail};
use evaluation::fit::{FitSettings, Models, fit};
use evaluation::space::fit::SpatialFitSettings;
use files::OutputLock;
use serde_json::Value;
use testbed::dataset::{CALIBRATIONS, Dataset};
use testbed::front_end::Mounting;
use trace::{CalibrationFile, is_plain_name};
use whisker::sensor::{AlongAway, Face, PinFriction};

use super::output::{check_is_folder, lies_in, reserve};
use super::progress::Progress;
use super::remarks::{NO_SENSOR, note_noise};
use super::space::fit_in_space;
use super::{front_end, json, noise_fraction, print, seed, table};

/// Argument of `--model` that selects the model by cross-validation.
const AUTO: &str = "auto";

/// Fit sensor models to the calibration traces of a suite or folder
#[derive(clap::Args)]
pub(super) struct Arguments {
    /// Suite (JSON) or folder of traces
    input: PathBuf,
    /// Folder of the suite's traces [default: datasets/<suite>]
    #[arg(long)]
    traces: Option<PathBuf>,
    /// Folder for the calibrations [default: calibrations/ beside the traces, calibrations/<front end>/ for a front end
    /// other than the default]
    #[arg(long)]
    out: Option<PathBuf>,
    /// Sensor model (`whisker list sensor-models`; for traces in space `space-sensor-models`); `auto` fits all that suit the traces
    /// and selects the one with the smallest error on held-out traces
    #[arg(long, default_value = AUTO)]
    model: String,
    /// Settings of the model as JSON, for example '{"degree": 7}' [default: those of `whisker list sensor-models`; for
    /// traces in space `space-sensor-models`]
    #[arg(long, value_parser = json::<Value>)]
    config: Option<Value>,
    #[command(flatten)]
    front_end: front_end::Arguments,
    /// Further sensors to calibrate, as array/sensor, separated by commas
    #[arg(long, value_delimiter = ',', value_parser = mounting)]
    sensors: Vec<Mounting>,
    /// Measurement noise added to simulated traces, as a fraction of the largest reading [default: the front end's]
    #[arg(long, value_parser = noise_fraction)]
    noise: Option<f64>,
    /// Seed of the measurement noise and of the front end
    #[arg(long, default_value_t = 1, value_parser = seed)]
    seed: u64,
}

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<ExitCode> {
    let dataset = Dataset::open(&arguments.input, arguments.traces.as_deref())?;
    let models = match (arguments.model.as_str(), &arguments.config) {
        (AUTO, None) => Models::Auto,
        (AUTO, Some(_)) => bail!("--config: found settings without a model; name the model with --model"),
        (kind, config) => {
            let config = config.clone().unwrap_or_else(|| Value::Object(Default::default()));
            Models::One { kind: kind.into(), config }
        }
    };
    let choice = arguments.front_end.choice();
    if dataset.is_spatial()? {
        return in_space(arguments, &dataset, models);
    }
    let front_end = arguments.front_end.in_plane()?;
    if !arguments.sensors.is_empty() && !front_end.has_sensor() {
        bail!(
            "--sensors: found with the front end `{}`, which has no sensor to calibrate, expected with one that has, for example \
            --front-end hall",
            front_end.row.name
        );
    }
    let settings = FitSettings {
        models,
        noise: arguments.noise.unwrap_or(front_end.row.noise),
        seed: arguments.seed,
        front_end: choice,
        sensors: arguments.sensors.clone(),
    };
    let (out, _lock) = reserved(arguments, &dataset, front_end.row.name)?;
    let fitted = fit(&dataset, &settings, &out, &Progress::of("fitting"))?;
    for reason in fitted.iter().flat_map(|whisker| &whisker.left_out) {
        eprintln!("left out: {reason}");
    }
    for (trace, gated, rows) in fitted.iter().flat_map(|whisker| &whisker.gated) {
        eprintln!("gated: {gated} of {rows} readings of {trace}, far above all others");
    }
    for reason in fitted.iter().flat_map(|whisker| &whisker.no_sensor) {
        eprintln!("{NO_SENSOR}: {reason}");
    }
    for CalibrationFile { whisker, noise_fraction, sensor, traces, .. } in fitted.iter().map(|of| &of.calibration) {
        note_noise(arguments.noise, *noise_fraction, &whisker.name);
        if sensor.is_some() && traces.len() == 1 {
            eprintln!(
                "note: whisker `{}`: fitted to a single recording, parts of which are held out; the error on another recording may be \
                larger",
                whisker.name
            );
        }
    }
    let mut rows = Vec::new();
    for whisker in &fitted {
        for face in &whisker.calibration.faces {
            if let Some(PinFriction { coefficient, coefficient_sd }) = face.friction {
                let (whisker, face) = (&whisker.calibration.whisker.name, face.face.name());
                eprintln!(
                    "friction removed from the readings of whisker `{whisker}`, face {face}: coefficient {coefficient:.3} +- \
                    {coefficient_sd:.3}"
                );
            }
            let best = face.model(None).map_or(f64::NAN, |model| model.heldout_rms_n_m);
            for model in &face.models {
                let share = |reading: f64| {
                    let percent = 100.0 * reading / face.largest_reading_n_m;
                    if percent < 1e3 { format!("{percent:.4} %") } else { format!("{percent:.1e} %") }
                };
                let is_chosen = model.label == face.chosen;
                rows.push(vec![
                    whisker.calibration.whisker.name.clone(),
                    face.face.name().into(),
                    model.label.clone(),
                    share(model.heldout_rms_n_m),
                    share(model.heldout_worst_n_m),
                    format!("{:.0}", evaluation_ns(&whisker.calibration, &whisker.path, &model.label, face.face)?),
                    if is_chosen {
                        "chosen".into()
                    } else {
                        format!("{} x", table::number(Some(model.heldout_rms_n_m / best)))
                    },
                ]);
            }
        }
    }
    let header = ["whisker", "face", "model", "held-out RMS", "held-out worst", "ns per call", "error"];
    print(&table::render(&header, &rows, 3))?;
    for whisker in &fitted {
        let state = if whisker.is_new { "" } else { " (up to date)" };
        print(&format!("{}{state}\n", whisker.path.display()))?;
    }
    Ok(ExitCode::SUCCESS)
}

/// Fit of traces in space.
fn in_space(arguments: &Arguments, dataset: &Dataset, models: Models) -> anyhow::Result<ExitCode> {
    if !arguments.sensors.is_empty() {
        bail!("--sensors: does not apply to traces in space, each of whose whiskers has a sensor of its own");
    }
    let choice = arguments.front_end.choice();
    let front_end = arguments.front_end.in_space()?;
    let noise = arguments.noise.unwrap_or(front_end.row.noise);
    let settings = SpatialFitSettings { models, noise, seed: arguments.seed, front_end: choice };
    let (out, _lock) = reserved(arguments, dataset, front_end.row.name)?;
    fit_in_space(dataset, &settings, arguments.noise, &out)
}

/// The folder of the calibrations, and its lock.
fn reserved(arguments: &Arguments, dataset: &Dataset, front_end: &str) -> anyhow::Result<(PathBuf, OutputLock)> {
    let out = arguments.out.clone().unwrap_or_else(|| dataset.calibrations(front_end));
    check_is_folder(&out)?;
    // The calibrations lie beside the traces, in a folder of their own.
    let is_own = lies_in(&out, &dataset.folder.join(CALIBRATIONS))?;
    let inputs = if is_own { Vec::new() } else { vec![dataset.input.clone(), dataset.folder.clone()] };
    let lock = reserve(&out, &inputs)?;
    Ok((out, lock))
}

/// Parses a sensor as array/sensor.
fn mounting(text: &str) -> Result<Mounting, String> {
    let names = text.split_once('/').filter(|(array, sensor)| is_plain_name(array) && is_plain_name(sensor));
    let (array, sensor) = names.ok_or("expected array/sensor, for example left/left_1")?;
    Ok(Mounting::single(array, sensor))
}

/// Wall-clock time of one prediction with its gradient (ns): mean over a grid of the calibrated domain, minimum over rounds.
fn evaluation_ns(calibration: &CalibrationFile, path: &Path, label: &str, face: Face) -> anyhow::Result<f64> {
    const ROUNDS: usize = 5;
    const ALONG: usize = 64;
    const AWAY: usize = 32;
    let faces = calibration.calibrated(path, Some(label))?;
    let face = faces.iter().find(|known| known.face == face).context("the face is in the file")?;
    let (low, high) = face.domain.arc_range_m();
    let mut contacts = Vec::with_capacity(ALONG * AWAY);
    for i in 0..ALONG {
        let arc_m = low + (high - low) * i as f64 / (ALONG - 1) as f64;
        let (lower, upper) = face.domain.away_range_m(arc_m);
        let away_m = |j: usize| lower + (upper - lower) * j as f64 / (AWAY - 1) as f64;
        contacts.extend((0..AWAY).map(|j| face.contact_at(AlongAway::new(arc_m, away_m(j)))));
    }
    let round = || {
        let start = Instant::now();
        for &contact in &contacts {
            black_box(face.model.predict(black_box(contact)));
        }
        start.elapsed().as_secs_f64() * 1e9 / contacts.len() as f64
    };
    Ok((0..ROUNDS).map(|_| round()).fold(f64::INFINITY, f64::min))
}
