//! Description and tables of a run in space.

use std::collections::BTreeMap;
use std::path::Path;

use files::{Watermark, read_json};
use serde::{Deserialize, Serialize};
use serde_json::Value;
use trace::{SpatialFrontEndFile, StatedSuspension};
use whisker::Whisker;

use super::SpatialEstimateRow;
use super::files::{ESTIMATES, FAILURES, MAP_SCORES, RUN, SPATIAL_RUN_FILES, SUMMARY, TIMES, TRIALS};
use super::rows::{SpatialMapRow, SpatialSummaryRow, SpatialTimesRow, SpatialTrialRow};
use crate::results::files::{Per, RunFile, Writer};
use crate::results::{FailureRow, read_rows};

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

/// Calibration of a run in space.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SpatialRunCalibration {
    /// Whisker.
    pub whisker: String,
    /// Label of the sensor model.
    pub model: String,
    /// SHA-256 of the calibration file.
    pub sha256: String,
    /// Root mean square residual of a moment on held-out lines.
    pub heldout_rms_n_m: Option<f64>,
    /// The learnt mounting. `None` if it is that of the calibration.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub mounting: Option<SpatialRunMounting>,
}

/// A learnt mounting of a run in space.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SpatialRunMounting {
    /// Names of the traces from which it was learnt.
    pub traces: Vec<String>,
    /// Hash over the hashes of these traces.
    pub data_sha256: String,
}

/// Description of a run in space, `space_run.json`.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SpatialRun {
    /// Program and hash of the inputs.
    pub watermark: Watermark,
    /// Name of the dataset.
    pub name: String,
    /// White noise added to the moments, as a fraction of the largest moment of each group of trials with one whisker.
    pub noise: f64,
    /// Seeds of the noise and of the front end.
    pub seeds: Vec<u64>,
    /// Front end with its settings and the calibrations of its sensors. `None` if the readings are the moments with white noise.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub front_end: Option<SpatialFrontEndFile>,
    /// Calibrations, one per whisker. Empty in a run of an earlier version.
    #[serde(default)]
    pub calibrations: Vec<SpatialRunCalibration>,
    /// Estimators by name, with their settings.
    pub estimators: BTreeMap<String, Value>,
    /// The trials.
    pub trials: Vec<SpatialRunTrial>,
}

impl SpatialRun {
    /// The learnt mountings.
    pub fn mountings(&self) -> impl Iterator<Item = &SpatialRunMounting> {
        self.calibrations.iter().filter_map(|calibration| calibration.mounting.as_ref())
    }

    /// Reads the description of the run in a folder. `None` if the folder holds no run in space.
    ///
    /// # Errors
    /// If it cannot be read.
    pub fn read(folder: &Path) -> anyhow::Result<Option<Self>> {
        let path = RUN.path(folder);
        Ok(if path.is_file() { Some(read_json(&path)?) } else { None })
    }

    /// One row per group, whisker and estimator of the run in a folder.
    ///
    /// # Errors
    /// If the table cannot be read.
    pub fn summary(folder: &Path) -> anyhow::Result<Vec<SpatialSummaryRow>> {
        read_rows(&SUMMARY.path(folder))
    }

    /// One row per trace, estimator and seed of the run in a folder.
    ///
    /// # Errors
    /// If the table cannot be read.
    pub fn trials(folder: &Path) -> anyhow::Result<Vec<SpatialTrialRow>> {
        read_rows(&TRIALS.path(folder))
    }

    /// Times of the steps of the run in a folder, one row per estimator. They depend on the machine.
    ///
    /// # Errors
    /// If the table cannot be read.
    pub fn times(folder: &Path) -> anyhow::Result<Vec<SpatialTimesRow>> {
        read_rows(&TIMES.path(folder))
    }

    /// Estimates of one estimator on one trace with the first seed, at evenly spaced instants.
    ///
    /// # Errors
    /// If the table cannot be read.
    pub fn estimates(folder: &Path, trace: &str, estimator: &str) -> anyhow::Result<Vec<SpatialEstimateRow>> {
        read_rows(&ESTIMATES.path_of(folder, &[trace, estimator]))
    }

    /// Maps of the solids of the run in a folder, one row per solid and estimator.
    ///
    /// # Errors
    /// If the table cannot be read.
    pub fn maps(folder: &Path) -> anyhow::Result<Vec<SpatialMapRow>> {
        read_rows(&MAP_SCORES.path(folder))
    }

    /// Trials on which an external program failed, of the run in a folder.
    ///
    /// # Errors
    /// If the table cannot be read.
    pub fn failures(folder: &Path) -> anyhow::Result<Vec<FailureRow>> {
        read_rows(&FAILURES.path(folder))
    }

    /// Paths in the folder of the run of all files that `whisker evaluate` writes.
    pub fn files(&self) -> Vec<String> {
        let solids: Vec<String> = self.solids().iter().map(SweptSolid::traces).collect();
        let each_estimator = |file: &RunFile, name: &str| -> Vec<String> {
            self.estimators.keys().map(|estimator| file.name_of(&[name, estimator])).collect()
        };
        let written = SPATIAL_RUN_FILES.iter().filter(|file| file.writer == Writer::Evaluate);
        let instances = written.flat_map(|file| match file.per {
            Per::TraceAndEstimator => self.trials.iter().flat_map(|trial| each_estimator(file, &trial.trace)).collect(),
            Per::SolidAndEstimator => solids.iter().flat_map(|traces| each_estimator(file, traces)).collect(),
            _ => vec![file.name.into()],
        });
        instances.collect()
    }

    /// Trials by the solid that they sweep over, in order of their first trial. A trial whose solid is unknown, as in recordings of
    /// real sensors, is on its own.
    pub fn solids(&self) -> Vec<SweptSolid<'_>> {
        let mut solids: Vec<SweptSolid<'_>> = Vec::new();
        for trial in &self.trials {
            match solids.iter_mut().find(|swept| !swept.solid.is_null() && *swept.solid == trial.solid) {
                Some(swept) => swept.trials.push(trial),
                None => solids.push(SweptSolid { solid: &trial.solid, trials: vec![trial] }),
            }
        }
        solids
    }
}

/// A solid, and the trials that sweep over it.
#[derive(Clone, Debug, PartialEq)]
pub struct SweptSolid<'a> {
    /// Description of the solid.
    pub solid: &'a Value,
    /// The trials.
    pub trials: Vec<&'a SpatialRunTrial>,
}

impl SweptSolid<'_> {
    /// Names of the traces, joined by `+`, which name the files of the solid's maps.
    pub fn traces(&self) -> String {
        self.trials.iter().map(|trial| trial.trace.as_str()).collect::<Vec<_>>().join("+")
    }
}
