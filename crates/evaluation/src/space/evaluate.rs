//! Evaluation of estimators in space: every trial of a dataset, replayed with seeded noise and scored against the truth.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::{Context, bail};
use indicatif::ProgressBar;
use rayon::prelude::*;
use serde_json::Value;
use statrs::distribution::{ChiSquared, ContinuousCDF};
use testbed::consistency::{ErrorConsistency, SPATIAL_NEES_FREEDOM, TrialErrors};
use testbed::dataset::Dataset;
use testbed::fitted_traces::{check_fitted_to_all, check_is_calibration};
use testbed::front_end::{FrontEndConfig, SpatialFrontEnd};
use testbed::results::{FailureRow, SetName, write_rows};
use testbed::space::files::ESTIMATES;
use testbed::space::replay::{calibrated, knowledge, read_fitted, samples};
use testbed::space::rows::{SpatialSummaryRow, SpatialTimesRow, SpatialTrialRow};
use testbed::space::trial::{SpatialTrial, contact_count};
use testbed::space::{largest_reading_n_m, spatial_estimate_row};
use testbed::statistics;
use trace::{Role, SpatialCalibrationFile, SpatialSensor, SpatialSidecar, SpatialTrace};
use whisker::space::sensor::CalibratedSpace;

use super::participant::{Participant, participants};
use crate::evaluate::OTHERS;
use crate::participant::{Program, SpatialTask};
use crate::plausibility::contradicted_rate_in_space;
use crate::remarks::TrialRemarks;

/// Largest number of instants of a trial whose estimates a run keeps.
const KEPT: usize = 400;

/// Settings of an evaluation in space.
#[derive(Clone, Debug)]
pub struct SpatialEvaluateSettings {
    /// Names of the estimators. `None` for all.
    pub estimators: Option<Vec<String>>,
    /// Settings of estimators by name, over their defaults.
    pub config: BTreeMap<String, Value>,
    /// White noise added to the moments, as a fraction of the largest moment of each group of trials with one whisker.
    pub noise: f64,
    /// Seeds of the noise and of the front end; each is one replay of every trial.
    pub seeds: Vec<u64>,
    /// Front end through which the trials are read.
    pub front_end: FrontEndConfig,
    /// Folder of the calibrations. `None` for that beside the traces.
    pub calibrations: Option<PathBuf>,
    /// External programs that participate.
    pub programs: Vec<Program>,
}

/// Calibrations and their paths, by the name of the whisker.
pub(super) type Calibrations = BTreeMap<String, (PathBuf, SpatialCalibrationFile)>;

impl SpatialEvaluateSettings {
    /// Calibrations of the whiskers of a dataset's trials. They were fitted to the present calibration traces, to all of those of
    /// the dataset if they lie beside them.
    ///
    /// # Errors
    /// As [`read_fitted`] and [`check_fitted_to_all`], and if a sidecar cannot be read.
    pub(super) fn calibrations(&self, dataset: &Dataset) -> anyhow::Result<Calibrations> {
        let default = || dataset.calibrations(&self.front_end.name);
        let folder = self.calibrations.clone().unwrap_or_else(default);
        let mut whiskers: BTreeSet<String> = BTreeSet::new();
        for path in &dataset.paths {
            let SpatialSidecar { role, whisker, .. } = SpatialSidecar::read(path)?;
            if role == Role::Trial {
                whiskers.insert(whisker.name);
            }
        }
        let path = |whisker: &String| folder.join(format!("{whisker}.json"));
        let missing: Vec<&str> = whiskers.iter().filter(|name| !path(name).exists()).map(String::as_str).collect();
        if self.calibrations.is_some() && (1..whiskers.len()).contains(&missing.len()) {
            bail!(
                "{}: found no calibrations of the whiskers {}, expected one of each whisker of the trials: copy the missing ones to this \
                 folder, or evaluate only the trials of the other whiskers",
                folder.display(),
                missing.join(", ")
            );
        }
        let mut found = Calibrations::new();
        for name in whiskers {
            let path = path(&name);
            check_is_calibration(&path, None, OTHERS)?;
            let file = read_fitted(&path)?;
            if self.calibrations.is_none() {
                check_fitted_to_all(&path, &file, dataset)?;
            }
            found.insert(name, (path, file));
        }
        Ok(found)
    }
}

