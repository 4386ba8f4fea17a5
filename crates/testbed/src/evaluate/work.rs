//! Doing the items of a batch.
//!
//! Threads take the items in their order, so that few scenes are in work at a time; only these are in memory. Within an item the trials run in parallel too,
//! for the threads that find no item any more.

use std::any::Any;
use std::collections::VecDeque;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, OnceLock, PoisonError};

use indicatif::ProgressBar;
use rayon::prelude::*;
use trace::{Trace, Truth};
use whisker::estimators::Sample;

use super::arrays::{self, Sighting};
use super::plan::{Item, Plan, Share};
use super::shards::{Shard, Shards, Yield};
use super::{Bench, BenchTrial, EvaluateSettings};
use crate::bound::TraceBound;
use crate::metrics::GroundTruth;
use crate::replay::motions;
use crate::results::FailureRow;

/// A trace in work, with what all of its seeds have in common.
pub(super) struct Member<'a> {
    pub(super) trial: &'a BenchTrial,
    pub(super) trace: Trace,
    /// Samples without readings, where the robot knows its motion as it is.
    pub(super) motions: Vec<Sample>,
    /// What the truth tells of it, seen with that motion.
    pub(super) ground_truth: GroundTruth,
    /// What no estimator can do better than, by noise level.
    bounds: Vec<OnceLock<Option<TraceBound>>>,
}

impl<'a> Member<'a> {
    fn read(trial: &'a BenchTrial, levels: usize) -> Result<Self, String> {
        let trace = Trace::read(&trial.path).map_err(|error| error.to_string())?;
        if trace.sidecar.csv_sha256 != trial.sidecar.csv_sha256 {
            return Err(format!("{}: has changed since the evaluation began", trial.path.display()));
        }
        let trace = Trace { sidecar: trial.sidecar.clone(), ..trace };
        let motions = motions(&trace.recording);
        let ground_truth = GroundTruth::new(&trace, trial.outline.as_ref(), &trace.sidecar.whisker.rest_shape());
        Ok(Self { trial, trace, motions, ground_truth, bounds: (0..levels).map(|_| OnceLock::new()).collect() })
    }

    /// Whether it is another whisker of the same board.
    pub(super) fn is_beside(&self, other: &Self) -> bool {
        let (one, other) = (&self.trial.mounting, &other.trial.mounting);
        one.array == other.array && one.sensor != other.sensor
    }

    /// What it truly did, with its place among the whiskers of a recording.
    fn truth(&self) -> Option<(usize, &Truth)> {
        Some((self.trial.mounted.as_ref()?.whisker(), &self.trace.truth))
    }

    /// The bound at a noise level, which is found once.
    pub(super) fn bound(&self, level: usize, find: impl FnOnce() -> Option<TraceBound>) -> Option<&TraceBound> {
        self.bounds[level].get_or_init(find).as_ref()
    }
}

/// The traces of a scene, or why one cannot be read: then the others lack what it did beside them.
type Scene<'a> = Result<Vec<Member<'a>>, String>;

/// The scenes in work, by their places in the plan.
struct InWork<'a>(Mutex<VecDeque<Kept<'a>>>);

/// A scene, which the first who needs it reads.
type Kept<'a> = (usize, Arc<OnceLock<Scene<'a>>>);

impl<'a> InWork<'a> {
    /// The place of a scene; of the others only as many stay as there are threads.
    fn slot(&self, scene: usize) -> Arc<OnceLock<Scene<'a>>> {
        let mut kept = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some((_, slot)) = kept.iter().find(|(place, _)| *place == scene) {
            return slot.clone();
        }
        if kept.len() == rayon::current_num_threads() {
            kept.pop_front();
        }
        let slot = Arc::<OnceLock<Scene<'a>>>::default();
        kept.push_back((scene, slot.clone()));
        slot
    }
}

/// What a function gives, or what it said as it panicked.
pub(super) fn caught<T>(work: impl FnOnce() -> T) -> Result<T, String> {
    let words = |panic: Box<dyn Any + Send>| {
        let text = panic.downcast_ref::<&str>().map(|text| (*text).to_owned());
        text.or_else(|| panic.downcast_ref::<String>().cloned()).unwrap_or_else(|| "no reason given".into())
    };
    catch_unwind(AssertUnwindSafe(work)).map_err(|panic| format!("broke down: {}", words(panic)))
}

