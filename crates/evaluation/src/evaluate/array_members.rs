//! Trials of single whiskers that belong to a recording of several whiskers.

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::bail;
use testbed::encoders::Encoders;
use testbed::map::MapConfig;
use testbed::results::{RunMounted, RunRecording};
use trace::{ArrayRecording, Sidecar, Trace};
use whisker::estimators::BaseNoise;

use crate::distinct::check_distinct;

/// One whisker of a recording of several, as replayed with some encoders.
#[derive(Clone)]
pub(super) struct ArrayMember {
    array: Arc<ArrayRecording>,
    /// Index of the whisker in the recording.
    whisker: usize,
    /// Sidecar of the trace as it was recorded, under its own name.
    recorded: Arc<Sidecar>,
    encoders: Encoders,
    base_noise: BaseNoise,
}

/// Reader of the recordings to which traces belong, by their paths. Each is read once.
#[derive(Default)]
pub(super) struct ArrayReader(BTreeMap<PathBuf, Arc<ArrayRecording>>);

impl ArrayReader {
    /// The trials of a trace: the trace itself or, if it belongs to a recording, one trial for each of the encoders. A
    /// trial with imperfect encoders has a name and a group of its own.
    ///
    /// # Errors
    /// If the recording cannot be read, or does not contain the trace.
    pub(super) fn trials(
        &mut self,
        folder: &Path,
        trace: &Trace,
        encoders: &[Encoders],
    ) -> anyhow::Result<Vec<(Sidecar, Option<ArrayMember>)>> {
        let Some(name) = &trace.sidecar.recording else { return Ok(vec![(trace.sidecar.clone(), None)]) };
        let array = self.read(folder.join(format!("{name}.json")))?;
        let whisker = array.check(&folder.join(format!("{}.csv", trace.sidecar.name)), trace)?;
        let recorded = Arc::new(trace.sidecar.clone());
        let perfect = [Encoders::default()];
        let encoders = if encoders.is_empty() { &perfect } else { encoders };
        let trial = |encoders: &Encoders| {
            let mut sidecar = trace.sidecar.clone();
            sidecar.name = name_with(&sidecar.name, encoders);
            if !encoders.are_perfect() {
                sidecar.group = format!("{}, encoders {}", sidecar.group, encoders.label().replace('_', " "));
            }
            let base_noise = encoders.base_noise(&array, &array.sidecar.whiskers[whisker].mount);
            let (array, recorded, encoders) = (array.clone(), recorded.clone(), *encoders);
            (sidecar, Some(ArrayMember { array, whisker, recorded, encoders, base_noise }))
        };
        Ok(encoders.iter().map(trial).collect())
    }

    fn read(&mut self, path: PathBuf) -> anyhow::Result<Arc<ArrayRecording>> {
        if let Some(array) = self.0.get(&path) {
            return Ok(array.clone());
        }
        let array = Arc::new(ArrayRecording::read(&path)?);
        self.0.insert(path, array.clone());
        Ok(array)
    }

    /// Checks that the names of the recordings are distinct, and that there is at least one if encoders are given.
    ///
    /// # Errors
    /// If two recordings have the same name, or encoders are given without a recording.
    pub(super) fn check(&self, encoders: &[Encoders]) -> anyhow::Result<()> {
        check_distinct("recording", self.0.values().map(|array| array.sidecar.name.clone()))?;
        if !encoders.is_empty() && self.0.is_empty() {
            bail!("encoders: found no recording of an arm among the traces, expected at least one");
        }
        Ok(())
    }
}

/// Name of a trace or recording with some encoders.
fn name_with(name: &str, encoders: &Encoders) -> String {
    if encoders.are_perfect() { name.into() } else { format!("{name}_{}", encoders.label()) }
}

impl ArrayMember {
    /// The recording with its true outlines.
    pub(super) fn array(&self) -> &ArrayRecording {
        &self.array
    }

    /// Index of the whisker in the recording.
    pub(super) fn whisker(&self) -> usize {
        self.whisker
    }

    /// Name of the recording in the run.
    pub(super) fn recording(&self) -> String {
        name_with(&self.array.sidecar.name, &self.encoders)
    }

    /// Sidecar of the trace as it was recorded.
    pub(super) fn recorded(&self) -> &Arc<Sidecar> {
        &self.recorded
    }

    /// Noise of the pose of the whisker's base as the encoders measure it.
    pub(super) fn base_noise(&self) -> BaseNoise {
        self.base_noise
    }

    /// The trace with the base poses that the encoders measure under a seed.
    pub(super) fn measured<'a>(&self, trace: &'a Trace, seed: u64) -> Cow<'a, Trace> {
        if self.encoders.are_perfect() {
            return Cow::Borrowed(trace);
        }
        let mount = &self.array.sidecar.whiskers[self.whisker].mount;
        let recording = self.encoders.measured(&self.array, mount, &trace.recording, seed);
        Cow::Owned(Trace { recording, sidecar: trace.sidecar.clone(), truth: trace.truth.clone() })
    }
}

/// The recordings of an evaluation, as listed in `run.json`.
pub(super) fn recordings<'a>(
    trials: impl Iterator<Item = (&'a Sidecar, &'a ArrayMember)>,
    config: MapConfig,
) -> Vec<RunRecording> {
    let mut recordings: Vec<RunRecording> = Vec::new();
    for (of_trace, member) in trials {
        let name = member.recording();
        let sidecar = &member.array.sidecar;
        let whisker = &sidecar.whiskers[member.whisker];
        let (of_whisker, array) = (whisker.name.clone(), whisker.array.clone());
        let entry = RunMounted { name: of_whisker, array, trace: of_trace.name.clone() };
        match recordings.iter_mut().find(|recording| recording.name == name) {
            Some(recording) => recording.whiskers.push(entry),
            None => recordings.push(RunRecording {
                name,
                group: of_trace.group.clone(),
                encoders: member.encoders,
                map: config,
                objects: sidecar.objects.iter().map(|object| object.name.clone()).collect(),
                whiskers: vec![entry],
            }),
        }
    }
    recordings
}

/// The contents of the recordings besides their traces, as inputs of the run's hash.
///
/// # Errors
/// If a sidecar does not serialise.
pub(super) fn inputs<'a>(members: impl Iterator<Item = &'a ArrayMember>) -> anyhow::Result<Vec<String>> {
    let arrays: BTreeMap<&str, &ArrayMember> =
        members.map(|member| (member.array.sidecar.name.as_str(), member)).collect();
    arrays.values().map(|member| Ok(serde_json::to_string(&member.array.sidecar)?)).collect()
}