/// Result of an evaluation in space.
#[derive(Clone, Debug)]
pub struct SpatialEvaluated {
    /// One row per trace, estimator and seed.
    pub trials: Vec<SpatialTrialRow>,
    /// One row per group, whisker and estimator.
    pub summary: Vec<SpatialSummaryRow>,
    /// One row per estimator.
    pub times: Vec<SpatialTimesRow>,
    /// Trials on which an external program failed.
    pub failures: Vec<FailureRow>,
    /// Remarks on the trials.
    pub remarks: TrialRemarks,
}

/// The trace of a trial, the sensor model of its whisker, and the calibration of the front end's sensor, if it has one.
pub(super) struct CalibratedTrial<'a> {
    trace: SpatialTrace,
    calibrated: Arc<CalibratedSpace>,
    sensor: Option<&'a SpatialSensor>,
}

/// A trial and how its readings are made.
struct Prepared<'a> {
    trial: SpatialTrial,
    /// Standard deviation of the white noise added to each moment.
    added_sd_n_m: f64,
    /// Calibration of the front end's sensor, if it has one.
    sensor: Option<&'a SpatialSensor>,
}

/// Result of one replay.
struct Scored {
    trial: SpatialTrialRow,
    /// Wall-clock times of the steps with an estimate (us).
    steps_us: Vec<f64>,
    failure: Option<FailureRow>,
}

/// Replays every trial of a dataset through the estimators. The unit of progress is one trial with one seed. The result does not
/// depend on the number of threads, except for times.
///
/// # Errors
/// If a trace or calibration cannot be read, an estimator is unknown, its settings are invalid, or a program does not start.
pub fn evaluate(
    dataset: &Dataset,
    settings: &SpatialEvaluateSettings,
    progress: &ProgressBar,
) -> anyhow::Result<SpatialEvaluated> {
    evaluate_keeping(dataset, settings, &settings.calibrations(dataset)?, None, progress)
}

/// As [`evaluate()`], with calibrations that have been read, and writes the estimates with the first seed, at up to [`KEPT`]
/// instants of every trial, into the folder of a run.
pub(super) fn evaluate_keeping(
    dataset: &Dataset,
    settings: &SpatialEvaluateSettings,
    calibrations: &Calibrations,
    estimates: Option<&Path>,
    progress: &ProgressBar,
) -> anyhow::Result<SpatialEvaluated> {
    let participants = participants(settings)?;
    let front_end = SpatialFrontEnd::new(&settings.front_end)?;
    let trials = calibrated_trials(dataset, &front_end, calibrations)?;
    let remarks = remarks(&trials);
    let prepared = prepared(trials, settings);
    settings.programs.iter().try_for_each(Program::check_starts)?;
    progress.set_length((prepared.len() * settings.seeds.len()) as u64);
    let work: Vec<(&Prepared<'_>, u64)> =
        prepared.iter().flat_map(|trial| settings.seeds.iter().map(move |seed| (trial, *seed))).collect();
    let found: Vec<anyhow::Result<Vec<Scored>>> = work
        .par_iter()
        .map(|(trial, seed)| {
            let folder = estimates.filter(|_| settings.seeds.first() == Some(seed));
            let scores =
                participants.iter().map(|one| trial.score(one, &front_end, settings.noise, *seed, folder)).collect();
            progress.inc(1);
            scores
        })
        .collect();
    let scored: Vec<Scored> = found.into_iter().collect::<anyhow::Result<Vec<_>>>()?.into_iter().flatten().collect();
    let times = participants.iter().map(|one| {
        let of_one = scored.iter().filter(|scored| scored.trial.estimator == one.name());
        times_row(one.name(), of_one.flat_map(|scored| &scored.steps_us).copied().collect())
    });
    let times = times.collect();
    let (mut trials, mut failures) = (Vec::with_capacity(scored.len()), Vec::new());
    for Scored { trial, failure, .. } in scored {
        trials.push(trial);
        failures.extend(failure);
    }
    Ok(SpatialEvaluated { summary: summary(&trials)?, trials, times, failures, remarks })
}

/// Trials of a dataset, with the calibrations of their whiskers.
///
/// # Errors
/// If there are none, a trace or calibration cannot be read, or they contradict each other or the front end.
pub(super) fn calibrated_trials<'a>(
    dataset: &Dataset,
    front_end: &SpatialFrontEnd,
    calibrations: &'a Calibrations,
) -> anyhow::Result<Vec<CalibratedTrial<'a>>> {
    let mut traces: Vec<SpatialTrace> = Vec::new();
    for path in &dataset.paths {
        if SpatialSidecar::read(path)?.role == Role::Trial {
            traces.push(SpatialTrace::read(path)?);
        }
    }
    if traces.is_empty() {
        bail!("{}: found no traces with the role `{}`", dataset.folder.display(), Role::Trial.name());
    }
    let mut whiskers: BTreeMap<String, (Arc<CalibratedSpace>, Option<&'a SpatialSensor>)> = BTreeMap::new();
    for trace in &traces {
        front_end.check_trace(&trace.sidecar)?;
        let name = &trace.sidecar.whisker.name;
        if whiskers.contains_key(name) {
            continue;
        }
        let (path, file) = calibrations.get(name).with_context(|| {
            format!(
                "{}: found the whisker `{name}`, expected one of the dataset as it was first read",
                trace.sidecar.name
            )
        })?;
        let sensor = front_end.sensor(path, file)?;
        whiskers.insert(name.clone(), (calibrated(path, file, &trace.sidecar)?, sensor));
    }
    let with_calibration = |trace: SpatialTrace| {
        let (calibrated, sensor) = whiskers[&trace.sidecar.whisker.name].clone();
        CalibratedTrial { trace, calibrated, sensor }
    };
    Ok(traces.into_iter().map(with_calibration).collect())
}

