//! `whisker replay`: one trace through one estimator.

use std::io::{self, IsTerminal, Write};
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use files::{AtomicFile, check_replaces_own};
use testbed::front_end::Reader;
use testbed::replay::Steps;
use testbed::results::{EstimateRow, Table, csv_bytes, estimate_row};
use trace::{Instant, TraceRows, TruthInstant, is_spatial};
use whisker::estimators::{Estimate, Estimator, Knowledge};
use whisker::events::Signals;
use whisker::sensor::Face;

use super::output::{begins_with, files_of_trace, reserve};
use super::played::{self, check_trace};
use super::progress::Progress;
use super::remarks::{few_estimates, note_rate};
use super::space::replay_in_space;

/// Replay one trace through one estimator and write its estimates as CSV
#[derive(clap::Args)]
pub(super) struct Arguments {
    /// Trace (.csv, its sidecar beside it)
    trace: PathBuf,
    #[command(flatten)]
    played: played::Arguments,
    /// Calibration of the whisker [default: calibrations/<whisker>.json beside the trace, calibrations/<front
    /// end>/<whisker>.json for a front end other than the default]
    #[arg(long)]
    calibration: Option<PathBuf>,
    /// Replay a planar trace through an estimator in space, with --calibration in space of the same whisker; the moment out of the
    /// plane is zero but for noise
    #[arg(long, requires = "calibration")]
    space: bool,
    /// File to write [default: stdout]
    #[arg(long)]
    out: Option<PathBuf>,
}

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<ExitCode> {
    arguments.played.in_file(replay(arguments))
}

fn replay(arguments: &Arguments) -> anyhow::Result<ExitCode> {
    check_trace(&arguments.trace)?;
    if arguments.space || is_spatial(&arguments.trace)? {
        let Arguments { trace, played, calibration, out, .. } = arguments;
        return replay_in_space(trace, &played.in_space()?, calibration.as_deref(), out.as_deref());
    }
    let found = arguments.played.find(&arguments.trace, arguments.calibration.as_deref())?;
    let _lock = match &arguments.out {
        Some(out) => {
            let inputs = files_of_trace(&found.path, &found.sidecar).into_iter().chain([found.calibration.clone()]);
            let lock = reserve(out, &inputs.collect::<Vec<_>>())?;
            let header = csv_bytes::<EstimateRow>(&[])?;
            check_replaces_own(out, "a table of estimates", |path| begins_with(path, &header))?;
            Some(lock)
        }
        None => None,
    };
    let played = arguments.played.prepare(found)?;
    let replay = Streamed {
        rows: TraceRows::of(&played.sidecar, &played.path)?,
        estimator: played.build()()?,
        looks_back: played.looks_back(),
        knowledge: &played.knowledge,
        reader: played.reader,
        tally: Tally::default(),
        progress: progress(arguments, played.sidecar.rows),
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
    for note in tally.notes(&played.knowledge, &played.calibration) {
        eprintln!("{note}");
    }
    note_rate(&played.sidecar.name, played.rate.as_ref());
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
        let calibration = &calibration.display().to_string();
        if self.estimates == 0 {
            notes.push(format!("no estimates: {}", self.reason(knowledge, calibration)));
        } else if self.calibrated == 0 {
            notes.push(format!(
                "no calibrated estimates: all {} lie outside the contacts of {calibration}; calibrate where the \
                whisker is touched, or compare frames and units by `whisker check`",
                self.estimates
            ));
        } else if let Some(remark) = few_estimates(self.touched.iter().sum(), self.estimates, calibration) {
            notes.extend(self.lacking(knowledge, calibration).or(Some(remark)));
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
                "no touch was detected in {} rows: the detector's signal reached {:.2e} N m, its threshold is \
                {threshold_n_m:.2e} N m",
                self.rows,
                watched_n_m.abs()
            );
        }
        let lacking = self.lacking(knowledge, calibration);
        lacking.unwrap_or_else(|| format!("{touched} rows are in contact, but the estimator gave no estimate"))
    }

    /// States that a face which touches is not calibrated. `None` if all are.
    fn lacking(&self, knowledge: &Knowledge, calibration: &str) -> Option<String> {
        let touching = [Face::Left, Face::Right].into_iter().zip(self.touched);
        let (face, count) =
            touching.filter(|(_, count)| *count > 0).find(|(face, _)| knowledge.face(*face).is_none())?;
        let face = face.name();
        Some(format!(
            "{count} rows touch with the face `{face}`, which {calibration} does not calibrate; calibrate it, or correct the sign of \
             the moment"
        ))
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
