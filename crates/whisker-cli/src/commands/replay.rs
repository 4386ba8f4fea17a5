//! `whisker replay`: one trace through one estimator.

use std::io::{self, IsTerminal, Write};
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::{Context, bail};
use files::AtomicFile;
use serde_json::Value;
use testbed::dataset::calibrations;
use testbed::evaluate::estimate_row;
use testbed::fitted_traces::check_fitted_traces;
use testbed::front_end::{FrontEnd, Mounting, Reader, Reading};
use testbed::replay::{Steps, check_calibration, estimator, knowledge, noise_sd_n_m, read_by};
use testbed::results::{EstimateRow, RECOMMENDED, Table, csv_bytes};
use testbed::settings::merged;
use trace::{CalibrationFile, Instant, Trace, TraceRows, TruthInstant};
use whisker::estimators::{self, Estimate, Estimator, Knowledge, MethodClass};
use whisker::events::{Signals, TouchConfig};
use whisker::sensor::Face;

use super::output::{begins_with, check_replaces_own, files_of_trace, reserve};
use super::progress::Progress;
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
    /// Calibration of the whisker
    /// [default: calibrations/<whisker>.json beside the trace, calibrations/<front end>/<whisker>.json for a front end other than the default]
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
    check_trace(&arguments.trace)?;
    let (sidecar, rows) = TraceRows::open(&arguments.trace)?;
    let front_end = FrontEnd::new(&arguments.front_end.choice())?;
    front_end.check_trace(&sidecar)?;
    let beside_trace = arguments.trace.parent().unwrap_or(Path::new(""));
    let folder = calibrations(beside_trace, front_end.row.name);
    let beside = || folder.join(format!("{}.json", sidecar.whisker.name));
    let path = arguments.calibration.clone().unwrap_or_else(beside);
    let _lock = match &arguments.out {
        Some(out) => {
            let inputs = files_of_trace(&arguments.trace, &sidecar).into_iter().chain([path.clone()]);
            let lock = reserve(out, &inputs.collect::<Vec<_>>())?;
            let header = csv_bytes::<EstimateRow>(&[])?;
            check_replaces_own(out, "a table of estimates", |path| begins_with(path, &header))?;
            Some(lock)
        }
        None => None,
    };
    let calibration = read_calibration(&path, beside_trace)?;
    check_calibration(&path, &calibration, &sidecar)?;
    let mounting = Mounting::of(beside_trace, &sidecar)?;
    let sensor = front_end.sensor(&path, &calibration, &mounting)?;
    let row = estimators::estimator(&arguments.estimator).with_context(|| {
        let known: Vec<_> = estimators::ESTIMATORS.iter().map(|row| row.name).collect();
        format!("unknown estimator `{}`, expected one of: {}", arguments.estimator, known.join(", "))
    })?;
    let config = merged((row.defaults)(), &arguments.config)?;
    let faces = read_by(sensor, &calibration.calibrated(&path, row.sensor_model)?);
    let gate = calibration.gate();
    // The first pass checks the whole trace, so that no output is written for a damaged one.
    let mut largest: f64 = 0.0;
    for row in rows {
        let moment_n_m = row?.0.moment_z_n_m;
        if gate.admits(moment_n_m) {
            largest = largest.max(moment_n_m.abs());
        }
    }
    let noise = arguments.noise.unwrap_or_else(|| front_end.default_noise(&sidecar));
    let added_sd_n_m = noise * largest;
    let reader = match front_end.reader(&sidecar, added_sd_n_m, arguments.seed) {
        Some(reader) => reader,
        None => {
            let reading = Reading {
                front_end: &front_end,
                path: &path,
                calibration: &calibration,
                added_sd_n_m,
                seed: arguments.seed,
            };
            let mut readings_n_m = reading.of(&Trace::read(&arguments.trace)?, &mounting, beside_trace)?.into_iter();
            Box::new(move |_: &Instant| readings_n_m.next().expect("there is a reading an instant"))
        }
    };
    let knowledge = knowledge(&sidecar, &faces, noise_sd_n_m(added_sd_n_m, sensor, &sidecar));
    let replay = Streamed {
        rows: TraceRows::of(&sidecar, &arguments.trace)?,
        reader,
        estimator: estimator(row, &config, TouchConfig::default(), &knowledge, &sidecar.name, arguments.seed)?,
        looks_back: row.class == MethodClass::Hindsight,
        knowledge: &knowledge,
        tally: Tally::default(),
        progress: progress(arguments, sidecar.rows),
    };
    let tally = match &arguments.out {
        Some(path) => {
            let (file, tally) = replay.write(AtomicFile::create(path)?)?;
            file.finish()?;
            tally
        }
        None => {
            let (mut stdout, tally) = replay.write(io::stdout().lock())?;
            stdout.flush()?;
            tally
        }
    };
    for note in tally.notes(&knowledge, &path) {
        eprintln!("{note}");
    }
    Ok(ExitCode::SUCCESS)
}

/// Progress of a replay. `None` if the table itself is written to the terminal.
fn progress(arguments: &Arguments, rows: usize) -> Option<Progress> {
    if arguments.out.is_none() && io::stdout().is_terminal() {
        return None;
    }
    let progress = Progress::of("replaying");
    progress.set_length(rows as u64);
    Some(progress)
}

/// Checks that there is a trace.
fn check_trace(path: &Path) -> anyhow::Result<()> {
    if path.is_dir() {
        bail!("{}: is a folder, expected one of its traces (.csv)", path.display());
    }
    for file in ["csv", "json"].map(|extension| path.with_extension(extension)) {
        if !file.is_file() {
            bail!(
                "{}: no such file, expected a trace: a .csv with its .json beside it, as `whisker simulate ... --out DIR` writes them into DIR",
                file.display()
            );
        }
    }
    Ok(())
}