/// Remarks on trials.
pub(super) fn remarks(trials: &[CalibratedTrial<'_>]) -> TrialRemarks {
    let mut remarks = TrialRemarks::default();
    for CalibratedTrial { trace, calibrated, .. } in trials {
        let SpatialSidecar { name, group, whisker, .. } = &trace.sidecar;
        remarks.rates.extend(contradicted_rate_in_space(trace).map(|finding| (name.clone(), finding)));
        let set = SetName { group: group.clone(), whisker: whisker.name.clone() };
        remarks.contacts.entry(set).or_default().add(contact_count(trace, calibrated));
    }
    remarks
}

fn prepared<'a>(trials: Vec<CalibratedTrial<'a>>, settings: &SpatialEvaluateSettings) -> Vec<Prepared<'a>> {
    let of_set = |trace: &SpatialTrace| (trace.sidecar.group.clone(), trace.sidecar.whisker.name.clone());
    let mut largest: BTreeMap<(String, String), f64> = BTreeMap::new();
    for CalibratedTrial { trace, .. } in &trials {
        let known = largest.entry(of_set(trace)).or_default();
        *known = known.max(largest_reading_n_m([trace]));
    }
    let prepare = |CalibratedTrial { trace, calibrated, sensor }: CalibratedTrial<'a>| {
        let added_sd_n_m = settings.noise * largest[&of_set(&trace)];
        let noise_sd_n_m = added_sd_n_m.hypot(trace.sidecar.own_noise_sd_n_m());
        let knowledge = knowledge(&calibrated, noise_sd_n_m, sensor, trace.sidecar.rate_hz);
        Prepared { trial: SpatialTrial::new(Arc::new(trace), knowledge), added_sd_n_m, sensor }
    };
    trials.into_par_iter().map(prepare).collect()
}

impl Prepared<'_> {
    /// Scores of one replay. Writes its estimates into `folder`.
    fn score(
        &self,
        participant: &Participant,
        front_end: &SpatialFrontEnd,
        noise: f64,
        seed: u64,
        folder: Option<&Path>,
    ) -> anyhow::Result<Scored> {
        let SpatialTrial { trace, knowledge, .. } = &self.trial;
        let (estimator, name) = (participant.name(), &trace.sidecar.name);
        let readings_n_m = front_end.bending_n_m(trace, self.added_sd_n_m, seed, self.sensor)?;
        let samples = samples(trace, &readings_n_m);
        let replayed = participant.replay(&SpatialTask { knowledge, samples: &samples, trace: name, seed })?;
        if let Some(folder) = folder {
            let every = readings_n_m.len().div_ceil(KEPT).max(1);
            let kept = (0..readings_n_m.len()).step_by(every);
            let row_of = |i: usize| {
                let (now, truth) = (&trace.recording.instants[i], &trace.truth.instants[i]);
                spatial_estimate_row(now, truth, &knowledge.calibrated, readings_n_m[i], replayed.estimates[i].as_ref())
            };
            write_rows(&ESTIMATES.path_of(folder, &[name, estimator]), kept.map(row_of))?;
        }
        let failed =
            |reason| FailureRow { trace: name.clone(), estimator: Some(estimator.into()), noise, seed, reason };
        Ok(Scored {
            trial: self.trial.score(estimator, seed, &replayed.estimates)?,
            steps_us: replayed.steps_us,
            failure: replayed.failure.map(failed),
        })
    }
}

