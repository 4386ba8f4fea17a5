//! External programs as participants: read rows on stdin, write estimates to stdout, one process per trial.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, Instant};

use anyhow::{Context, bail};
use files::sha256;
use serde::Serialize;
use serde_json::{Value, json};
use testbed::protocol::{PROTOCOL, estimate};
use testbed::replay::Replay;
use testbed::results::RunEstimator;
use testbed::seeds::derived_seed;
use trace::is_plain_name;
use whisker::estimators::{Knowledge, MethodClass, estimator};
use whisker::frames::{Base, Pose, Start};
use whisker::sensor::Face;

use super::process::{NoLine, Process};
use super::protocol::{Prior, Row};
use super::{Participant, Task};

/// External program with the name under which it participates.
#[derive(Clone, Debug, PartialEq)]
pub struct Program {
    name: String,
    /// Command as given.
    command: String,
    /// Program and arguments.
    words: Vec<String>,
    /// SHA-256 of the words that are files.
    files_sha256: BTreeMap<String, String>,
    /// Timeout of one answer.
    timeout: Duration,
}

impl Program {
    /// Parses `command` or `name=command`; the command is split into words by the rules of a shell, but not run by one.
    /// The default name is the stem of the first non-option argument if that is a file (a script), else of the program.
    ///
    /// # Errors
    /// If the command is empty or malformed, or the name is not a plain file name or belongs to a registered estimator.
    pub fn new(text: &str, timeout: Duration) -> anyhow::Result<Self> {
        let (name, command) = match text.split_once('=') {
            Some((name, command)) if is_name(name) => (Some(name.to_owned()), command),
            _ => (None, text),
        };
        let words = shlex::split(command).filter(|words| !words.is_empty()).with_context(|| {
            format!("--exec: found `{text}`, expected a command or name=command, with matching quotes")
        })?;
        let is_file = |word: &&String| Path::new(word).is_file();
        let script = words.iter().skip(1).find(|word| !word.starts_with('-')).filter(is_file);
        let called_after = script.unwrap_or(&words[0]);
        let stem = || Path::new(called_after).file_stem().unwrap_or_default().to_string_lossy().into_owned();
        let name = name.unwrap_or_else(stem);
        if !is_name(&name) {
            bail!(
                "--exec: found the name `{name}`, expected letters, digits, - and _; give one by --exec name=command"
            );
        }
        if estimator(&name).is_some() {
            bail!("--exec: `{name}` is the name of a registered estimator; give another by --exec name=command");
        }
        let mut files_sha256 = BTreeMap::new();
        for word in words.iter().filter(is_file) {
            files_sha256.insert(word.clone(), sha256(fs::read(word).with_context(|| word.clone())?));
        }
        Ok(Self { name, command: command.into(), words, files_sha256, timeout })
    }

    fn start(&self) -> anyhow::Result<Process> {
        Process::start(&self.words).with_context(|| format!("--exec: `{}` does not start", self.words[0]))
    }

    /// Name under which it participates.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Settings for the record of a run that speaks this version of the protocol.
    pub(crate) fn config(&self, protocol: u32) -> Value {
        json!({
            "command": self.command,
            "files_sha256": self.files_sha256,
            "protocol": protocol,
            "timeout_s": self.timeout.as_secs_f64(),
        })
    }

    /// Checks that the program starts.
    ///
    /// # Errors
    /// If it does not.
    pub(crate) fn check_starts(&self) -> anyhow::Result<()> {
        self.start().map(drop)
    }

    /// Random seed of a trial.
    pub(super) fn seed(&self, seed: u64, trace: &str) -> u64 {
        derived_seed(seed, &[&self.name, trace])
    }

    /// Runs one trial: sends the first line and then each row, and parses the answer to each by `parse`, which receives the row's
    /// index. After a failure there are no estimates.
    ///
    /// # Errors
    /// If the program does not start.
    pub(super) fn converse<One: Clone>(
        &self,
        first: &impl Serialize,
        rows: impl ExactSizeIterator<Item = impl Serialize>,
        parse: impl Fn(usize, &str) -> Result<Option<One>, String>,
    ) -> anyhow::Result<Conversation<One>> {
        let count = rows.len();
        let mut process = self.start()?;
        let (mut estimates, mut answers_us) = (Vec::with_capacity(count), Vec::with_capacity(count));
        let failure = self.exchange(&mut process, first, rows, |index, answer, waited| {
            estimates.push(parse(index, answer)?);
            answers_us.push(1e6 * waited.as_secs_f64());
            Ok(())
        });
        estimates.resize(count, None);
        Ok(Conversation { estimates, answers_us, failure: failure.err() })
    }

