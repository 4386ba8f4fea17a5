//! Runs of evaluations in space: a folder with the tables and a description of the inputs.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use files::{sha256_of_file, write_atomically, write_json};
use indicatif::ProgressBar;
use rayon::prelude::*;
use serde_json::Value;
use testbed::dataset::Dataset;
use testbed::front_end::{SPATIAL_FRONT_ENDS, SpatialFrontEnd};
use testbed::results::files::RunFile;
use testbed::results::{FailureRow, ResultsKind, csv_bytes};
use testbed::space::SpatialEstimateRow;
use testbed::space::files::{
    FAILURES, MAP_POINTS, MAP_SCENE, MAP_SCORES, MAP_SURFACE, MAP_VOXELS, RUN, SUMMARY, TIMES, TRIALS,
};
use testbed::space::map::{SpatialMap, Sweep};
use testbed::space::rows::{SpatialMapRow, SpatialSummaryRow, SpatialTimesRow, SpatialTrialRow};
use testbed::space::run::{
    SpatialRun, SpatialRunCalibration, SpatialRunMounting, SpatialRunTrial, SpatialRunWhisker, SweptSolid,
};
use testbed::space::solid::Solid;
use testbed::statistics;
use trace::{LearntMounting, Role, SpatialSidecar};

use super::evaluate::{
    Calibrations, SpatialEvaluateSettings, SpatialEvaluated, calibrated_trials, evaluate_keeping, remarks,
};
use super::participant::described;
use crate::evaluate::part_folder::{PartFolder, restore, tidy};
use crate::evaluate::previous::{check_same, difference, of_lists, seeds};
use crate::provenance::{evaluation_watermark, scored_inputs};
use crate::remarks::TrialRemarks;

/// Description of the run that a dataset and settings determine, and the calibrations that it reads.
///
/// # Errors
/// If an input cannot be read, an estimator or front end is unknown or its settings are invalid, or a calibration was made
/// through another front end.
fn described_run(dataset: &Dataset, settings: &SpatialEvaluateSettings) -> anyhow::Result<(SpatialRun, Calibrations)> {
    let estimators = described(settings)?;
    let front_end = SpatialFrontEnd::new(&settings.front_end)?;
    let (mut trials, mut data) = (Vec::new(), Vec::new());
    let calibrations = settings.calibrations(dataset)?;
    let mut hashes: BTreeMap<&str, String> = BTreeMap::new();
    let (mut sensors, mut described_calibrations) = (Vec::new(), Vec::new());
    for (whisker, (path, file)) in &calibrations {
        let sha256 = sha256_of_file(path)?;
        hashes.insert(whisker, sha256.clone());
        described_calibrations.push(SpatialRunCalibration {
            whisker: whisker.clone(),
            model: file.chosen.clone(),
            sha256,
            heldout_rms_n_m: file.model(None).map(|model| model.heldout_rms_n_m),
            mounting: file.mounting.as_ref().map(|LearntMounting { traces, data_sha256, .. }| SpatialRunMounting {
                traces: traces.clone(),
                data_sha256: data_sha256.clone(),
            }),
        });
        sensors.extend(front_end.sensor(path, file)?.cloned());
    }
    let front_end = front_end.describe(sensors);
    for path in &dataset.paths {
        let sidecar = SpatialSidecar::read(path)?;
        if sidecar.role == Role::Trial {
            data.push(scored_inputs(&sidecar.data_sha256(), &sidecar.scene));
            data.push(hashes[sidecar.whisker.name.as_str()].clone());
            let SpatialSidecar { name, group, whisker, suspension, poisson_ratio, scene, .. } = sidecar;
            let whisker = SpatialRunWhisker { whisker, suspension, poisson_ratio };
            let solid = scene.get("solid").cloned().unwrap_or_default();
            trials.push(SpatialRunTrial { trace: name, group, whisker, solid });
        }
    }
    data.push(serde_json::to_string(&(settings.noise, &settings.seeds, &front_end, &estimators))?);
    let run = SpatialRun {
        watermark: evaluation_watermark(data.iter().map(String::as_str)),
        name: dataset.name.clone(),
        noise: settings.noise,
        seeds: settings.seeds.clone(),
        front_end,
        calibrations: described_calibrations,
        estimators,
        trials,
    };
    Ok((run, calibrations))
}

/// Whether a folder has all files of the run.
fn is_complete(run: &SpatialRun, folder: &Path) -> bool {
    run.files().iter().all(|name| folder.join(name).is_file())
}

