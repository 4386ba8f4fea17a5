//! JSON lines on stdin. Each whisker has a thread of its own, so that a new touch, whose first step takes long, delays no other.

use std::io::{self, BufRead, BufReader, Read};
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, sync_channel};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};

use anyhow::{Context, bail};
use live::wire::{self, BadLine, Line, PriorLine, SampleLine};
use live::{Counters, LiveEstimator, Output, Timing};
use serde_json::Value;
use strict_json::one_line;
use testbed::participant::PROTOCOL;
use testbed::replay::method;
use trace::CalibrationFile;
use whisker::estimators::{Estimator, EstimatorRow, Knowledge, MethodClass, Runner};
use whisker::events::TouchConfig;

use super::sink::Sink;
use super::{Arguments, named};
use crate::commands::played::read_calibration;

/// Longest line in bytes: the first line of an evaluation contains tables of the sensor model.
const LONGEST_LINE: u64 = 1 << 23;

/// Lines that are read ahead.
const AHEAD: usize = 1 << 12;

/// Longest wait for a line, and so the delay of an interrupt.
const NAP: Duration = Duration::from_millis(50);

/// Longest wait of a whisker without a waiting reading.
const IDLE: Duration = Duration::from_secs(1);

/// Smallest and largest sampling rate (Hz).
const RATES_HZ: [f64; 2] = [1e-3, 1e6];

/// Largest standard deviation of the noise.
const MOST_NOISE_N_M: f64 = 1e6;

/// A line and its arrival.
struct Arrival {
    /// Bytes without the line end. An error if it is too long.
    line: Result<Vec<u8>, io::Error>,
    at: Instant,
}

/// A whisker of the options, and its thread once its first line has arrived.
struct Whisker {
    name: Option<String>,
    path: PathBuf,
    calibration: CalibrationFile,
    worker: Option<Worker>,
}

/// Thread that runs the estimator of a whisker.
struct Worker {
    samples: SyncSender<(SampleLine, f64)>,
    thread: JoinHandle<anyhow::Result<Counters>>,
}

/// Whiskers with one estimator.
struct Session {
    whiskers: Vec<Whisker>,
    row: &'static EstimatorRow,
    config: Value,
    timing: Timing,
    sink: Arc<Mutex<Sink>>,
    origin: Instant,
    lines: u64,
}

pub(super) fn run(arguments: &Arguments, timing: Timing, stop: &AtomicBool) -> anyhow::Result<ExitCode> {
    let (row, config) = arguments.played.method.registered()?;
    let whiskers = whiskers(&arguments.calibration)?;
    let origin = Instant::now();
    let sink = Arc::new(Mutex::new(Sink::new(origin, 1.0)));
    let mut session = Session { whiskers, row, config, timing, sink, origin, lines: 0 };
    let (sender, lines) = sync_channel(AHEAD);
    thread::Builder::new().name("stdin".into()).spawn(move || read(&sender)).context("thread of stdin")?;
    let served = session.serve(&lines, stop);
    let counts = session.end_workers()?;
    served?;
    Ok(locked(&session.sink).finish(&counts))
}

/// Reads the calibrations and checks that the names are distinct.
fn whiskers(options: &[String]) -> anyhow::Result<Vec<Whisker>> {
    let mut whiskers: Vec<Whisker> = Vec::new();
    for option in options {
        let (name, path) = named(option);
        if options.len() > 1 && name.is_none() {
            bail!("--calibration: found `{option}` among several, expected NAME={option}");
        }
        if whiskers.iter().any(|whisker| whisker.name.as_deref() == name) {
            bail!("--calibration: found the name `{}` twice, expected each once", name.unwrap_or_default());
        }
        let beside_trace = path.parent().and_then(Path::parent).unwrap_or(Path::new(""));
        let calibration = read_calibration(&path, beside_trace)?;
        whiskers.push(Whisker { name: name.map(Into::into), path, calibration, worker: None });
    }
    Ok(whiskers)
}

/// Reads stdin and sends its lines until its end.
fn read(lines: &SyncSender<Arrival>) {
    let mut stdin = BufReader::new(io::stdin().lock());
    loop {
        let mut line = Vec::new();
        let read = stdin.by_ref().take(LONGEST_LINE + 1).read_until(b'\n', &mut line);
        let at = Instant::now();
        let is_last = read.as_ref().map_or(true, |count| *count == 0);
        let line = match read {
            Ok(0) => return,
            Ok(_) if line.len() as u64 > LONGEST_LINE && line.last() != Some(&b'\n') => {
                let skipped = stdin.skip_until(b'\n').map(drop);
                let long = format!("found more than {LONGEST_LINE} bytes, expected a line of at most that length");
                Err(skipped.err().unwrap_or_else(|| io::Error::new(io::ErrorKind::InvalidData, long)))
            }
            Ok(_) => Ok(line),
            Err(error) => Err(error),
        };
        // The session has ended if nobody receives.
        if lines.send(Arrival { line, at }).is_err() || is_last {
            return;
        }
    }
}

