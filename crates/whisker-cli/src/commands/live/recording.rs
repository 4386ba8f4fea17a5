//! Recordings played at their own pace.

use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::sleep;
use std::time::{Duration, Instant};

use anyhow::bail;
use live::wire::Written;
use live::{Answer, Disturbance, Kind, LiveEstimator, Message, Motion, Timing, messages, messages_in_space, play};
use nalgebra::Vector2;
use testbed::space;
use trace::{ArrayRecording, ArraySidecar, Recording, SpatialTrace, Trace, is_spatial};

use super::blocked::Writing;
use super::sink::Sink;
use super::{Arguments, named};
use crate::commands::played::check_trace;
use crate::commands::space::{Prepared, calibration_of};

/// Longest sleep, and so the delay of an interrupt.
const NAP: Duration = Duration::from_millis(50);

/// A trace to play and the name of its whisker.
struct Entry {
    trace: PathBuf,
    name: String,
}

/// Conditions under which recordings are played.
struct Player<'a> {
    arguments: &'a Arguments,
    timing: Timing,
    disturbance: &'a Disturbance,
    stop: &'a AtomicBool,
    writing: Writing,
}

pub(super) fn run(
    arguments: &Arguments,
    timing: Timing,
    disturbance: &Disturbance,
    stop: &AtomicBool,
    writing: Writing,
) -> anyhow::Result<ExitCode> {
    let entries = entries(&arguments.recording)?;
    let mut in_space = 0;
    for entry in &entries {
        check_trace(&entry.trace)?;
        in_space += usize::from(is_spatial(&entry.trace)?);
    }
    let player = Player { arguments, timing, disturbance, stop, writing };
    match in_space {
        0 => player.in_plane(&entries),
        count if count == entries.len() => player.in_space(&entries),
        count => bail!(
            "--recording: found {count} traces in space among {}, expected traces in the plane or in space alone",
            entries.len()
        ),
    }
}

impl Player<'_> {
    fn in_plane(&self, entries: &[Entry]) -> anyhow::Result<ExitCode> {
        let played = &self.arguments.played;
        let mut recordings: Vec<(Recording, Vec<f64>)> = Vec::new();
        let mut estimators = Vec::new();
        for entry in entries {
            let calibration = calibration(self.arguments, &entry.name)?;
            let mut prepared = played.prepare(played.find(&entry.trace, calibration.as_deref())?)?;
            let recording = Trace::read(&entry.trace)?.recording;
            let readings_n_m = recording.instants.iter().map(|instant| (prepared.reader)(instant)).collect();
            let build = Box::new(prepared.build());
            estimators.push(LiveEstimator::new(build, &prepared.knowledge, prepared.looks_back(), self.timing)?);
            recordings.push((recording, readings_n_m));
        }
        let streams: Vec<_> = recordings.iter().map(|(recording, readings)| (recording, &readings[..])).collect();
        self.play(entries, estimators, &messages(&streams, self.disturbance, played.seed))
    }

    fn in_space(&self, entries: &[Entry]) -> anyhow::Result<ExitCode> {
        let options = self.arguments.played.in_space()?;
        let mut recordings: Vec<(SpatialTrace, Vec<Vector2<f64>>)> = Vec::new();
        let mut estimators = Vec::new();
        for entry in entries {
            let trace = SpatialTrace::read(&entry.trace)?;
            let given = calibration(self.arguments, &entry.name)?;
            let default = || calibration_of(&entry.trace, &trace.sidecar.whisker.name, &options.front_end);
            let path = given.unwrap_or_else(default);
            let Prepared { trace, knowledge, readings_n_m } = Prepared::new(trace, &options, &path)?;
            let (row, config, of_build) = (options.row, options.config.clone(), knowledge.clone());
            let build = move || space::replay::build(row, &config, &of_build);
            estimators.push(LiveEstimator::in_space(Box::new(build), &knowledge, self.timing)?);
            recordings.push((trace, readings_n_m));
        }
        let streams: Vec<_> = recordings.iter().map(|(trace, readings)| (&trace.recording, &readings[..])).collect();
        self.play(entries, estimators, &messages_in_space(&streams, self.disturbance, options.seed))
    }

    /// Plays the messages at their pace, and writes the answers.
    fn play<K: Kind, M: Motion<Measured = K::Base, Base = K::Base>>(
        &self,
        entries: &[Entry],
        mut estimators: Vec<LiveEstimator<M, K>>,
        messages: &[Message<K::Reading, K::Base>],
    ) -> anyhow::Result<ExitCode>
    where
        Answer<K::Reading, K::Base, K::Estimate>: Written,
    {
        let is_alone = entries.len() == 1;
        let name = |whisker: usize| (!is_alone).then_some(entries[whisker].name.as_str());
        // Times of arrival are those of the recording, whatever the load of the machine.
        let first_s = messages.first().map_or(0.0, |message| message.at_s);
        let begun = Instant::now();
        let speed = self.arguments.speed;
        let origin = begun - Duration::try_from_secs_f64(first_s / speed).unwrap_or_default();
        let mut sink = Sink::new(origin, speed, self.writing.clone());
        let pace = |at_s: f64| {
            let due = Duration::try_from_secs_f64((at_s - first_s) / speed).unwrap_or(Duration::MAX);
            while !self.stop.load(Ordering::Relaxed) {
                let left = due.saturating_sub(begun.elapsed());
                if left.is_zero() {
                    return true;
                }
                sleep(left.min(NAP));
            }
            false
        };
        play(&mut estimators, messages, pace, |whisker, out| sink.take(name(whisker), out))?;
        let counts = estimators.iter().enumerate();
        let counts: Vec<_> = counts.map(|(whisker, of)| (name(whisker).map(Into::into), *of.counters())).collect();
        Ok(sink.finish(&counts))
    }
}

/// Traces of the recordings: those of the whiskers of an array, or one of a single whisker.
fn entries(paths: &[PathBuf]) -> anyhow::Result<Vec<Entry>> {
    let mut entries: Vec<Entry> = Vec::new();
    for path in paths {
        let is_json = path.extension().is_some_and(|extension| extension == "json");
        if is_json && ArrayRecording::is_one(path)? {
            let folder = path.parent().unwrap_or(Path::new(""));
            let whiskers = ArraySidecar::read(path)?.whiskers.into_iter();
            entries.extend(
                whiskers
                    .map(|whisker| Entry { trace: folder.join(format!("{}.csv", whisker.trace)), name: whisker.name }),
            );
        } else {
            let name = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
            entries.push(Entry { trace: path.clone(), name });
        }
    }
    for (index, entry) in entries.iter().enumerate() {
        if entries[..index].iter().any(|other| other.name == entry.name) {
            bail!("--recording: found the whisker `{}` twice, expected each once", entry.name);
        }
    }
    Ok(entries)
}

/// Calibration of a whisker, if one is given: its own or that of all.
fn calibration(arguments: &Arguments, whisker: &str) -> anyhow::Result<Option<PathBuf>> {
    let given = arguments.calibration.iter().map(|option| named(option));
    let (own, common): (Vec<_>, Vec<_>) = given.partition(|(name, _)| name.is_some());
    if common.len() > 1 {
        bail!("--calibration: found {} without a name, expected at most one, for all whiskers", common.len());
    }
    let of_whisker = own.into_iter().find(|(name, _)| *name == Some(whisker));
    Ok(of_whisker.or(common.into_iter().next()).map(|(_, path)| path))
}
