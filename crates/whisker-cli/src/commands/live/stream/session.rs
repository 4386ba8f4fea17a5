//! The whiskers of a stream: each line goes to the thread of its whisker.

use std::io;
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, sync_channel};
use std::sync::{Arc, Mutex};
use std::thread;
use std::time::{Duration, Instant};

use anyhow::{Context, bail};
use live::wire::{BadLine, Line, SampleLine, Written};
use live::{Counters, Timing};
use strict_json::one_line;

use super::AHEAD;
use super::method::{Answered, Method, SampleOf};
use super::stdin::Arrival;
use super::worker::{Sample, Worker, locked, work};
use crate::commands::live::sink::Sink;

/// Longest wait for a line, and so the delay of an interrupt.
const NAP: Duration = Duration::from_millis(50);

/// A whisker of the options, and its thread once its first line has arrived.
pub(super) struct Whisker<T: Method> {
    pub(super) name: Option<String>,
    pub(super) path: PathBuf,
    /// Shared by all whiskers with this path.
    pub(super) calibration: Arc<T::Calibration>,
    pub(super) worker: Option<Worker<T>>,
}

/// Whiskers with one estimator.
pub(super) struct Session<T: Method> {
    pub(super) whiskers: Vec<Whisker<T>>,
    pub(super) method: T,
    pub(super) timing: Timing,
    pub(super) sink: Arc<Mutex<Sink>>,
    pub(super) origin: Instant,
    pub(super) lines: u64,
}

