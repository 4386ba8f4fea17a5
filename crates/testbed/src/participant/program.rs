//! Programs of other people: any that reads rows on stdin and writes estimates on stdout, one process a trial.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, Instant};

use anyhow::{Context, bail};
use files::sha256;
use serde_json::json;
use trace::is_plain_name;
use whisker::estimators::{Estimate, Knowledge, MethodClass, estimator};
use whisker::frames::{Base, Pose, Start};
use whisker::sensor::Face;

use super::process::{Process, Silence};
use super::protocol::{Greeting, PROTOCOL, Row, estimate};
use super::{Participant, Task};
use crate::replay::Replay;
use crate::results::RunEstimator;
use crate::seeds::derived_seed;

/// A program that takes part under a name.
#[derive(Clone, Debug, PartialEq)]
pub struct Program {
    name: String,
    /// The command as it was given.
    command: String,
    /// Program and arguments.
    words: Vec<String>,
    /// Hashes of those words that are files.
    files_sha256: BTreeMap<String, String>,
    /// Longest wait for one answer.
    timeout: Duration,
}

impl Program {
    /// From `command` or `name=command`, split into words as a shell does, which has no other part in it. Without a name it is called after its
    /// first argument that is no option where that is a file (a script), else after the program, without folder and extension.
    ///
    /// # Errors
    /// If that is no command, or the name is taken by a registered estimator or cannot be a file's.
    pub fn new(text: &str, timeout: Duration) -> anyhow::Result<Self> {
        let (name, command) = match text.split_once('=') {
            Some((name, command)) if is_name(name) => (Some(name.to_owned()), command),
            _ => (None, text),
        };
        let words = shlex::split(command).filter(|words| !words.is_empty()).with_context(|| {
            format!("--exec: found `{text}`, expected a command or name=command, with its quotes in pairs")
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

    /// Gives the program one trial, row by row: no row before the answer to the last.
    fn converse(
        &self,
        process: &mut Process,
        task: &Task<'_>,
        estimates: &mut Vec<Option<Estimate>>,
    ) -> Result<(), String> {
        let &Task { knowledge, samples, touched, trace, seed } = task;
        process.tell(line(&Greeting::new(knowledge, derived_seed(seed, &[&self.name, trace]))));
        // Counted from where the base stood at the first row: no hint at where the world has its origin.
        let mut base: Pose<Base, Start> = Pose::new(0.0, 0.0, 0.0);
        let mut t_s = 0.0;
        for (index, (sample, &touched)) in samples.iter().zip(touched).enumerate() {
            base = sample.motion.inverse().then(&base);
            t_s += sample.dt_s;
            process.tell(line(&Row::new(t_s, &base, sample, touched)));
            let row = format!("row {} of {}", index + 1, samples.len());
            let answer = match process.hear(self.timeout) {
                Ok(answer) => answer.map_err(|error| format!("answer to {row}: {error}"))?,
                Err(Silence::TimedOut) => {
                    return Err(format!("no answer to {row} within {} s", self.timeout.as_secs_f64()));
                }
                Err(Silence::Closed) => return Err(format!("{} before its answer to {row}", self.end(process))),
            };
            let face = touched.unwrap_or_else(|| Face::of_reading(sample.reading_n_m));
            let estimate =
                estimate(&answer, face, knowledge).map_err(|problem| format!("answer to {row}: {problem}"))?;
            estimates.push(estimate);
        }
        process.hang_up();
        match process.hear(self.timeout) {
            Err(Silence::Closed) => Ok(()),
            Err(Silence::TimedOut) => {
                Err(format!("still runs {} s after the end of its input", self.timeout.as_secs_f64()))
            }
            Ok(_) => Err(format!("found more answers than the {} rows, expected one each", samples.len())),
        }
    }

    /// How a program ended that has closed its stdout, and what it said last.
    fn end(&self, process: &mut Process) -> String {
        let end = match process.end(self.timeout) {
            Ok(Some(status)) => format!("ended ({status})"),
            Ok(None) | Err(_) => "closed its stdout".into(),
        };
        match process.last_words() {
            Some(words) => format!("{end}, saying `{words}`,"),
            None => end,
        }
    }
}

/// Whether a name is good for files and figures.
fn is_name(name: &str) -> bool {
    is_plain_name(name) && name.chars().all(|c| c.is_ascii_alphanumeric() || c == '-' || c == '_')
}

/// A message as a line.
fn line(message: &impl serde::Serialize) -> String {
    serde_json::to_string(message).expect("messages serialise") + "\n"
}

impl Participant for Program {
    fn describe(&self) -> RunEstimator {
        RunEstimator {
            name: self.name.clone(),
            about: format!("program `{}`", self.command),
            class: MethodClass::Recursive,
            sensor_model: None,
            config: json!({
                "command": self.command,
                "files_sha256": self.files_sha256,
                "protocol": PROTOCOL,
                "timeout_s": self.timeout.as_secs_f64(),
            }),
        }
    }

    fn check(&self, _: &Arc<Knowledge>) -> anyhow::Result<()> {
        self.start().map(drop)
    }

    fn replay(&self, task: &Task<'_>) -> anyhow::Result<Replay> {
        let start = Instant::now();
        let mut estimates = Vec::with_capacity(task.samples.len());
        let mut process = self.start()?;
        let failure = self.converse(&mut process, task, &mut estimates).err();
        // From a failure on it is silent.
        estimates.resize(task.samples.len(), None);
        Ok(Replay { estimates, outline: None, elapsed_ns: start.elapsed().as_nanos(), failure })
    }
}
