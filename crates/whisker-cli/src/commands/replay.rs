//! `whisker replay`: one trace through one estimator.

use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::Context;
use files::AtomicFile;
use serde_json::Value;
use testbed::dataset::calibrations;
use testbed::evaluate::estimate_row;
use testbed::front_end::{FrontEnd, Mounting, Reader, SensorInput};
use testbed::replay::{Steps, check_calibration, estimator, knowledge, noise_sd_n_m, read_by};
use testbed::results::{EstimateRow, RECOMMENDED, Table};
use testbed::settings::merged;
use trace::{CalibrationFile, Instant, Trace, TraceRows, TruthInstant};
use whisker::estimators::{self, Estimate, Estimator, Knowledge, MethodClass};
use whisker::events::TouchConfig;

use super::{front_end, json, noise_fraction};

/// Replay one trace through one estimator and write its estimates as CSV
#[derive(clap::Args)]
pub(super) struct Arguments {
    /// Trace (.csv, its sidecar beside it)
    trace: PathBuf,
    /// Estimator (`whisker list estimators`)
    #[arg(long, default_value = RECOMMENDED)]
    estimator: String,
    /// Settings of the estimator as JSON, for example '{"fading": 1.01}'
    #[arg(long, default_value = "{}", value_parser = json)]
    config: Value,
    /// Calibration of the whisker [default: calibrations/<whisker>.json beside the trace, calibrations/<front end>/<whisker>.json for a front end other than the default]
    #[arg(long)]
    calibration: Option<PathBuf>,
    #[command(flatten)]
    front_end: front_end::Arguments,
    /// Measurement noise to add, as a fraction of the trace's largest reading [default: 0.01; 0 for a front end with its own noise and for a recording]
    #[arg(long, value_parser = noise_fraction)]
    noise: Option<f64>,
    /// Seed of the measurement noise and of the front end
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// File to write [default: stdout]
    #[arg(long)]
    out: Option<PathBuf>,
}

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<ExitCode> {
    let (sidecar, rows) = TraceRows::open(&arguments.trace)?;
    let front_end = FrontEnd::new(&arguments.front_end.choice())?;
    front_end.check_trace(&sidecar)?;
    let beside_trace = arguments.trace.parent().unwrap_or(Path::new(""));
    let folder = calibrations(beside_trace, front_end.row.name);
    let beside = || folder.join(format!("{}.json", sidecar.whisker.name));
    let path = arguments.calibration.clone().unwrap_or_else(beside);
    let calibration = CalibrationFile::read(&path)?;
    check_calibration(&path, &calibration, &sidecar)?;
    let mounting = Mounting::of(beside_trace, &sidecar)?;
    let sensor = front_end.sensor(&path, &calibration, &mounting)?;
    let row = estimators::estimator(&arguments.estimator).with_context(|| {
        let known: Vec<_> = estimators::ESTIMATORS.iter().map(|row| row.name).collect();
        format!("unknown estimator `{}`, expected one of: {}", arguments.estimator, known.join(", "))
    })?;
    let config = merged((row.defaults)(), &arguments.config)?;
    // The first pass checks the whole trace, so that nothing is written for a damaged one.
    let mut largest: f64 = 0.0;
    for row in rows {
        largest = largest.max(row?.0.moment_z_n_m.abs());
    }
    let noise = arguments.noise.unwrap_or_else(|| front_end.default_noise(&sidecar));
    let added_sd_n_m = noise * largest;
    let reader = match front_end.reader(&sidecar, added_sd_n_m, arguments.seed) {
        Some(reader) => reader,
        None => {
            let beside =
                mounting.board.iter().filter_map(|seat| seat.trace.as_ref().filter(|name| **name != sidecar.name));
            let beside: Vec<(Trace, Mounting)> = beside
                .map(|name| {
                    let trace = Trace::read(&beside_trace.join(format!("{name}.csv")))?;
                    let mounting = Mounting::of(beside_trace, &trace.sidecar)?;
                    Ok((trace, mounting))
                })
                .collect::<anyhow::Result<_>>()?;
            let neighbours = beside.iter().map(|(trace, mounting)| {
                let sensor = front_end.sensor(&path, &calibration, mounting)?;
                Ok(SensorInput { sensor, ..SensorInput::new(trace, mounting, added_sd_n_m, arguments.seed) })
            });
            let neighbours = neighbours.collect::<anyhow::Result<Vec<_>>>()?;
            let trace = Trace::read(&arguments.trace)?;
            let played = SensorInput::new(&trace, &mounting, added_sd_n_m, arguments.seed);
            let readings_n_m = front_end.readings_n_m(&SensorInput { sensor, neighbours: &neighbours, ..played })?;
            let mut readings_n_m = readings_n_m.into_iter();
            Box::new(move |_: &Instant| readings_n_m.next().expect("there is a reading an instant"))
        }
    };
    let faces = read_by(sensor, &calibration.calibrated(&path, row.sensor_model)?);
    let knowledge = knowledge(&sidecar, &faces, noise_sd_n_m(added_sd_n_m, sensor, &sidecar));
    let replay = Streamed {
        rows: TraceRows::of(&sidecar, &arguments.trace)?,
        reader,
        estimator: estimator(row, &config, TouchConfig::default(), &knowledge, &sidecar.name, arguments.seed)?,
        looks_back: row.class == MethodClass::Hindsight,
        knowledge: &knowledge,
    };
    match &arguments.out {
        Some(path) => replay.write(AtomicFile::create(path)?)?.finish()?,
        None => replay.write(io::stdout().lock())?.flush()?,
    }
    Ok(ExitCode::SUCCESS)
}

/// A replay in constant memory: it holds the current row, and for a hindsight method the current contact.
struct Streamed<'a> {
    rows: TraceRows,
    reader: Reader,
    estimator: Estimator,
    looks_back: bool,
    knowledge: &'a Knowledge,
}

impl Streamed<'_> {
    /// Writes the estimates and returns the writer.
    fn write<To: Write>(mut self, to: To) -> anyhow::Result<To> {
        let mut table = Table::<EstimateRow, To>::new(to)?;
        let mut steps = Steps::default();
        let (mut seen, mut estimates) = (Vec::new(), Vec::new());
        let mut state = |seen: &mut Vec<(Instant, TruthInstant, f64)>, estimates: &mut Vec<Option<Estimate>>| {
            seen.drain(..).zip(estimates.drain(..)).try_for_each(|((known, truth, reading_n_m), estimate)| {
                table.push(&estimate_row(self.knowledge, &known, &truth, reading_n_m, estimate.as_ref()))
            })
        };
        for row in self.rows {
            let (known, truth) = row?;
            let reading_n_m = (self.reader)(&known);
            self.estimator.push(&steps.sample(&known, reading_n_m), &mut estimates);
            seen.push((known, truth, reading_n_m));
            if !(self.looks_back && self.estimator.is_following()) {
                state(&mut seen, &mut estimates)?;
            }
        }
        self.estimator.end(&mut estimates);
        state(&mut seen, &mut estimates)?;
        table.finish()
    }
}