/// Reads a calibration whose traces have not changed since the fit.
fn read_calibration(path: &Path, beside_trace: &Path) -> anyhow::Result<CalibrationFile> {
    if !path.is_file() {
        bail!(
            "{}: no such calibration; make it by `whisker fit {}`, with the same --front-end, or name another by --calibration",
            path.display(),
            if beside_trace.as_os_str().is_empty() { Path::new(".") } else { beside_trace }.display()
        );
    }
    let calibration = CalibrationFile::read(path)?;
    check_fitted_traces(path, &calibration)?;
    Ok(calibration)
}

/// Counts of a replay, from which the reason for a missing result follows.
#[derive(Clone, Copy, Debug, Default)]
struct Tally {
    rows: u64,
    gated: u64,
    estimates: u64,
    /// Estimates inside the calibrated domain.
    calibrated: u64,
    /// Rows in contact by face: left, right.
    touched: [u64; 2],
    /// Signals of the free whisker that came closest to the threshold of a touch.
    nearest: Signals,
}

impl Tally {
    fn count(&mut self, signals: Signals) {
        self.rows += 1;
        let share = |signals: &Signals| signals.watched_n_m.abs() / signals.threshold_n_m;
        match signals.touched {
            Some(Face::Left) => self.touched[0] += 1,
            Some(Face::Right) => self.touched[1] += 1,
            None if share(&signals) > share(&self.nearest) || self.nearest.threshold_n_m == 0.0 => {
                self.nearest = signals;
            }
            None => {}
        }
    }

    /// Number of gated readings, and the reason if there is no estimate or none in the calibrated domain.
    fn notes(&self, knowledge: &Knowledge, calibration: &Path) -> Vec<String> {
        let (rows, most_n_m) = (self.rows, knowledge.gate().most_n_m());
        let mut notes = Vec::new();
        if self.gated > 0 {
            notes.push(format!(
                "gated: {} of {rows} readings, beyond the largest plausible one, {most_n_m:.2e} N m",
                self.gated
            ));
        }
        let calibration = calibration.display();
        if self.estimates == 0 {
            notes.push(format!("no estimates: {}", self.reason(knowledge, &calibration.to_string())));
        } else if self.calibrated == 0 {
            notes.push(format!(
                "no calibrated estimates: all {} lie outside the contacts of {calibration}; calibrate where the whisker is touched, or compare frames and units by `whisker check`",
                self.estimates
            ));
        }
        notes
    }

    fn reason(&self, knowledge: &Knowledge, calibration: &str) -> String {
        if self.gated == self.rows {
            return "every reading was gated; `whisker check` compares its unit with the whisker".into();
        }
        let touched: u64 = self.touched.iter().sum();
        if touched == 0 {
            let Signals { watched_n_m, threshold_n_m, .. } = self.nearest;
            return format!(
                "no touch was detected in {} rows: the detector's signal reached {:.2e} N m, its threshold is {threshold_n_m:.2e} N m",
                self.rows,
                watched_n_m.abs()
            );
        }
        let lacks = |face: &Face| knowledge.face(*face).is_none();
        for (face, count) in [Face::Left, Face::Right].into_iter().zip(self.touched) {
            if count > 0 && lacks(&face) {
                let face = face.name();
                return format!(
                    "{count} rows touch with the face `{face}`, which {calibration} does not calibrate; calibrate it, or correct the sign of the moment"
                );
            }
        }
        format!("{touched} rows are in contact, but the estimator gave no estimate")
    }
}

/// A replay in constant memory: it holds the current row, and for a hindsight method the current contact.
struct Streamed<'a> {
    rows: TraceRows,
    reader: Reader,
    estimator: Estimator,
    looks_back: bool,
    knowledge: &'a Knowledge,
    tally: Tally,
    progress: Option<Progress>,
}

/// Rows between two updates of the progress bar.
const ROWS_PER_UPDATE: u64 = 1000;

impl Streamed<'_> {
    /// Writes the estimates. Returns the writer and the counts.
    fn write<To: Write>(mut self, to: To) -> anyhow::Result<(To, Tally)> {
        let mut table = Table::<EstimateRow, To>::new(to)?;
        let mut steps = Steps::default();
        let (mut seen, mut estimates) = (Vec::new(), Vec::new());
        let (mut given, mut calibrated) = (0, 0);
        let mut state = |seen: &mut Vec<(Instant, TruthInstant, f64)>, estimates: &mut Vec<Option<Estimate>>| {
            seen.drain(..).zip(estimates.drain(..)).try_for_each(|((known, truth, reading_n_m), estimate)| {
                given += u64::from(estimate.is_some());
                calibrated += u64::from(estimate.is_some_and(|estimate| estimate.calibrated));
                table.push(&estimate_row(self.knowledge, &known, &truth, reading_n_m, estimate.as_ref()))
            })
        };
        for row in self.rows {
            let (known, truth) = row?;
            let reading_n_m = (self.reader)(&known);
            self.estimator.push(&steps.sample(&known, reading_n_m), &mut estimates);
            self.tally.count(self.estimator.signals());
            if self.tally.rows.is_multiple_of(ROWS_PER_UPDATE) {
                self.progress.iter().for_each(|progress| progress.set_position(self.tally.rows));
            }
            seen.push((known, truth, reading_n_m));
            if !(self.looks_back && self.estimator.is_following()) {
                state(&mut seen, &mut estimates)?;
            }
        }
        self.estimator.end(&mut estimates);
        state(&mut seen, &mut estimates)?;
        drop(self.progress);
        let tally = Tally { gated: self.estimator.gated(), estimates: given, calibrated, ..self.tally };
        Ok((table.finish()?, tally))
    }
}
