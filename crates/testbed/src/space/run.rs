//! Runs of evaluations in space: a folder with the tables and a description of the inputs.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

use anyhow::Context;
use files::{Watermark, read_json, sha256_of_file, write_atomically, write_json};
use indicatif::ProgressBar;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use serde_json::Value;
use trace::{Role, SpatialSidecar, StatedSuspension};
use whisker::Whisker;

use super::SpatialEstimateRow;
use super::evaluate::{
    SpatialEvaluateSettings, SpatialEvaluated, SpatialSummaryRow, SpatialTimesRow, SpatialTrialRow, evaluate_keeping,
};
use super::map::{SpatialMap, Sweep};
use super::participant::described;
use super::solid::Solid;
use crate::dataset::Dataset;
use crate::evaluate::previous::{check_same, difference, of_lists, seeds};
use crate::provenance::evaluation_watermark;
use crate::results::{FailureRow, csv_bytes, read_rows};
use crate::statistics;

const RUN: &str = "space_run.json";
const TRIALS: &str = "space_trials.csv";
const SUMMARY: &str = "space_summary.csv";
const TIMES: &str = "space_times.csv";
const FAILURES: &str = "space_failures.csv";
const ESTIMATES: &str = "space_estimates";

const MAPS: &str = "space_maps";
const MAP_SCORES: &str = "space_maps.csv";

/// Estimates of a run that is being evaluated.
const ESTIMATES_PART: &str = ".space_estimates.part";

/// Name of the table of the estimates of one estimator on one trace.
pub(super) fn estimates_file(trace: &str, estimator: &str) -> String {
    format!("{trace}.{estimator}.csv")
}

/// A trial of a run in space.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SpatialRunTrial {
    /// Name of the trace.
    pub trace: String,
    /// Group of the trace.
    pub group: String,
    /// Whisker of the trace.
    pub whisker: SpatialRunWhisker,
    /// Description of the touched solid. Its schema belongs to the generator.
    pub solid: Value,
}

/// A whisker of a run in space.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SpatialRunWhisker {
    /// Whisker in its own plane.
    pub whisker: Whisker,
    /// Springs at the root.
    pub suspension: StatedSuspension,
    /// Poisson ratio of the wire.
    pub poisson_ratio: f64,
}

/// Description of a run in space, `space_run.json`.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SpatialRun {
    /// Program and hash of the inputs.
    pub watermark: Watermark,
    /// Name of the dataset.
    pub name: String,
    /// Measurement noise of both moments, as a fraction of the largest moment of each group of trials with one whisker.
    pub noise: f64,
    /// Seeds of the noise.
    pub seeds: Vec<u64>,
    /// Estimators by name, with their settings.
    pub estimators: BTreeMap<String, Value>,
    /// The trials.
    pub trials: Vec<SpatialRunTrial>,
}

impl SpatialRun {
    /// Description of the run that a dataset and settings determine.
    ///
    /// # Errors
    /// If an input cannot be read, or an estimator is unknown or its settings are invalid.
    fn new(dataset: &Dataset, settings: &SpatialEvaluateSettings) -> anyhow::Result<Self> {
        let estimators = described(settings)?;
        let (mut trials, mut data) = (Vec::new(), Vec::new());
        let folder = settings.calibrations(dataset);
        for path in &dataset.paths {
            let sidecar = SpatialSidecar::read(path)?;
            if sidecar.role == Role::Trial {
                data.push(sidecar.data_sha256());
                data.push(sha256_of_file(&folder.join(format!("{}.json", sidecar.whisker.name)))?);
                let SpatialSidecar { name, group, whisker, suspension, poisson_ratio, scene, .. } = sidecar;
                let whisker = SpatialRunWhisker { whisker, suspension, poisson_ratio };
                let solid = scene.get("solid").cloned().unwrap_or_default();
                trials.push(SpatialRunTrial { trace: name, group, whisker, solid });
            }
        }
        data.push(serde_json::to_string(&(settings.noise, &settings.seeds, &estimators))?);
        Ok(Self {
            watermark: evaluation_watermark(data.iter().map(String::as_str)),
            name: dataset.name.clone(),
            noise: settings.noise,
            seeds: settings.seeds.clone(),
            estimators,
            trials,
        })
    }

    /// Reads the description of the run in a folder. `None` if the folder holds no run in space.
    ///
    /// # Errors
    /// If it cannot be read.
    pub fn read(folder: &Path) -> anyhow::Result<Option<Self>> {
        let path = folder.join(RUN);
        Ok(if path.is_file() { Some(read_json(&path)?) } else { None })
    }