impl Bench {
    /// Cuts the work into items.
    pub(super) fn plan(&self, settings: &EvaluateSettings) -> Plan {
        Plan::new(self.trials.iter().map(BenchTrial::scene), settings.noise.len(), settings.seeds.len())
    }

    /// Does all items that are not done yet, or those of a share. A trial that fails is no error; its failure is part of what the item yields.
    ///
    /// # Errors
    /// If something cannot be written. What is finished stays.
    pub(super) fn finish_items(
        &self,
        plan: &Plan,
        share: Option<Share>,
        (folder, shards): (&Path, &Shards),
        settings: &EvaluateSettings,
        progress: &ProgressBar,
    ) -> anyhow::Result<()> {
        let is_mine = |item: &usize| share.is_none_or(|share| share.has(*item));
        let mine: Vec<usize> = (0..plan.items.len()).filter(is_mine).collect();
        let todo: Vec<usize> = mine.par_iter().copied().filter(|&item| !shards.has(item)).collect();
        let trials = |items: &[usize]| items.iter().map(|&item| plan.trials_of(&plan.items[item]) as u64).sum::<u64>();
        progress.set_length(trials(&mine));
        progress.set_position(trials(&mine) - trials(&todo));
        progress.reset_eta();
        let in_work = InWork(Mutex::default());
        let next = AtomicUsize::new(0);
        let work = || -> anyhow::Result<()> {
            while let Some(&index) = todo.get(next.fetch_add(1, Ordering::Relaxed)) {
                let item = &plan.items[index];
                let shard = self.item(plan, item, &in_work, folder, settings);
                let kept = shard.and_then(|shard| shards.write(index, &shard));
                // Nobody begins another item after an error.
                kept.inspect_err(|_| next.store(todo.len(), Ordering::Relaxed))?;
                progress.inc(plan.trials_of(item) as u64);
            }
            Ok(())
        };
        rayon::broadcast(|_| work()).into_iter().collect()
    }

    fn item<'a>(
        &'a self,
        plan: &Plan,
        item: &Item,
        in_work: &InWork<'a>,
        folder: &Path,
        settings: &EvaluateSettings,
    ) -> anyhow::Result<Shard> {
        let slot = in_work.slot(item.scene);
        let members = &plan.scenes[item.scene];
        let levels = settings.noise.len();
        let read =
            || caught(|| members.iter().map(|&trial| Member::read(&self.trials[trial], levels)).collect()).flatten();
        let scene = slot.get_or_init(read);
        let jobs: Vec<(usize, usize)> =
            (0..members.len()).flat_map(|member| item.seeds.clone().map(move |seed| (member, seed))).collect();
        let replayed: Vec<(Yield, Vec<Sighting>)> = jobs
            .into_par_iter()
            .map(|(member, seed)| {
                let is_first = item.level == 0 && seed == 0;
                let (noise, seed) = (settings.noise[item.level], settings.seeds[seed]);
                let failed = |reason| {
                    let trace = self.trials[members[member]].sidecar.name.clone();
                    let failure = FailureRow { trace, estimator: None, noise, seed, reason };
                    Ok((Yield { failures: vec![failure], ..Yield::default() }, Vec::new()))
                };
                let scene = match scene {
                    Ok(scene) => scene.as_slice(),
                    Err(reason) => return failed(reason.clone()),
                };
                let out = is_first.then_some(folder);
                caught(|| self.run_trial((&scene[member], scene), item.level, seed, settings, out))
                    .unwrap_or_else(failed)
            })
            .collect::<anyhow::Result<_>>()?;
        let (mut shard, sightings): (Shard, Vec<Vec<Sighting>>) = replayed.into_iter().unzip();
        let sightings: Vec<Sighting> = sightings.into_iter().flatten().collect();
        let truths = scene.iter().flatten().filter_map(Member::truth).collect();
        let (maps, objects) = arrays::maps(folder, &sightings, &truths, settings)?;
        for (done, &seed) in shard.iter_mut().zip(&settings.seeds[item.seeds.clone()]) {
            done.maps = maps.iter().filter(|map| map.seed == seed).cloned().collect();
            done.map_objects = objects.iter().filter(|object| object.seed == seed).cloned().collect();
        }
        Ok(shard)
    }
}
