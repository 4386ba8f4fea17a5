//! Expected duration of an evaluation, from a probe: the start of one trial through all estimators.

use std::time::{Duration, Instant};

use super::job::TrialJob;
use super::loaded_trial::{LoadedTrial, caught};
use super::plan::Item;
use super::work::Batch;
use super::workload::Workload;

/// Instants of the probe: the start of one trial, with contact.
const PROBE_ROWS: usize = 750;

/// Work of less than this many probes is not worth one.
const LEAST_PROBES: usize = 20;

impl Batch<'_> {
    /// The work of some items.
    pub(super) fn workload(&self, items: &[usize]) -> Workload {
        let items: Vec<&Item> = items.iter().map(|&item| &self.plan.items[item]).collect();
        let threads = rayon::current_num_threads();
        let rows_of = |item: &&Item| {
            let rows = self.plan.scenes[item.scene].iter().map(|&trial| self.prepared.trials[trial].sidecar.rows);
            rows.sum::<usize>() * item.seeds.len()
        };
        let rows: usize = items.iter().map(rows_of).sum();
        let per_row = items.first().filter(|_| self.settings.programs.is_empty() && rows >= LEAST_PROBES * PROBE_ROWS);
        Workload {
            trials: items.iter().map(|item| self.plan.trials_of(item)).sum(),
            estimators: self.prepared.participants.len(),
            threads,
            duration: per_row
                .and_then(|item| self.probe(item))
                .map(|per_row| per_row.mul_f64(rows as f64 / threads as f64)),
        }
    }

    /// Time per instant of a trial through all estimators on one thread. `None` if the trial cannot be run.
    fn probe(&self, item: &Item) -> Option<Duration> {
        let levels = self.settings.noise.len();
        let members = self.plan.scenes[item.scene].iter();
        let read = || members.map(|&trial| LoadedTrial::read(&self.prepared.trials[trial], levels)).collect();
        let mut scene: Vec<LoadedTrial<'_>> = caught(read).flatten().ok()?;
        scene.iter_mut().for_each(|loaded| loaded.truncate(PROBE_ROWS));
        let loaded = scene.first()?;
        let rows = loaded.trace.recording.instants.len();
        let seed = *self.settings.seeds.get(item.seeds.start)?;
        let (prepared, settings) = (self.prepared, self.settings);
        let job = TrialJob { prepared, settings, loaded, scene: &scene, level: item.level, seed, out: None };
        let begun = Instant::now();
        caught(|| job.run()).ok()?.ok()?;
        Some(begun.elapsed().div_f64(rows.max(1) as f64))
    }
}