impl<T: Method> Session<T>
where
    Answered<T::Kind>: Written,
{
    /// Processes lines until their end or until `stop` is set.
    pub(super) fn serve(&mut self, lines: &Receiver<Arrival>, stop: &AtomicBool) -> anyhow::Result<()> {
        while !stop.load(Ordering::Relaxed) {
            match lines.recv_timeout(NAP) {
                Ok(arrival) => {
                    let at_s = arrival.at.duration_since(self.origin).as_secs_f64();
                    self.line(arrival.line, at_s)?;
                }
                // A thread that has ended by itself has failed.
                Err(RecvTimeoutError::Timeout) if self.has_ended_worker() => return self.end_workers().map(drop),
                Err(RecvTimeoutError::Timeout) => {}
                Err(RecvTimeoutError::Disconnected) => break,
            }
        }
        Ok(())
    }

    fn has_ended_worker(&self) -> bool {
        self.whiskers.iter().flat_map(|whisker| &whisker.worker).any(|worker| worker.thread.is_finished())
    }

    /// Ends the threads of the whiskers. Returns names and counts.
    ///
    /// # Errors
    /// The error of the first that failed.
    pub(super) fn end_workers(&mut self) -> anyhow::Result<Vec<(Option<String>, Counters)>> {
        let mut ended = Vec::new();
        for whisker in &mut self.whiskers {
            if let Some(Worker { samples, thread, .. }) = whisker.worker.take() {
                drop(samples);
                ended.push((whisker.name.clone(), thread.join().expect("the thread does not panic")));
            }
        }
        ended.into_iter().map(|(name, counts)| Ok((name, counts?))).collect()
    }

    fn line(&mut self, line: io::Result<Vec<u8>>, at_s: f64) -> anyhow::Result<()> {
        self.lines += 1;
        let parsed = match line.map(String::from_utf8) {
            Ok(Ok(text)) => T::parse(text.trim_end_matches(['\n', '\r'])),
            Ok(Err(error)) => {
                let column = Some(error.utf8_error().valid_up_to() + 1);
                Err(BadLine {
                    column,
                    reason: "found bytes that are not UTF-8, expected UTF-8".into(),
                    is_not_finite: false,
                })
            }
            Err(error) if error.kind() == io::ErrorKind::InvalidData => {
                Err(BadLine { column: None, reason: error.to_string(), is_not_finite: false })
            }
            Err(error) => return Err(error).context("stdin"),
        };
        let taken = match parsed {
            Ok(Line::Prior(prior)) if self.has_begun(&prior) => {
                return locked(&self.sink).refuse("second first lines", || {
                    format!(
                        "stdin: line {}: found a second first line of the whisker, expected its readings or poses; the line is left \
                         out, and the first one holds",
                        self.lines
                    )
                });
            }
            Ok(Line::Prior(prior)) => return self.begin(&prior).with_context(|| format!("stdin: line {}", self.lines)),
            Ok(Line::Sample(sample)) => self.sample(sample, at_s)?,
            Err(bad) => Err(bad),
        };
        let Err(bad) = taken else { return Ok(()) };
        let kind =
            if bad.is_not_finite { "lines with a value that is not finite" } else { "lines that are no messages" };
        locked(&self.sink).refuse(kind, || format!("stdin: line {}, {bad}; {}", self.lines, self.consequence()))
    }

    /// Names of the whiskers without a first line.
    pub(super) fn waiting(&self) -> Vec<Option<String>> {
        self.whiskers.iter().filter(|whisker| whisker.worker.is_none()).map(|whisker| whisker.name.clone()).collect()
    }

    /// States which lines are left out after one that is no message: also those of whiskers without a first line, as which it may
    /// have been meant.
    fn consequence(&self) -> String {
        let waiting = self.waiting();
        let names: Vec<_> = waiting.iter().flatten().map(String::as_str).collect();
        match (waiting.len(), names.as_slice()) {
            (0, _) => "the line is left out".into(),
            (_, []) => "the line is left out, and so is every reading and pose before a valid first line".into(),
            (_, names) => format!(
                "the line is left out, and so is every reading and pose of {} before a valid first line of that whisker",
                names.join(", ")
            ),
        }
    }

    /// Passes a reading, a pose or both to the thread of the whisker.
    fn sample(&mut self, sample: SampleOf<T>, at_s: f64) -> anyhow::Result<Result<(), BadLine>> {
        let bad = |reason: String| Ok(Err(BadLine { column: None, reason, is_not_finite: false }));
        let Some(place) = self.place_of(sample.name.as_deref()) else {
            return bad(self.unknown(sample.name.as_deref()));
        };
        let Some(worker) = &mut self.whiskers[place].worker else {
            return bad("found a reading or a pose, expected the whisker's first line before it (docs/LIVE.md)".into());
        };
        let SampleLine { t_s, reading, base, .. } = sample;
        let repeated = T::zeroings_repeated(&worker.conversion);
        let taken = reading.map(|given| T::convert(&mut worker.conversion, t_s, given, at_s)).transpose();
        if T::zeroings_repeated(&worker.conversion) > repeated {
            locked(&self.sink).repeat_zeroing(sample.name.as_deref(), t_s);
        }
        let reading = match taken {
            Ok(reading) => reading,
            Err(reason) => return bad(reason),
        };
        if worker.samples.send(Sample { t_s, reading, base, at_s }).is_err() {
            self.end_workers()?;
        }
        Ok(Ok(()))
    }

    fn place_of(&self, name: Option<&str>) -> Option<usize> {
        self.whiskers.iter().position(|whisker| whisker.name.as_deref() == name)
    }

    fn unknown(&self, name: Option<&str>) -> String {
        let known: Vec<_> = self.whiskers.iter().filter_map(|whisker| whisker.name.as_deref()).collect();
        let found = name.map_or_else(|| "no name".into(), |name| format!("the name `{}`", one_line(name)));
        match known.as_slice() {
            [] => format!("found {found}, expected no name, as in --calibration"),
            known => format!("found {found}, expected one of those of --calibration: {}", known.join(", ")),
        }
    }

    /// Whether there was a first line of the whisker.
    fn has_begun(&self, prior: &T::Prior) -> bool {
        self.place_of(T::name(prior)).is_some_and(|place| self.whiskers[place].worker.is_some())
    }

    /// Begins the estimation of a whisker.
    fn begin(&mut self, prior: &T::Prior) -> anyhow::Result<()> {
        let name = T::name(prior);
        let Some(place) = self.place_of(name) else { bail!("name: {}", self.unknown(name)) };
        let whisker = &mut self.whiskers[place];
        let (estimator, conversion) = self.method.begin(&whisker.calibration, &whisker.path, prior, self.timing)?;
        let (samples, received) = sync_channel(AHEAD);
        let (name, origin, sink) = (whisker.name.clone(), self.origin, self.sink.clone());
        let works = move || work(estimator, name.as_deref(), &received, origin, &sink);
        let thread = thread::Builder::new().name("whisker".into()).spawn(works).context("thread of a whisker")?;
        whisker.worker = Some(Worker { conversion, samples, thread });
        Ok(())
    }
}