/// Exclusive use of the sink.
fn locked(sink: &Mutex<Sink>) -> MutexGuard<'_, Sink> {
    sink.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Runs the estimator of a whisker on its samples with their arrivals, until their sender is gone. Returns the counts.
fn work(
    mut estimator: LiveEstimator,
    name: Option<&str>,
    samples: &Receiver<(SampleLine, f64)>,
    origin: Instant,
    sink: &Mutex<Sink>,
) -> anyhow::Result<Counters> {
    let mut out = Output::default();
    loop {
        let now_s = origin.elapsed().as_secs_f64();
        let wait = estimator.deadline_s().map_or(IDLE, |due_s| Duration::from_secs_f64((due_s - now_s).max(0.0)));
        let sample = samples.recv_timeout(wait);
        let at_s = match &sample {
            Ok((_, at_s)) => *at_s,
            Err(RecvTimeoutError::Timeout) => origin.elapsed().as_secs_f64(),
            Err(RecvTimeoutError::Disconnected) => break,
        };
        while let Some(due_s) = estimator.deadline_s().filter(|due_s| *due_s <= at_s) {
            estimator.poll(due_s, &mut out);
        }
        if let Ok((sample, _)) = sample {
            if let Some(base) = sample.base {
                estimator.pose(sample.t_s, base, at_s, &mut out)?;
            }
            if let Some(reading_n_m) = sample.reading_n_m {
                estimator.reading(sample.t_s, reading_n_m, at_s, &mut out)?;
            }
        }
        if !(out.answers.is_empty() && out.events.is_empty()) {
            locked(sink).take(name, &mut out)?;
        }
    }
    estimator.finish(&mut out);
    locked(sink).take(name, &mut out)?;
    Ok(*estimator.counters())
}

impl Session {
    /// Processes lines until their end or until `stop` is set.
    fn serve(&mut self, lines: &Receiver<Arrival>, stop: &AtomicBool) -> anyhow::Result<()> {
        while !stop.load(Ordering::Relaxed) {
            match lines.recv_timeout(NAP) {
                Ok(arrival) => {
                    let at_s = arrival.at.duration_since(self.origin).as_secs_f64();
                    self.line(arrival.line, at_s)?;
                }
                Err(RecvTimeoutError::Timeout) => {}
                Err(RecvTimeoutError::Disconnected) => break,
            }
        }
        Ok(())
    }

    /// Ends the threads of the whiskers. Returns names and counts.
    ///
    /// # Errors
    /// The error of the first that failed.
    fn end_workers(&mut self) -> anyhow::Result<Vec<(Option<String>, Counters)>> {
        let mut ended = Vec::new();
        for whisker in &mut self.whiskers {
            if let Some(Worker { samples, thread }) = whisker.worker.take() {
                drop(samples);
                ended.push((whisker.name.clone(), thread.join().expect("the thread does not panic")));
            }
        }
        ended.into_iter().map(|(name, counts)| Ok((name, counts?))).collect()
    }

    fn line(&mut self, line: io::Result<Vec<u8>>, at_s: f64) -> anyhow::Result<()> {
        self.lines += 1;
        let parsed = match line.map(String::from_utf8) {
            Ok(Ok(text)) => wire::parse(text.trim_end_matches(['\n', '\r'])),
            Ok(Err(error)) => {
                let column = Some(error.utf8_error().valid_up_to() + 1);
                Err(BadLine {
                    column,
                    reason: "found bytes that are no UTF-8, expected UTF-8".into(),
                    is_not_finite: false,
                })
            }
            Err(error) if error.kind() == io::ErrorKind::InvalidData => {
                Err(BadLine { column: None, reason: error.to_string(), is_not_finite: false })
            }
            Err(error) => return Err(error).context("stdin"),
        };
        let taken = match parsed {
            Ok(Line::Prior(prior)) => return self.begin(&prior).with_context(|| format!("stdin: line {}", self.lines)),
            Ok(Line::Sample(sample)) => self.sample(sample, at_s)?,
            Err(bad) => Err(bad),
        };
        let Err(bad) = taken else { return Ok(()) };
        let kind =
            if bad.is_not_finite { "lines with a value that is not finite" } else { "lines that are no messages" };
        locked(&self.sink).refuse(kind, &format!("stdin: line {}, {bad}", self.lines))
    }