    /// Sends a row after the answer to the previous one, and hands each answer to `take` with the time that it took.
    fn exchange(
        &self,
        process: &mut Process,
        first: &impl Serialize,
        rows: impl ExactSizeIterator<Item = impl Serialize>,
        mut take: impl FnMut(usize, &str, Duration) -> Result<(), String>,
    ) -> Result<(), String> {
        let count = rows.len();
        process.send(line(first));
        for (index, message) in rows.enumerate() {
            let sent = Instant::now();
            process.send(line(&message));
            let row = format!("row {} of {count}", index + 1);
            let answer = match process.receive(self.timeout) {
                Ok(answer) => answer.map_err(|error| format!("answer to {row}: {error}"))?,
                Err(NoLine::TimedOut) => {
                    return Err(format!("no answer to {row} within {} s", self.timeout.as_secs_f64()));
                }
                Err(NoLine::Closed) => return Err(format!("{} before its answer to {row}", self.end(process))),
            };
            take(index, &answer, sent.elapsed()).map_err(|problem| format!("answer to {row}: {problem}"))?;
        }
        process.close_input();
        match process.receive(self.timeout) {
            Err(NoLine::Closed) => Ok(()),
            Err(NoLine::TimedOut) => {
                Err(format!("still running {} s after its input was closed", self.timeout.as_secs_f64()))
            }
            Ok(_) => Err(format!("found more answers than the {count} rows, expected one each")),
        }
    }

    /// Description of the end of a program that closed its stdout, with its last line on stderr.
    fn end(&self, process: &mut Process) -> String {
        let end = match process.end(self.timeout) {
            Ok(Some(status)) => format!("ended ({status})"),
            Ok(None) | Err(_) => "closed its stdout".into(),
        };
        match process.last_stderr_line() {
            Some(words) => format!("{end}, last line of stderr `{words}`,"),
            None => end,
        }
    }
}

/// Result of a trial with a program.
pub(super) struct Conversation<One> {
    /// One entry per row; `None` without an estimate.
    pub(super) estimates: Vec<Option<One>>,
    /// Wall-clock time of each answer (us).
    pub(super) answers_us: Vec<f64>,
    /// Reason why the trial failed.
    pub(super) failure: Option<String>,
}

/// Whether a name is suitable for files and figures.
fn is_name(name: &str) -> bool {
    is_plain_name(name) && name.chars().all(|c| c.is_ascii_alphanumeric() || c == '-' || c == '_')
}

/// Message as a line of JSON.
fn line(message: &impl Serialize) -> String {
    serde_json::to_string(message).expect("messages serialise") + "\n"
}

impl Participant for Program {
    fn describe(&self) -> RunEstimator {
        RunEstimator {
            name: self.name.clone(),
            about: format!("program `{}`", self.command),
            class: MethodClass::Recursive,
            sensor_model: None,
            config: self.config(PROTOCOL),
        }
    }

    fn check(&self, _: &Arc<Knowledge>) -> anyhow::Result<()> {
        self.check_starts()
    }

    fn replay(&self, task: &Task<'_>) -> anyhow::Result<Replay> {
        let &Task { knowledge, samples, touched, trace, seed } = task;
        let start = Instant::now();
        // Poses are relative to the base's first pose, so that they do not reveal the origin of World.
        let mut base: Pose<Base, Start> = Pose::new(0.0, 0.0, 0.0);
        let mut t_s = 0.0;
        let rows = samples.iter().zip(touched).map(|(sample, &touched)| {
            base = sample.motion.inverse().then(&base);
            t_s += sample.dt_s;
            Row::new(t_s, &base, sample, touched)
        });
        let parse = |index: usize, answer: &str| {
            let face = touched[index].unwrap_or_else(|| Face::of_reading(samples[index].reading_n_m));
            estimate(answer, face, knowledge)
        };
        let Conversation { estimates, failure, .. } =
            self.converse(&Prior::new(knowledge, self.seed(seed, trace)), rows, parse)?;
        Ok(Replay { estimates, outline: None, elapsed_ns: start.elapsed().as_nanos(), failure })
    }
}
