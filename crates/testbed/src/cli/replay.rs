//! `whisker replay`: one trace through one estimator.

use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::Context;
use serde_json::Value;
use trace::{CalibrationFile, Trace, write_atomically};
use whisker::estimators;
use whisker::touch::TouchConfig;

use super::{json, noise_fraction, print};
use crate::evaluate::estimate_rows;
use crate::front_end::FrontEnd;
use crate::metrics::Trial;
use crate::replay::{check_calibration, estimator, knowledge, replay, samples};
use crate::results::csv_bytes;
use crate::settings::merged;

/// Replay one trace through one estimator and write its estimates as CSV
#[derive(clap::Args)]
pub(super) struct Arguments {
    /// Trace (.csv, its sidecar beside it)
    trace: PathBuf,
    /// Estimator; `whisker list` names them
    #[arg(long, default_value = "ukf")]
    estimator: String,
    /// Settings of the estimator as JSON, for example '{"fading": 1.01}'
    #[arg(long, default_value = "{}", value_parser = json)]
    config: Value,
    /// Calibration of the whisker [default: calibrations/<whisker>.json beside the trace]
    #[arg(long)]
    calibration: Option<PathBuf>,
    /// Measurement noise, as a fraction of the trace's largest reading
    #[arg(long, default_value = "0.01", value_parser = noise_fraction)]
    noise: f64,
    /// Seed of that noise
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// File to write [default: stdout]
    #[arg(long)]
    out: Option<PathBuf>,
}

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<ExitCode> {
    let trace = Trace::read(&arguments.trace)?;
    let sidecar = &trace.sidecar;
    let beside = || arguments.trace.with_file_name("calibrations").join(format!("{}.json", sidecar.whisker.name));
    let path = arguments.calibration.clone().unwrap_or_else(beside);
    let calibration = CalibrationFile::read(&path)?;
    check_calibration(&path, &calibration, sidecar)?;
    let row = estimators::estimator(&arguments.estimator).with_context(|| {
        let known: Vec<_> = estimators::ESTIMATORS.iter().map(|row| row.name).collect();
        format!("unknown estimator `{}`, expected one of: {}", arguments.estimator, known.join(", "))
    })?;
    let config = merged((row.defaults)(), &arguments.config)?;
    let largest = trace.recording.instants.iter().map(|i| i.moment_z_n_m.abs()).fold(0.0, f64::max);
    let front_end = FrontEnd { noise_sd_n_m: arguments.noise * largest, seed: arguments.seed };
    let knowledge = knowledge(&sidecar.whisker, &calibration.calibrated(&path)?, front_end.noise_sd_n_m);
    let readings_n_m = front_end.readings_n_m(&sidecar.name, &trace.recording);
    let mut estimator = estimator(row, &config, TouchConfig::default(), &knowledge, &sidecar.name, arguments.seed)?;
    let replayed = replay(&mut estimator, &samples(&trace.recording, &readings_n_m));
    let trial = Trial {
        trace: &trace,
        outline: None,
        knowledge: &knowledge,
        readings_n_m: &readings_n_m,
        noise: arguments.noise,
        seed: arguments.seed,
    };
    let bytes = csv_bytes(&estimate_rows(&trial, &replayed.estimates))?;
    match &arguments.out {
        Some(path) => write_atomically(path, &bytes)?,
        None => print(&String::from_utf8(bytes)?)?,
    }
    Ok(ExitCode::SUCCESS)
}