/// Differences in settings between two runs.
fn differences(old: &SpatialRun, new: &SpatialRun) -> Vec<String> {
    let names = |run: &SpatialRun| run.estimators.keys().cloned().collect();
    let traces = |run: &SpatialRun| run.trials.iter().map(|trial| trial.trace.clone()).collect();
    let changed = |(name, config): &(&String, &Value)| new.estimators.get(*name).is_some_and(|new| new != *config);
    let lists = [
        difference("noise", &old.noise.to_string(), &new.noise.to_string()),
        difference("seeds", &seeds(&old.seeds), &seeds(&new.seeds)),
        difference("front end", &front_end(old), &front_end(new)),
        difference("mounting", &mountings(old), &mountings(new)),
        of_lists("estimators", names(old), names(new)),
        of_lists("traces", traces(old), traces(new)),
    ];
    let settings = old.estimators.iter().filter(changed).map(|(name, _)| format!("settings of `{name}`"));
    lists.into_iter().flatten().chain(settings).collect()
}

/// Front end of a run, for messages.
fn front_end(run: &SpatialRun) -> String {
    run.front_end.as_ref().map_or_else(|| SPATIAL_FRONT_ENDS[0].name.into(), |of| format!("{} {}", of.name, of.config))
}

/// Mountings of a run, for messages: for each whisker with a learnt mounting, the traces from which it was learnt and the first
/// digits of the hash of their data.
fn mountings(run: &SpatialRun) -> String {
    let learnt = run.calibrations.iter().filter_map(|of| Some((&of.whisker, of.mounting.as_ref()?)));
    let learnt = learnt.map(|(whisker, SpatialRunMounting { traces, data_sha256 })| {
        format!("that of `{whisker}` learnt from {} ({data_sha256:.8})", traces.join(", "))
    });
    let learnt: Vec<String> = learnt.collect();
    if learnt.is_empty() { "that of the calibrations".into() } else { learnt.join("; ") }
}

/// Writes the maps of a run from its tables of estimates, one of each solid by each estimator, and their scores.
fn write_maps(folder: &Path, run: &SpatialRun) -> anyhow::Result<()> {
    let solids = run.solids();
    let work: Vec<_> =
        solids.iter().flat_map(|solid| run.estimators.keys().map(move |estimator| (solid, estimator))).collect();
    let scores: Vec<anyhow::Result<SpatialMapRow>> = work
        .par_iter()
        .map(|(swept, estimator)| {
            let SweptSolid { solid, trials } = swept;
            let tables = trials.iter().map(|trial| SpatialRun::estimates(folder, &trial.trace, estimator));
            let tables: Vec<Vec<SpatialEstimateRow>> = tables.collect::<anyhow::Result<_>>()?;
            let sweeps: Vec<Sweep<'_>> =
                trials.iter().zip(&tables).map(|(trial, rows)| Sweep { whisker: &trial.whisker, rows }).collect();
            let map = SpatialMap::new(&sweeps)?;
            let traces = swept.traces();
            let path = |file: RunFile| file.path_of(folder, &[&traces, estimator]);
            write_atomically(&path(MAP_POINTS), map.to_ply().as_bytes())?;
            write_atomically(&path(MAP_SURFACE), map.surface.to_ply().as_bytes())?;
            write_atomically(&path(MAP_SCENE), &map.to_glb())?;
            write_atomically(&path(MAP_VOXELS), &csv_bytes(&map.voxels)?)?;
            let solid = Solid::of_scene(solid);
            let distances = solid.as_ref().map(|solid| map.distances_m(solid)).unwrap_or_default();
            let surface = solid.map(|solid| map.surface.score(&solid));
            Ok(SpatialMapRow {
                traces,
                estimator: (*estimator).clone(),
                points: map.points.len(),
                left_out: map.left_out,
                objects: map.objects(),
                mean_m: statistics::mean(distances.iter().copied()),
                p95_m: statistics::quantile_of_sorted(&distances, 0.95),
                surface_m2: map.surface.area_m2(),
                surface_certain_m2: map.surface.certain_area_m2(),
                surface_mean_m: surface.and_then(|score| score.mean_m),
                surface_coverage: surface.and_then(|score| score.coverage),
            })
        })
        .collect();
    let scores: Vec<SpatialMapRow> = scores.into_iter().collect::<anyhow::Result<_>>()?;
    Ok(write_atomically(&MAP_SCORES.path(folder), &csv_bytes(&scores)?)?)
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
    /// Names of the trials from which a mounting was learnt.
    pub mounted: Vec<String>,
    /// Names of the trials without a known contact in the calibrated domain a second after a touch or later.
    pub unscored: Vec<String>,
    /// Remarks on the trials.
    pub remarks: TrialRemarks,
    /// Whether it was evaluated. `false` if it was found up to date.
    pub is_new: bool,
}

