//! `whisker replay`: one trace through one estimator.

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::Context;
use serde_json::Value;
use trace::{CalibrationFile, Trace, write_atomically};
use whisker::estimators;
use whisker::events::TouchConfig;

use super::{front_end, json, noise_fraction, print};
use crate::dataset::calibrations;
use crate::evaluate::estimate_rows;
use crate::front_end::{FrontEnd, Mounting, Played};
use crate::metrics::Trial;
use crate::replay::{check_calibration, estimator, knowledge, noise_sd_n_m, read_by, replay, samples};
use crate::results::{RECOMMENDED, csv_bytes};
use crate::settings::merged;

/// Replay one trace through one estimator and write its estimates as CSV
#[derive(clap::Args)]
pub(super) struct Arguments {
    /// Trace (.csv, its sidecar beside it)
    trace: PathBuf,
    /// Estimator; `whisker list` names them
    #[arg(long, default_value = RECOMMENDED)]
    estimator: String,
    /// Settings of the estimator as JSON, for example '{"fading": 1.01}'
    #[arg(long, default_value = "{}", value_parser = json)]
    config: Value,
    /// Calibration of the whisker [default: calibrations/<whisker>.json beside the trace, calibrations/<front end>/ for a front end that is not the default]
    #[arg(long)]
    calibration: Option<PathBuf>,
    #[command(flatten)]
    front_end: front_end::Arguments,
    /// Measurement noise to add, as a fraction of the trace's largest reading [default: the front end's, 0.01 or 0 where it has its own; 0 to
    /// a recording, which has its own]
    #[arg(long, value_parser = noise_fraction)]
    noise: Option<f64>,
    /// Seed of that noise, and of the front end's
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// File to write [default: stdout]
    #[arg(long)]
    out: Option<PathBuf>,
}

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<ExitCode> {
    let trace = Trace::read(&arguments.trace)?;
    let sidecar = &trace.sidecar;
    let front_end = FrontEnd::new(&arguments.front_end.choice())?;
    front_end.check_trace(sidecar)?;
    let beside_trace = arguments.trace.parent().unwrap_or(Path::new(""));
    let folder = calibrations(beside_trace, front_end.row.name);
    let beside = || folder.join(format!("{}.json", sidecar.whisker.name));
    let path = arguments.calibration.clone().unwrap_or_else(beside);
    let calibration = CalibrationFile::read(&path)?;
    check_calibration(&path, &calibration, sidecar)?;
    let mounting = Mounting::of(beside_trace, sidecar)?;
    let sensor = front_end.sensor(&path, &calibration, &mounting)?;
    let row = estimators::estimator(&arguments.estimator).with_context(|| {
        let known: Vec<_> = estimators::ESTIMATORS.iter().map(|row| row.name).collect();
        format!("unknown estimator `{}`, expected one of: {}", arguments.estimator, known.join(", "))
    })?;
    let config = merged((row.defaults)(), &arguments.config)?;
    let largest = trace.recording.instants.iter().map(|i| i.moment_z_n_m.abs()).fold(0.0, f64::max);
    let noise = arguments.noise.unwrap_or_else(|| front_end.default_noise(sidecar));
    let beside: Vec<(Trace, Mounting)> = mounting
        .board
        .iter()
        .filter_map(|seat| seat.trace.as_ref().filter(|name| **name != sidecar.name))
        .map(|name| {
            let trace = Trace::read(&beside_trace.join(format!("{name}.csv")))?;
            let mounting = Mounting::of(beside_trace, &trace.sidecar)?;
            Ok((trace, mounting))
        })
        .collect::<anyhow::Result<_>>()?;
    let neighbours = beside.iter().map(|(trace, mounting)| {
        let sensor = front_end.sensor(&path, &calibration, mounting)?;
        Ok(Played { sensor, ..Played::new(trace, mounting, noise * largest, arguments.seed) })
    });
    let neighbours = neighbours.collect::<anyhow::Result<Vec<_>>>()?;
    let played = Played::new(&trace, &mounting, noise * largest, arguments.seed);
    let played = Played { sensor, neighbours: &neighbours, ..played };
    let noise_sd_n_m = noise_sd_n_m(played.noise_sd_n_m, sensor, sidecar);
    let faces = read_by(sensor, &calibration.calibrated(&path, row.sensor_model)?);
    let knowledge = knowledge(sidecar, &faces, noise_sd_n_m);
    let readings_n_m = front_end.readings_n_m(&played)?;
    let touch = TouchConfig::default();
    let mut estimator = estimator(row, &config, touch, &knowledge, &sidecar.name, arguments.seed)?;
    let samples = samples(&trace.recording, &readings_n_m);
    let replayed = replay(&mut estimator, &samples);
    let trial = Trial {
        trace: &trace,
        outline: None,
        knowledge: &knowledge,
        readings_n_m: &readings_n_m,
        events: None,
        bound: None,
    };
    let bytes = csv_bytes(&estimate_rows(&trial, &replayed.estimates))?;
    match &arguments.out {
        Some(path) => write_atomically(path, &bytes)?,
        None => print(&String::from_utf8(bytes)?)?,
    }
    Ok(ExitCode::SUCCESS)
}
