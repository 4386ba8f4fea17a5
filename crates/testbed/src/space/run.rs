//! Runs of evaluations in space: a folder with the tables and a description of the inputs.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

use anyhow::Context;
use files::{Watermark, read_json, sha256_of_file, write_atomically, write_json};
use indicatif::ProgressBar;
use serde::{Deserialize, Serialize};
use serde_json::Value;
use trace::{Role, SpatialSidecar};

use super::evaluate::{SpatialEvaluateSettings, SpatialSummaryRow, SpatialTrialRow, estimators, evaluate};
use crate::dataset::Dataset;
use crate::evaluate::previous::{check_same, difference, of_lists, seeds};
use crate::provenance::evaluation_watermark;
use crate::results::{csv_bytes, read_rows};

const RUN: &str = "space_run.json";
const TRIALS: &str = "space_trials.csv";
const SUMMARY: &str = "space_summary.csv";

/// Description of a run in space, `space_run.json`.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct SpatialRun {
    watermark: Watermark,
    noise: f64,
    seeds: Vec<u64>,
    /// Estimators by name, with their settings.
    estimators: BTreeMap<String, Value>,
    traces: Vec<String>,
}

impl SpatialRun {
    /// Description of the run that a dataset and settings determine.
    ///
    /// # Errors
    /// If an input cannot be read, or an estimator is unknown or its settings are invalid.
    fn new(dataset: &Dataset, settings: &SpatialEvaluateSettings) -> anyhow::Result<Self> {
        let rows = estimators(settings)?;
        let estimators: BTreeMap<String, Value> =
            rows.into_iter().map(|(row, config)| (row.name.to_owned(), config)).collect();
        let (mut traces, mut data) = (Vec::new(), Vec::new());
        let folder = settings.calibrations(dataset);
        for path in &dataset.paths {
            let sidecar = SpatialSidecar::read(path)?;
            if sidecar.role == Role::Trial {
                data.push(sidecar.data_sha256());
                data.push(sha256_of_file(&folder.join(format!("{}.json", sidecar.whisker.name)))?);
                traces.push(sidecar.name);
            }
        }
        data.push(serde_json::to_string(&(settings.noise, &settings.seeds, &estimators))?);
        Ok(Self {
            watermark: evaluation_watermark(data.iter().map(String::as_str)),
            noise: settings.noise,
            seeds: settings.seeds.clone(),
            estimators,
            traces,
        })
    }

    /// Differences in settings from another run.
    fn differences(&self, new: &Self) -> Vec<String> {
        let names = |run: &Self| run.estimators.keys().cloned().collect();
        let traces = |run: &Self| run.traces.iter().cloned().collect();
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

/// A run in space that has been written, or was found up to date.
#[derive(Clone, Debug)]
pub struct SpatialWritten {
    /// One row per group, whisker and estimator.
    pub summary: Vec<SpatialSummaryRow>,
    /// Mean wall-clock time of a step with an estimate (us) by estimator. `None` if the run was found up to date.
    pub step_us: Option<Vec<(String, Option<f64>)>>,
}

/// Evaluates a dataset and writes the tables into a folder, unless a run with the same inputs is there. A finished run with
/// the same settings is replaced when its traces, its calibrations or the code have changed; one with other settings only
/// if `force` is set.
///
/// # Errors
/// As [`evaluate()`], and if a finished run has other settings or a file cannot be written.
pub fn evaluate_into(
    folder: &Path,
    dataset: &Dataset,
    settings: &SpatialEvaluateSettings,
    force: bool,
    progress: &ProgressBar,
) -> anyhow::Result<SpatialWritten> {
    let [run_path, trials_path, summary_path] = [RUN, TRIALS, SUMMARY].map(|name| folder.join(name));
    let run = SpatialRun::new(dataset, settings)?;
    if run_path.is_file() {
        let old: Result<SpatialRun, _> = read_json(&run_path);
        if old.as_ref().is_ok_and(|old| old.watermark.inputs_sha256 == run.watermark.inputs_sha256)
            && let (Ok(_), Ok(summary)) = (read_rows::<SpatialTrialRow>(&trials_path), read_rows(&summary_path))
        {
            return Ok(SpatialWritten { summary, step_us: None });
        }
        if !force {
            check_same(folder, old.map(|old| old.differences(&run)).map_err(Into::into))?;
        }
    }
    let evaluated = evaluate(dataset, settings, progress)?;
    // The description goes first and comes last, so that it never stands beside tables of another run.
    if run_path.is_file() {
        fs::remove_file(&run_path).with_context(|| run_path.display().to_string())?;
    }
    write_atomically(&trials_path, &csv_bytes(&evaluated.trials)?)?;
    write_atomically(&summary_path, &csv_bytes(&evaluated.summary)?)?;
    write_json(&run_path, &run)?;
    Ok(SpatialWritten { summary: evaluated.summary, step_us: Some(evaluated.step_us) })
}

impl SpatialEvaluateSettings {
    /// Folder of the calibrations.
    pub(super) fn calibrations(&self, dataset: &Dataset) -> PathBuf {
        let default = || dataset.calibrations(crate::front_end::FRONT_ENDS[0].name);
        self.calibrations.clone().unwrap_or_else(default)
    }
}