/// Row of the times of an estimator's steps.
fn times_row(estimator: &str, mut steps_us: Vec<f64>) -> SpatialTimesRow {
    steps_us.sort_by(f64::total_cmp);
    SpatialTimesRow {
        estimator: estimator.into(),
        steps: steps_us.len(),
        mean_us: statistics::mean(steps_us.iter().copied()),
        p99_us: statistics::quantile_of_sorted(&steps_us, 0.99),
    }
}

fn summary(trials: &[SpatialTrialRow]) -> anyhow::Result<Vec<SpatialSummaryRow>> {
    let mut groups: BTreeMap<(&str, &str, &str), Vec<&SpatialTrialRow>> = BTreeMap::new();
    for trial in trials {
        groups.entry((&trial.group, &trial.whisker, &trial.estimator)).or_default().push(trial);
    }
    let rows = groups.into_iter().map(|((group, whisker, estimator), trials)| {
        let mean = |score: fn(&SpatialTrialRow) -> Option<f64>| {
            statistics::mean(trials.iter().filter_map(|trial| score(trial)))
        };
        let rms = |score: fn(&SpatialTrialRow) -> Option<f64>| {
            let scores = trials.iter().filter_map(|trial| score(trial));
            statistics::mean(scores.map(|score| score * score)).map(f64::sqrt)
        };
        let nees: Vec<f64> = trials.iter().filter_map(|trial| trial.nees).collect();
        let degrees = 3.0 * nees.len().max(1) as f64;
        let chi_squared = ChiSquared::new(degrees)?;
        let errors: Vec<TrialErrors> = trials.iter().filter_map(|trial| errors(trial)).collect();
        let by_errors = ErrorConsistency::of_trials(SPATIAL_NEES_FREEDOM, &errors);
        let [nees_low, nees_high] = [0.025, 0.975].map(|p| chi_squared.inverse_cdf(p) / degrees);
        Ok(SpatialSummaryRow {
            group: group.into(),
            whisker: whisker.into(),
            estimator: estimator.into(),
            trials: trials.len(),
            answered: mean(|trial| trial.answered),
            rmse_m: rms(|trial| trial.rmse_m),
            out_of_plane_m: rms(|trial| trial.out_of_plane_m),
            bound_m: rms(|trial| trial.bound_m),
            object_bound_m: rms(|trial| trial.object_bound_m),
            nees: statistics::mean(nees).map(|nees| nees / 3.0),
            nees_low,
            nees_high,
            coverage: mean(|trial| trial.coverage),
            early_coverage: mean(|trial| trial.early_coverage),
            surface_m: mean(|trial| trial.surface_m),
            normal_rad: rms(|trial| trial.normal_rad),
            direction_rad: rms(|trial| trial.direction_rad),
            direction_bound_rad: rms(|trial| trial.direction_bound_rad),
            radius_error: rms(|trial| trial.radius_error),
            radius_bound: rms(|trial| trial.radius_bound),
            radius_coverage: mean(|trial| trial.radius_coverage),
            edge_m: mean(|trial| trial.edge_m),
            corner_m: mean(|trial| trial.corner_m),
            nees_mean: by_errors.map(|by_errors| by_errors.nees.value / SPATIAL_NEES_FREEDOM as f64),
            verdict: by_errors.map(|by_errors| by_errors.sentence()),
            doubted: mean(|trial| trial.doubted),
        })
    });
    rows.collect()
}

/// Errors of a replay relative to the stated covariances. `None` without an estimate.
fn errors(trial: &SpatialTrialRow) -> Option<TrialErrors> {
    Some(TrialErrors {
        trace: trial.trace.clone(),
        nees: trial.nees_mean?,
        coverage: trial.coverage?,
        samples: trial.nees_samples?,
    })
}
