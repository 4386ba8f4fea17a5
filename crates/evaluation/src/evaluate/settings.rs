//! Inputs and outputs of an evaluation.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use anyhow::ensure;
use serde_json::Value;
use testbed::encoders::Encoders;
use testbed::front_end::FrontEndConfig;
use testbed::map::MapConfig;
use testbed::noise::NoiseUnit;
use testbed::results::{FailureRow, ResultsKind, SummaryRow};
use testbed::settings::check_configured;
use trace::{Miscalibration, is_plain_name};
use whisker::estimators::ESTIMATORS;
use whisker::events::TouchConfig;

use super::starts::Starts;
use super::workload::Workload;
use crate::distinct::check_distinct;
use crate::participant::{Participant, Program, Registered};
use crate::remarks::TrialRemarks;

/// Settings of an evaluation.
#[derive(Clone, Debug, Default)]
pub struct EvaluateSettings {
    /// Name of the run.
    pub name: String,
    /// Names of registered estimators. `None` for all whose sensor model is calibrated.
    pub estimators: Option<Vec<String>>,
    /// External programs, evaluated beside the estimators.
    pub programs: Vec<Program>,
    /// Settings by estimator, over its defaults.
    pub config: BTreeMap<String, Value>,
    /// Front end through which the trials are read.
    pub front_end: FrontEndConfig,
    /// Settings of the touch detection, the same for all estimators.
    pub touch: TouchConfig,
    /// Noise levels.
    pub noise: Vec<f64>,
    /// Unit of the noise levels.
    pub noise_unit: NoiseUnit,
    /// Seeds of the measurement noise.
    pub seeds: Vec<u64>,
    /// Priors of the first contact.
    pub starts: Starts,
    /// Encoders of an arm's joints, each evaluated as trials of their own. Empty for perfect encoders.
    pub encoders: Vec<Encoders>,
    /// Deviations from the calibrations, each evaluated as trials of their own. Empty for those that each trace states.
    pub miscalibrations: Vec<Miscalibration>,
    /// Settings of the maps of recordings of several whiskers.
    pub map: MapConfig,
    /// Folder of the calibrations. `None` for the one beside the traces.
    pub calibrations: Option<PathBuf>,
    /// Folder in which the run's folder is created.
    pub results: PathBuf,
    /// Whether to replace a finished run of the same name that has other settings, or external programs.
    pub force: bool,
    /// Called with the amount of work before it starts. Not called for an up-to-date run.
    pub on_start: Option<fn(&Workload)>,
}

/// Outcome of an evaluation.
#[derive(Clone, Debug)]
pub struct Evaluated {
    /// Folder of the run.
    pub folder: PathBuf,
    /// Rows of `summary.csv`.
    pub summary: Vec<SummaryRow>,
    /// Whether the run was computed. `false` if an up-to-date run was found.
    pub is_new: bool,
    /// Trials that could not be scored, or on which an estimator failed.
    pub failures: Vec<FailureRow>,
    /// Estimators that were omitted: they were not named and their sensor model is not calibrated.
    pub omitted: Vec<OmittedEstimator>,
    /// Names of the trials that were replayed but not scored, because the true contact is unknown.
    pub unscored: Vec<String>,
    /// Traces with gated readings: name, number of these readings and of all rows.
    pub gated: Vec<(String, usize, usize)>,
    /// Remarks on the trials.
    pub remarks: TrialRemarks,
}

/// Estimator that was omitted because a calibration lacks its sensor model.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct OmittedEstimator {
    /// Name of the estimator.
    pub estimator: String,
    /// Label of the sensor model that it requires.
    pub sensor_model: String,
    /// Calibration without that model.
    pub calibration: PathBuf,
}

/// Folder of a run.
///
/// # Errors
/// If the name of the run is no plain folder name.
pub fn run_folder(results: &Path, name: &str) -> anyhow::Result<PathBuf> {
    ensure!(is_plain_name(name), "name of the run: found `{name}`, expected a plain folder name");
    Ok(results.join(name))
}

impl EvaluateSettings {
    /// Folder of the run.
    ///
    /// # Errors
    /// If the name of the run is no plain folder name.
    pub fn folder(&self) -> anyhow::Result<PathBuf> {
        run_folder(&self.results, &self.name)
    }

    /// Folder of the run, which may replace nothing but another run.
    pub(super) fn target(&self) -> anyhow::Result<PathBuf> {
        let folder = self.folder()?;
        ResultsKind::Run.check_may_replace(&folder)?;
        Ok(folder)
    }

    /// Participants: registered estimators, then programs.
    pub(super) fn participants(&self) -> anyhow::Result<Vec<Box<dyn Participant>>> {
        let all = || ESTIMATORS.iter().map(|row| row.name.to_owned()).collect();
        let estimators = self.estimators.clone().unwrap_or_else(all);
        check_configured(self.config.keys(), &estimators)?;
        check_distinct("estimator", estimators.iter().cloned())?;
        check_distinct("program", self.programs.iter().map(|program| program.describe().name))?;
        let mut participants: Vec<Box<dyn Participant>> = Vec::new();
        for name in &estimators {
            let overrides = self.config.get(name).cloned().unwrap_or_else(|| Value::Object(Default::default()));
            participants.push(Box::new(Registered::new(name, &overrides)?));
        }
        participants.extend(self.programs.iter().map(|program| Box::new(program.clone()) as Box<dyn Participant>));
        Ok(participants)
    }

    /// Whether finished items are computed again: they may be those of an earlier version of what a program imports.
    pub(super) fn renews_items(&self) -> bool {
        self.force && !self.programs.is_empty()
    }

    /// Whether an estimator or program must run: it was named or has settings.
    pub(super) fn requires(&self, participant: &str) -> bool {
        self.estimators.is_some() || self.config.contains_key(participant)
    }
}
