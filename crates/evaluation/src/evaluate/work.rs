//! Parallel execution of the items of a batch.
//!
//! Threads take the items in their order, so that few scenes are in memory at a time. Within an item the trials run in
//! parallel too, for threads without an item of their own.

use std::collections::VecDeque;
use std::path::Path;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, OnceLock, PoisonError};

use indicatif::ProgressBar;
use rayon::prelude::*;
use testbed::results::FailureRow;

use super::job::{TrialJob, TrialOutput};
use super::loaded_trial::{LoadedTrial, caught};
use super::maps::{MapView, maps};
use super::memory::{MOST_ROWS, RunningRows, at_once};
use super::plan::{Item, Plan, Share};
use super::prepared::{Prepared, TrialSpec};
use super::settings::EvaluateSettings;
use super::shards::{Shard, Shards};

/// Trials of a scene, or the reason why one cannot be read. Without it the readings of the others are unknown.
type Scene<'a> = Result<Vec<LoadedTrial<'a>>, String>;

/// A scene, read by the first thread that needs it.
type SharedScene<'a> = Arc<OnceLock<Scene<'a>>>;

/// Scenes in memory, by their indices in the plan.
#[derive(Default)]
struct SceneCache<'a>(Mutex<VecDeque<Cached<'a>>>);

/// A scene in memory.
struct Cached<'a> {
    /// Index in the plan.
    index: usize,
    /// Rows of its traces.
    rows: usize,
    scene: SharedScene<'a>,
}

impl<'a> SceneCache<'a> {
    /// Entry of a scene with this many rows. Only as many scenes stay in memory as there are threads, and fewer long ones.
    fn entry(&self, index: usize, rows: usize) -> SharedScene<'a> {
        let mut cached = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(known) = cached.iter().find(|known| known.index == index) {
            return known.scene.clone();
        }
        let is_full = |cached: &VecDeque<Cached<'_>>| {
            cached.len() == rayon::current_num_threads()
                || cached.iter().map(|known| known.rows).sum::<usize>() + rows > MOST_ROWS
        };
        while !cached.is_empty() && is_full(&cached) {
            cached.pop_front();
        }
        let scene = SharedScene::default();
        cached.push_back(Cached { index, rows, scene: scene.clone() });
        scene
    }
}

impl Prepared {
    /// Divides the work into items.
    pub(super) fn plan(&self, settings: &EvaluateSettings) -> Plan {
        Plan::new(self.trials.iter().map(TrialSpec::scene), settings.noise.len(), settings.seeds.len())
    }
}

/// The work of an evaluation.
pub(super) struct Batch<'a> {
    pub(super) prepared: &'a Prepared,
    pub(super) settings: &'a EvaluateSettings,
    pub(super) plan: &'a Plan,
    pub(super) shards: &'a Shards,
    /// Folder in which the run is built.
    pub(super) folder: &'a Path,
}

impl<'a> Batch<'a> {
    /// Runs all items, or those of a share, that are not finished yet. The failure of a trial is part of the item's results.
    ///
    /// # Errors
    /// If a file cannot be written. Finished items are kept.
    pub(super) fn finish(&self, share: Option<Share>, progress: &ProgressBar) -> anyhow::Result<()> {
        let plan = self.plan;
        let is_mine = |item: &usize| share.is_none_or(|share| share.has(*item));
        let mine: Vec<usize> = (0..plan.items.len()).filter(is_mine).collect();
        let todo: Vec<usize> = mine.par_iter().copied().filter(|&item| !self.shards.has(item)).collect();
        let trials = |items: &[usize]| items.iter().map(|&item| plan.trials_of(&plan.items[item]) as u64).sum::<u64>();
        if let Some(on_start) = self.settings.on_start.filter(|_| !todo.is_empty()) {
            on_start(&self.workload(&todo));
        }
        progress.set_length(trials(&mine));
        progress.set_position(trials(&mine) - trials(&todo));
        progress.reset_eta();
        let (scenes, running) = (SceneCache::default(), RunningRows::default());
        let next = AtomicUsize::new(0);
        let work = || -> anyhow::Result<()> {
            while let Some(&index) = todo.get(next.fetch_add(1, Ordering::Relaxed)) {
                let item = &plan.items[index];
                let rows = self.rows_of(item.scene);
                let replays = plan.trials_of(item).min(at_once(rows)).min(rayon::current_num_threads());
                let _permit = running.permit(rows * replays);
                let shard = self.run_item(item, &scenes);
                let kept = shard.and_then(|shard| self.shards.write(index, &shard));
                // After an error no thread starts another item.
                kept.inspect_err(|_| next.store(todo.len(), Ordering::Relaxed))?;
                progress.inc(plan.trials_of(item) as u64);
            }
            Ok(())
        };
        rayon::broadcast(|_| work()).into_iter().collect()
    }