    /// One row per group, whisker and estimator of the run in a folder.
    ///
    /// # Errors
    /// If the table cannot be read.
    pub fn summary(folder: &Path) -> anyhow::Result<Vec<SpatialSummaryRow>> {
        read_rows(&folder.join(SUMMARY))
    }

    /// One row per trace, estimator and seed of the run in a folder.
    ///
    /// # Errors
    /// If the table cannot be read.
    pub fn trials(folder: &Path) -> anyhow::Result<Vec<SpatialTrialRow>> {
        read_rows(&folder.join(TRIALS))
    }

    /// Times of the steps of the run in a folder, one row per estimator. They depend on the machine.
    ///
    /// # Errors
    /// If the table cannot be read.
    pub fn times(folder: &Path) -> anyhow::Result<Vec<SpatialTimesRow>> {
        read_rows(&folder.join(TIMES))
    }

    /// Estimates of one estimator on one trace with the first seed, at evenly spaced instants.
    ///
    /// # Errors
    /// If the table cannot be read.
    pub fn estimates(folder: &Path, trace: &str, estimator: &str) -> anyhow::Result<Vec<SpatialEstimateRow>> {
        read_rows(&folder.join(ESTIMATES).join(estimates_file(trace, estimator)))
    }

    /// Trials on which an external program failed, of the run in a folder.
    ///
    /// # Errors
    /// If the table cannot be read.
    pub fn failures(folder: &Path) -> anyhow::Result<Vec<FailureRow>> {
        read_rows(&folder.join(FAILURES))
    }

    /// Differences in settings from another run.
    fn differences(&self, new: &Self) -> Vec<String> {
        let names = |run: &Self| run.estimators.keys().cloned().collect();
        let traces = |run: &Self| run.trials.iter().map(|trial| trial.trace.clone()).collect();
        let changed = |(name, config): &(&String, &Value)| new.estimators.get(*name).is_some_and(|new| new != *config);
        let lists = [
            difference("noise", &self.noise.to_string(), &new.noise.to_string()),
            difference("seeds", &seeds(&self.seeds), &seeds(&new.seeds)),
            of_lists("estimators", names(self), names(new)),
            of_lists("traces", traces(self), traces(new)),
        ];
        let settings = self.estimators.iter().filter(changed).map(|(name, _)| format!("settings of `{name}`"));
        lists.into_iter().flatten().chain(settings).collect()
    }
}

/// Map of one solid by one estimator, against the true solid.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SpatialMapRow {
    /// Names of the traces of the sweeps over the solid, joined by `+`.
    pub traces: String,
    /// Name of the estimator.
    pub estimator: String,
    /// Number of points of the surface.
    pub points: usize,
    /// Number of estimates left out of the map.
    pub left_out: usize,
    /// Number of objects found; there is one.
    pub objects: usize,
    /// Mean distance of the points from the true solid, not aligned. `None` for meshes and without points.
    pub mean_m: Option<f64>,
    /// 95th percentile of that distance.
    pub p95_m: Option<f64>,
}

/// Writes the maps of a run from its tables of estimates, one of each solid by each estimator, and their scores.
fn write_maps(folder: &Path, run: &SpatialRun) -> anyhow::Result<()> {
    let maps = folder.join(MAPS);
    remove(&maps)?;
    fs::create_dir_all(&maps).with_context(|| maps.display().to_string())?;
    let mut solids: Vec<(&Value, Vec<&SpatialRunTrial>)> = Vec::new();
    for trial in &run.trials {
        match solids.iter_mut().find(|(solid, _)| **solid == trial.solid) {
            Some((_, trials)) => trials.push(trial),
            None => solids.push((&trial.solid, vec![trial])),
        }
    }
    let work: Vec<_> = solids
        .iter()
        .flat_map(|(solid, trials)| run.estimators.keys().map(move |estimator| (*solid, trials, estimator)))
        .collect();
    let scores: Vec<anyhow::Result<SpatialMapRow>> = work
        .par_iter()
        .map(|(description, trials, estimator)| {
            let tables = trials.iter().map(|trial| SpatialRun::estimates(folder, &trial.trace, estimator));
            let tables: Vec<Vec<SpatialEstimateRow>> = tables.collect::<anyhow::Result<_>>()?;
            let sweeps: Vec<Sweep<'_>> =
                trials.iter().zip(&tables).map(|(trial, rows)| Sweep { whisker: &trial.whisker, rows }).collect();
            let map = SpatialMap::new(&sweeps)?;
            let traces = trials.iter().map(|trial| trial.trace.as_str()).collect::<Vec<_>>().join("+");
            let file = |kind: &str| maps.join(format!("{traces}.{estimator}.{kind}"));
            write_atomically(&file("ply"), map.to_ply().as_bytes())?;
            write_atomically(&file("glb"), &map.to_glb())?;
            write_atomically(&file("voxels.csv"), &csv_bytes(&map.voxels)?)?;
            let distances = Solid::of_scene(description).map(|solid| map.distances_m(&solid)).unwrap_or_default();
            Ok(SpatialMapRow {
                traces,
                estimator: (*estimator).clone(),
                points: map.points.len(),
                left_out: map.left_out,
                objects: map.objects(),
                mean_m: statistics::mean(distances.iter().copied()),
                p95_m: statistics::quantile_of_sorted(&distances, 0.95),
            })
        })
        .collect();
    let scores: Vec<SpatialMapRow> = scores.into_iter().collect::<anyhow::Result<_>>()?;
    Ok(write_atomically(&folder.join(MAP_SCORES), &csv_bytes(&scores)?)?)
}

