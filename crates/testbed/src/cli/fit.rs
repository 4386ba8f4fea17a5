//! `whisker fit`: calibration traces to calibration files.

use std::path::PathBuf;
use std::process::ExitCode;

use serde_json::Value;
use whisker::sensor;

use super::{json, noise_fraction, print, table};
use crate::dataset::Dataset;
use crate::fit::{FitSettings, fit};

/// Fit sensor models to the calibration traces of a suite or folder
#[derive(clap::Args)]
pub(super) struct Arguments {
    /// Suite (JSON) or folder of traces
    input: PathBuf,
    /// Folder of the suite's traces [default: datasets/<suite>]
    #[arg(long)]
    traces: Option<PathBuf>,
    /// Folder for the calibrations [default: calibrations/ beside the traces]
    #[arg(long)]
    out: Option<PathBuf>,
    /// Sensor model; `whisker list` names them
    #[arg(long, default_value = sensor::MODELS[0].kind)]
    model: String,
    /// Settings of the model as JSON, for example '{"degree": 7}'
    #[arg(long, default_value = "{}", value_parser = json)]
    config: Value,
    /// Measurement noise, as a fraction of the largest reading
    #[arg(long, default_value = "0.01", value_parser = noise_fraction)]
    noise: f64,
    /// Seed of that noise
    #[arg(long, default_value_t = 1)]
    seed: u64,
}

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<ExitCode> {
    let dataset = Dataset::open(&arguments.input, arguments.traces.as_deref())?;
    let settings = FitSettings {
        model: arguments.model.clone(),
        config: arguments.config.clone(),
        noise: arguments.noise,
        seed: arguments.seed,
    };
    let out = arguments.out.clone().unwrap_or_else(|| dataset.calibrations());
    let fitted = fit(&dataset, &settings, &out)?;
    let mut rows = Vec::new();
    for whisker in &fitted {
        for face in &whisker.calibration.faces {
            let share = |reading: f64| format!("{:.3} %", 100.0 * reading / face.largest_reading_n_m);
            rows.push(vec![
                whisker.calibration.whisker.name.clone(),
                face.face.name().into(),
                face.samples.to_string(),
                format!("{:.2}", face.largest_reading_n_m * 1e6),
                share(face.heldout_rms_n_m),
                share(face.heldout_worst_n_m),
                whisker.path.display().to_string() + if whisker.is_new { "" } else { " (up to date)" },
            ]);
        }
    }
    let header = ["whisker", "face", "samples", "largest, uN m", "held-out RMS", "held-out worst", "file"];
    print(&table::render(&header, &rows, 2))?;
    Ok(ExitCode::SUCCESS)
}
