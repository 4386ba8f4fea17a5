//! Recordings played at their own pace.

use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::sleep;
use std::time::{Duration, Instant};

use anyhow::bail;
use live::{Disturbance, LiveEstimator, Timing, messages, play};
use trace::{ArrayRecording, ArraySidecar, Recording, Trace};

use super::sink::Sink;
use super::{Arguments, named};

/// Longest sleep, and so the delay of an interrupt.
const NAP: Duration = Duration::from_millis(50);

/// A trace to play and the name of its whisker.
struct Entry {
    trace: PathBuf,
    name: String,
}

/// A played trace.
struct Whisker {
    name: String,
    recording: Recording,
    readings_n_m: Vec<f64>,
}

pub(super) fn run(
    arguments: &Arguments,
    timing: Timing,
    disturbance: &Disturbance,
    stop: &AtomicBool,
) -> anyhow::Result<ExitCode> {
    let mut whiskers = Vec::new();
    let mut estimators = Vec::new();
    for entry in entries(&arguments.recording)? {
        let calibration = calibration(arguments, &entry.name)?;
        let mut played = arguments.played.prepare(arguments.played.find(&entry.trace, calibration.as_deref())?)?;
        let recording = Trace::read(&entry.trace)?.recording;
        let readings_n_m = recording.instants.iter().map(|instant| (played.reader)(instant)).collect();
        let build = Box::new(played.build());
        estimators.push(LiveEstimator::new(build, &played.knowledge, played.looks_back(), timing)?);
        whiskers.push(Whisker { name: entry.name, recording, readings_n_m });
    }
    let recordings: Vec<_> = whiskers.iter().map(|whisker| (&whisker.recording, &whisker.readings_n_m[..])).collect();
    let messages = messages(&recordings, disturbance, arguments.played.seed);
    let is_alone = whiskers.len() == 1;
    let name = |whisker: usize| (!is_alone).then_some(whiskers[whisker].name.as_str());
    // Times of arrival are those of the recording, whatever the load of the machine.
    let first_s = messages.first().map_or(0.0, |message| message.at_s);
    let begun = Instant::now();
    let speed = arguments.speed;
    let origin = begun - Duration::try_from_secs_f64(first_s / speed).unwrap_or_default();
    let mut sink = Sink::new(origin, speed);
    let pace = |at_s: f64| {
        let due = Duration::try_from_secs_f64((at_s - first_s) / speed).unwrap_or(Duration::MAX);
        while !stop.load(Ordering::Relaxed) {
            let left = due.saturating_sub(begun.elapsed());
            if left.is_zero() {
                return true;
            }
            sleep(left.min(NAP));
        }
        false
    };
    play(&mut estimators, &messages, pace, |whisker, out| sink.take(name(whisker), out))?;
    let counts = estimators.iter().enumerate();
    let counts: Vec<_> = counts.map(|(whisker, of)| (name(whisker).map(Into::into), *of.counters())).collect();
    Ok(sink.finish(&counts))
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