/// A run in space that has been written, or was found up to date.
#[derive(Clone, Debug)]
pub struct SpatialWritten {
    /// One row per group, whisker and estimator.
    pub summary: Vec<SpatialSummaryRow>,
    /// Times of the steps, one row per estimator.
    pub times: Vec<SpatialTimesRow>,
    /// Trials on which an external program failed.
    pub failures: Vec<FailureRow>,
    /// Whether it was evaluated. `false` if it was found up to date.
    pub is_new: bool,
}

/// Evaluates a dataset and writes the tables into a folder, unless a run with the same inputs is there. A finished run with
/// the same settings is replaced when its traces, its calibrations or the code have changed; one with other settings only
/// if `force` is set.
///
/// # Errors
/// As [`super::evaluate::evaluate()`], and if a finished run has other settings or a file cannot be written.
pub fn evaluate_into(
    folder: &Path,
    dataset: &Dataset,
    settings: &SpatialEvaluateSettings,
    force: bool,
    progress: &ProgressBar,
) -> anyhow::Result<SpatialWritten> {
    let [run_path, trials_path, summary_path, times_path, failures_path] =
        [RUN, TRIALS, SUMMARY, TIMES, FAILURES].map(|name| folder.join(name));
    let run = SpatialRun::new(dataset, settings)?;
    if run_path.is_file() {
        let old: Result<SpatialRun, _> = read_json(&run_path);
        if old.as_ref().is_ok_and(|old| old.watermark.inputs_sha256 == run.watermark.inputs_sha256)
            && let (Ok(_), Ok(summary)) = (SpatialRun::trials(folder), SpatialRun::summary(folder))
            && let (Ok(times), Ok(failures)) = (SpatialRun::times(folder), SpatialRun::failures(folder))
        {
            return Ok(SpatialWritten { summary, times, failures, is_new: false });
        }
        if !force {
            check_same(folder, old.map(|old| old.differences(&run)).map_err(Into::into))?;
        }
    }
    // Estimates are written while they are computed, beside those of a former run, which is complete until the tables come.
    let [estimates, part] = [ESTIMATES, ESTIMATES_PART].map(|name| folder.join(name));
    remove(&part)?;
    fs::create_dir_all(&part).with_context(|| part.display().to_string())?;
    let evaluated = evaluate_keeping(dataset, settings, Some(&part), progress)?;
    // The description goes first and comes last, so that it never stands beside tables of another run.
    if run_path.is_file() {
        fs::remove_file(&run_path).with_context(|| run_path.display().to_string())?;
    }
    remove(&estimates)?;
    fs::rename(&part, &estimates).with_context(|| estimates.display().to_string())?;
    write_maps(folder, &run)?;
    write_atomically(&trials_path, &csv_bytes(&evaluated.trials)?)?;
    write_atomically(&summary_path, &csv_bytes(&evaluated.summary)?)?;
    write_atomically(&times_path, &csv_bytes(&evaluated.times)?)?;
    write_atomically(&failures_path, &csv_bytes(&evaluated.failures)?)?;
    write_json(&run_path, &run)?;
    let SpatialEvaluated { summary, times, failures, .. } = evaluated;
    Ok(SpatialWritten { summary, times, failures, is_new: true })
}

/// Removes a folder, if it is there.
fn remove(folder: &Path) -> anyhow::Result<()> {
    if folder.is_dir() {
        fs::remove_dir_all(folder).with_context(|| folder.display().to_string())?;
    }
    Ok(())
}

impl SpatialEvaluateSettings {
    /// Folder of the calibrations.
    pub(super) fn calibrations(&self, dataset: &Dataset) -> PathBuf {
        let default = || dataset.calibrations(crate::front_end::FRONT_ENDS[0].name);
        self.calibrations.clone().unwrap_or_else(default)
    }
}
