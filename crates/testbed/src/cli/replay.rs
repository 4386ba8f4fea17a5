//! `whisker replay`: one trace through one estimator.

use std::io::{self, Write};
use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::Arc;

use anyhow::{Context, bail};
use trace::{CalibrationFile, Trace, write_atomically};
use whisker::estimators::{self, Estimator, Knowledge};
use whisker::touch::TouchConfig;

use super::noise_fraction;
use crate::evaluate::estimate_rows;
use crate::front_end::{FrontEnd, derived_seed};
use crate::metrics::Trial;
use crate::replay::{replay, samples};
use crate::results::csv_bytes;

/// Replay one trace through one estimator and write its estimates as CSV
#[derive(clap::Args)]
pub(super) struct Arguments {
    /// Trace (.csv, its sidecar beside it)
    trace: PathBuf,
    /// Estimator; `whisker list` names them
    #[arg(long, default_value = "ukf")]
    estimator: String,
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
    let whisker = &trace.sidecar.whisker;
    let path = arguments
        .calibration
        .clone()
        .unwrap_or_else(|| arguments.trace.with_file_name("calibrations").join(format!("{}.json", whisker.name)));
    let calibration = CalibrationFile::read(&path)?;
    if calibration.whisker != *whisker {
        bail!("{}: calibrates a whisker with other parameters than the trace's", path.display());
    }
    let row = estimators::estimator(&arguments.estimator).with_context(|| {
        let known: Vec<_> = estimators::ESTIMATORS.iter().map(|row| row.name).collect();
        format!("unknown estimator `{}`, expected one of: {}", arguments.estimator, known.join(", "))
    })?;
    let largest = trace.recording.instants.iter().map(|i| i.moment_z_n_m.abs()).fold(0.0, f64::max);
    let front_end = FrontEnd { noise_sd_n_m: arguments.noise * largest, seed: arguments.seed };
    let knowledge = Arc::new(Knowledge {
        whisker: whisker.clone(),
        rest: whisker.rest_shape(),
        faces: calibration.calibrated(&path)?,
        noise_sd_n_m: front_end.noise_sd_n_m,
    });
    let readings_n_m = front_end.readings_n_m(&trace.sidecar.name, &trace.recording);
    let seed = derived_seed(arguments.seed, &[row.name, &trace.sidecar.name]);
    let method = (row.build)(&(row.defaults)(), &knowledge)?;
    let mut estimator = Estimator::new(method, knowledge.clone(), TouchConfig::default(), seed);
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
        None => io::stdout().write_all(&bytes)?,
    }
    Ok(ExitCode::SUCCESS)
}
