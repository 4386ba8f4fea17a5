//! Answers as JSON lines, notes on stderr, and the summary at the end.

use std::collections::BTreeMap;
use std::io::{self, Stdout, Write};
use std::process::ExitCode;
use std::time::{Duration, Instant};

use anyhow::Context;
use live::wire::Written;
use live::{Answer, Counters, Event, Output, Status};
use platform::inference::Times;
use serde::Serialize;
use testbed::protocol::AnswerLine;

use super::blocked::{Stream, Writing};
use crate::commands::{FINISHED_WITH_FAILURES, diagnose};

/// Largest number of printed notes of a whisker and kind; further ones are counted.
const MOST_NOTES: u64 = 10;

/// Largest number of bytes that are written at once.
const PART: usize = 1 << 12;

/// Status of a line that is no message.
const REFUSED: &str = "refused";

/// Status of counts from which the zero of their sensor is determined.
pub(super) const ZEROING: &str = "zeroing";

/// Destination of the answers.
pub(super) struct Sink {
    stdout: Stdout,
    writing: Writing,
    lines: Vec<u8>,
    /// Wall-clock time at which the time of arrivals is zero, and its speed.
    origin: Instant,
    speed: f64,
    latency: Times,
    /// Numbers of notes by whisker, `None` for lines that are no messages, and kind.
    notes: BTreeMap<(Option<String>, &'static str), u64>,
    refused: u64,
}

impl Sink {
    /// A sink for arrivals at `speed` seconds a second from `origin` on.
    pub(super) fn new(origin: Instant, speed: f64, writing: Writing) -> Self {
        let (lines, latency, notes) = (Vec::new(), Times::default(), BTreeMap::new());
        Self { stdout: io::stdout(), writing, lines, origin, speed, latency, notes, refused: 0 }
    }

    /// Writes the answers of a whisker and prints its events. `name` is `None` if it is the only one.
    pub(super) fn take<R, P, E>(&mut self, name: Option<&str>, out: &mut Output<R, P, E>) -> anyhow::Result<()>
    where
        Answer<R, P, E>: Written,
    {
        let of = name.map_or_else(String::new, |name| format!("{name}: "));
        for event in out.events.drain(..) {
            let (kind, most) = match event {
                Event::Stale { .. } => ("stale poses", MOST_NOTES),
                Event::OffPlane { .. } => ("poses off the plane", MOST_NOTES),
                Event::Recovered { .. } => ("poses again", MOST_NOTES),
                Event::Fast { .. } => ("implausibly fast poses", MOST_NOTES),
                Event::Jumped { .. } => ("jumps of a clock", MOST_NOTES),
                Event::Frozen { .. } => ("frozen readings", MOST_NOTES),
                Event::Thawed { .. } => ("readings that change again", MOST_NOTES),
                Event::NotFinite { .. } => ("values that are not finite", 1),
            };
            let is_error = matches!(event, Event::Jumped { .. } | Event::NotFinite { .. });
            self.refused += u64::from(is_error);
            self.note(name, kind, most, || format!("{}{of}{event}", if is_error { "error: " } else { "" }));
        }
        if out.answers.is_empty() {
            return Ok(());
        }
        for answer in &out.answers {
            self.add(&answer.line(name))?;
        }
        self.write()?;
        let elapsed_s = self.origin.elapsed().as_secs_f64();
        for answer in out.answers.drain(..) {
            if matches!(answer.status, Status::Used | Status::Gated) {
                let latency_s = (elapsed_s - answer.arrived_s / self.speed).max(0.0);
                self.latency.push(Duration::from_secs_f64(latency_s));
            }
        }
        Ok(())
    }

    /// States that the zeroing of a whisker begins again.
    pub(super) fn repeat_zeroing(&mut self, name: Option<&str>, t_s: f64) {
        self.note(name, "repeated zeroings", MOST_NOTES, || {
            let whisker = name.map_or_else(String::new, |name| format!("{name}: "));
            format!(
                "{whisker}zeroing up to {t_s:.3} s: found counts that change by more than those of a free whisker; the zeroing begins \
                 again, and there are no estimates until it has ended"
            )
        });
    }

    /// Prints why a line is no message and what follows, if it is the first of its kind, and answers it.
    pub(super) fn refuse(&mut self, kind: &'static str, reason: impl FnOnce() -> String) -> anyhow::Result<()> {
        self.refused += 1;
        self.note(None, kind, 1, || format!("error: {}", reason()));
        self.add(&AnswerLine { status: Some(REFUSED.into()), ..AnswerLine::default() })?;
        self.write()
    }

    /// Answers a reading of this time and whisker that is not given to the estimator.
    pub(super) fn leave_out(&mut self, name: Option<&str>, t_s: f64, status: &str) -> anyhow::Result<()> {
        let (name, status) = (name.map(Into::into), Some(status.into()));
        self.add(&AnswerLine { name, t_s: Some(t_s), status, ..AnswerLine::default() })?;
        self.write()
    }

    /// Prints the counts of the whiskers and the latency. Returns the exit code.
    pub(super) fn finish(&self, whiskers: &[(Option<String>, Counters)]) -> ExitCode {
        for ((name, kind), count) in &self.notes {
            if *count > 1 {
                let of = name.as_ref().map_or_else(String::new, |name| format!("{name}: "));
                self.print(&format!("{of}{kind}: {count}"));
            }
        }
        for (name, counters) in whiskers {
            let name = name.as_deref().unwrap_or("whisker");
            self.print(&format!("{name}: {counters}"));
            for remark in counters.remarks() {
                self.print(&format!("{name}: note: {remark}"));
            }
        }
        if self.latency.count() > 0 {
            self.print(&format!("latency from reading to answer: {} answers, {}", self.latency.count(), self.latency));
        }
        if self.refused > 0 { FINISHED_WITH_FAILURES.into() } else { ExitCode::SUCCESS }
    }

    /// States that whiskers have sent no first line.
    pub(super) fn state_waiting(&self, names: &[Option<String>]) {
        for name in names {
            self.print(&format!("{}: note: no first line arrived", name.as_deref().unwrap_or("whisker")));
        }
    }

    fn add(&mut self, answer: &impl Serialize) -> anyhow::Result<()> {
        serde_json::to_writer(&mut self.lines, answer)?;
        self.lines.push(b'\n');
        Ok(())
    }

    fn write(&mut self) -> anyhow::Result<()> {
        let mut stdout = self.stdout.lock();
        // In parts, so that a slow reader differs from one that does not read.
        let written = self.lines.chunks(PART).try_for_each(|part| {
            let _write = self.writing.begin(Stream::Stdout);
            stdout.write_all(part).and_then(|()| stdout.flush())
        });
        self.lines.clear();
        written.context("stdout")
    }

    fn note(&mut self, name: Option<&str>, kind: &'static str, most: u64, words: impl FnOnce() -> String) {
        let count = self.notes.entry((name.map(Into::into), kind)).or_default();
        *count += 1;
        if *count <= most {
            let further = if *count == most { " (further ones are counted)" } else { "" };
            self.print(&format!("{}{further}", words()));
        }
    }

    /// Prints a line on stderr.
    fn print(&self, line: &str) {
        let _write = self.writing.begin(Stream::Stderr);
        diagnose(line);
    }
}