    /// Passes a reading, a pose or both to the thread of the whisker.
    fn sample(&mut self, sample: SampleLine, at_s: f64) -> anyhow::Result<Result<(), BadLine>> {
        let bad = |reason: String| Ok(Err(BadLine { column: None, reason, is_not_finite: false }));
        let Some(place) = self.place_of(sample.name.as_deref()) else {
            return bad(self.unknown(sample.name.as_deref()));
        };
        let Some(worker) = &self.whiskers[place].worker else {
            return bad("found a reading or a pose, expected the whisker's first line before it (docs/LIVE.md)".into());
        };
        if worker.samples.send((sample, at_s)).is_err() {
            self.end_workers()?;
        }
        Ok(Ok(()))
    }

    fn place_of(&self, name: Option<&str>) -> Option<usize> {
        self.whiskers.iter().position(|whisker| whisker.name.as_deref() == name)
    }

    fn unknown(&self, name: Option<&str>) -> String {
        let known: Vec<_> = self.whiskers.iter().map(|whisker| whisker.name.as_deref().unwrap_or("none")).collect();
        let found = name.map_or_else(|| "no name".into(), |name| format!("the name `{}`", one_line(name)));
        format!("found {found}, expected one of those of --calibration: {}", known.join(", "))
    }

    /// Begins the estimation of a whisker.
    fn begin(&mut self, prior: &PriorLine) -> anyhow::Result<()> {
        let name = prior.name.as_deref();
        let Some(place) = self.place_of(name) else { bail!("name: {}", self.unknown(name)) };
        let whisker = &mut self.whiskers[place];
        if whisker.worker.is_some() {
            bail!("found a second first line of a whisker, expected one");
        }
        let knowledge = whisker.knowledge(prior, self.row)?;
        let (row, config, seed) = (self.row, self.config.clone(), prior.seed.unwrap_or_default());
        let of_build = knowledge.clone();
        let build = move || {
            let method = method(row, &config, &of_build)?;
            Ok(Estimator::new(Runner::new(method, of_build.clone(), seed), TouchConfig::default()))
        };
        let looks_back = row.class == MethodClass::Hindsight;
        let estimator = LiveEstimator::new(Box::new(build), &knowledge, looks_back, self.timing)?;
        let (samples, received) = sync_channel(AHEAD);
        let (name, origin, sink) = (whisker.name.clone(), self.origin, self.sink.clone());
        let works = move || work(estimator, name.as_deref(), &received, origin, &sink);
        let thread = thread::Builder::new().name("whisker".into()).spawn(works).context("thread of a whisker")?;
        whisker.worker = Some(Worker { samples, thread });
        Ok(())
    }
}

impl Whisker {
    /// Prior information of the estimator.
    fn knowledge(&self, prior: &PriorLine, row: &EstimatorRow) -> anyhow::Result<Arc<Knowledge>> {
        if prior.protocol != PROTOCOL {
            bail!("protocol: found {}, expected {PROTOCOL}", prior.protocol);
        }
        let [least, most] = RATES_HZ;
        if !(least..=most).contains(&prior.rate_hz) {
            bail!("rate_hz: found {}, expected {least} to {most}", prior.rate_hz);
        }
        if !(0.0..=MOST_NOISE_N_M).contains(&prior.noise_sd_n_m) {
            bail!("noise_sd_n_m: found {}, expected 0 to {MOST_NOISE_N_M}", prior.noise_sd_n_m);
        }
        let whisker = &self.calibration.whisker;
        if prior.whisker.as_ref().is_some_and(|stated| stated != whisker) {
            bail!("whisker: found other parameters than those of {}, expected the same", self.path.display());
        }
        let expected = |key: &str, expected: String| anyhow::anyhow!("{key}: found other numbers, expected {expected}");
        let base_noise = prior.base_noise.map(|of| of.base_noise().map_err(|form| expected("base_noise", form)));
        let contact_prior = prior.told.map(|of| of.contact_prior().map_err(|form| expected("told", form)));
        Ok(Arc::new(Knowledge {
            whisker: whisker.clone(),
            rest: whisker.rest_shape(),
            faces: self.calibration.calibrated(&self.path, row.sensor_model)?,
            noise_sd_n_m: prior.noise_sd_n_m,
            base_noise: base_noise.transpose()?.unwrap_or_default(),
            rate_hz: prior.rate_hz,
            contact_prior: contact_prior.transpose()?,
        }))
    }
}