    fn run_item(&self, item: &Item, scenes: &SceneCache<'a>) -> anyhow::Result<Shard> {
        let rows = self.rows_of(item.scene);
        let entry = scenes.entry(item.scene, rows);
        let members = &self.plan.scenes[item.scene];
        let levels = self.settings.noise.len();
        let read = || {
            let trials = members.iter().map(|&trial| LoadedTrial::read(&self.prepared.trials[trial], levels));
            caught(|| trials.collect()).flatten()
        };
        let scene = entry.get_or_init(read);
        let jobs: Vec<(usize, usize)> =
            (0..members.len()).flat_map(|member| item.seeds.clone().map(move |seed| (member, seed))).collect();
        let mut outputs: Vec<TrialOutput> = Vec::new();
        for jobs in jobs.chunks(at_once(rows)) {
            let run = |&(member, seed): &(usize, usize)| self.run_trial(item, scene, member, seed);
            outputs.extend(jobs.par_iter().map(run).collect::<anyhow::Result<Vec<_>>>()?);
        }
        let (mut shard, views): (Shard, Vec<Vec<MapView>>) =
            outputs.into_iter().map(|output| (output.results, output.views)).unzip();
        let views: Vec<MapView> = views.into_iter().flatten().collect();
        let truths = scene.iter().flatten().filter_map(LoadedTrial::truth).collect();
        let maps = maps(self.folder, &views, &truths, self.settings)?;
        for (results, &seed) in shard.iter_mut().zip(&self.settings.seeds[item.seeds.clone()]) {
            results.maps = maps.maps.iter().filter(|map| map.seed == seed).cloned().collect();
            results.map_objects = maps.objects.iter().filter(|object| object.seed == seed).cloned().collect();
        }
        Ok(shard)
    }

    /// Rows of the traces of the scene with this index.
    fn rows_of(&self, scene: usize) -> usize {
        self.plan.scenes[scene].iter().map(|&trial| self.prepared.trials[trial].sidecar.rows).sum()
    }

    /// Runs the trial of a scene with this index under the seed with this index. A panic or an unreadable scene is a
    /// failure of the trial.
    fn run_trial(&self, item: &Item, scene: &Scene<'_>, member: usize, seed: usize) -> anyhow::Result<TrialOutput> {
        let is_first = item.level == 0 && seed == 0;
        let seed = self.settings.seeds[seed];
        let failed = |reason| {
            let spec = &self.prepared.trials[self.plan.scenes[item.scene][member]];
            let (trace, noise) = (spec.sidecar.name.clone(), self.settings.noise[item.level]);
            Ok(TrialOutput::failed(FailureRow { trace, estimator: None, noise, seed, reason }))
        };
        let scene = match scene {
            Ok(scene) => scene.as_slice(),
            Err(reason) => return failed(reason.clone()),
        };
        let job = TrialJob {
            prepared: self.prepared,
            settings: self.settings,
            loaded: &scene[member],
            scene,
            level: item.level,
            seed,
            out: is_first.then_some(self.folder),
        };
        caught(|| job.run()).unwrap_or_else(failed)
    }
}