/// Evaluates a dataset and writes the tables into a folder, unless a run with the same inputs is there. A finished run with
/// the same settings is replaced when its traces, its calibrations or the code have changed; one with other settings only
/// if `force` is set. A run in which an external program failed, or a run of programs with `force`, is never up to date: what a
/// program imports is not known. Files of the user in the folder are kept.
///
/// # Errors
/// As [`super::evaluate::evaluate()`], and if the folder holds other results, a finished run has other settings or a file
/// cannot be written.
pub fn evaluate_into(
    folder: &Path,
    dataset: &Dataset,
    settings: &SpatialEvaluateSettings,
    force: bool,
    progress: &ProgressBar,
) -> anyhow::Result<SpatialWritten> {
    restore(folder)?;
    ResultsKind::SpatialRun.check_may_replace(folder)?;
    let (run, calibrations) = described_run(dataset, settings)?;
    let is_mounted = |trace: &&String| run.mountings().any(|mounting| mounting.traces.contains(trace));
    let mounted: Vec<String> = run.trials.iter().map(|trial| &trial.trace).filter(is_mounted).cloned().collect();
    if let Some(old) = SpatialRun::read(folder).transpose() {
        if old.as_ref().is_ok_and(|old| old.watermark.inputs_sha256 == run.watermark.inputs_sha256)
            && is_complete(&run, folder)
            && let (Ok(trials), Ok(summary)) = (SpatialRun::trials(folder), SpatialRun::summary(folder))
            && let (Ok(times), Ok(failures)) = (SpatialRun::times(folder), SpatialRun::failures(folder))
            && (settings.programs.is_empty() || failures.is_empty() && !force)
        {
            tidy(folder)?;
            let front_end = SpatialFrontEnd::new(&settings.front_end)?;
            let remarks = remarks(&calibrated_trials(dataset, &front_end, &calibrations)?);
            let unscored = unscored(&trials);
            return Ok(SpatialWritten { summary, times, failures, mounted, unscored, remarks, is_new: false });
        }
        if !force {
            check_same(folder, old.map(|old| differences(&old, &run)))?;
        }
    }
    let part = PartFolder::open(folder, &run.watermark.inputs_sha256)?;
    let evaluated = match write(part.path(), dataset, settings, (&run, &calibrations), progress) {
        Ok(evaluated) => evaluated,
        Err(error) => {
            part.discard()?;
            return Err(error);
        }
    };
    part.finish()?;
    let SpatialEvaluated { summary, times, failures, trials, remarks } = evaluated;
    Ok(SpatialWritten { summary, times, failures, mounted, unscored: unscored(&trials), remarks, is_new: true })
}

/// Names of the traces of which no instant is scored.
fn unscored(trials: &[SpatialTrialRow]) -> Vec<String> {
    let is_scored = |trial: &&SpatialTrialRow| trial.answered.is_some() || trial.rmse_m.is_some();
    let scored: BTreeSet<&str> = trials.iter().filter(is_scored).map(|trial| trial.trace.as_str()).collect();
    let all: BTreeSet<&str> = trials.iter().map(|trial| trial.trace.as_str()).collect();
    all.difference(&scored).map(|name| (*name).to_owned()).collect()
}

/// Evaluates a dataset and writes all files of the run into a folder.
fn write(
    folder: &Path,
    dataset: &Dataset,
    settings: &SpatialEvaluateSettings,
    (run, calibrations): (&SpatialRun, &Calibrations),
    progress: &ProgressBar,
) -> anyhow::Result<SpatialEvaluated> {
    let evaluated = evaluate_keeping(dataset, settings, calibrations, Some(folder), progress)?;
    write_maps(folder, run)?;
    write_atomically(&TRIALS.path(folder), &csv_bytes(&evaluated.trials)?)?;
    write_atomically(&SUMMARY.path(folder), &csv_bytes(&evaluated.summary)?)?;
    write_atomically(&TIMES.path(folder), &csv_bytes(&evaluated.times)?)?;
    write_atomically(&FAILURES.path(folder), &csv_bytes(&evaluated.failures)?)?;
    write_json(&RUN.path(folder), run)?;
    Ok(evaluated)
}
