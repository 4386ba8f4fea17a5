//! Evaluation of estimators in space: every trial of a dataset, replayed with seeded noise and scored against the truth.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::{Context, bail};
use indicatif::ProgressBar;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use serde_json::Value;
use statrs::distribution::{ChiSquared, ContinuousCDF};
use trace::{Role, SpatialCalibrationFile, SpatialInstant, SpatialSidecar, SpatialTrace, SpatialTruthInstant};
use whisker::space::estimators::{Estimate, Knowledge, Radius};
use whisker::space::frames::Point;
use whisker::space::sensor::CalibratedSpace;

use super::bound::{SpatialBoundAt, bound};
use super::files::ESTIMATES;
use super::object::TrueObject;
use super::participant::{Participant, participants};
use super::replay::{calibrated, read_calibration, samples};
use super::solid::Solid;
use super::{largest_reading_n_m, noisy_readings_n_m, spatial_estimate_row, to_base};
use crate::consistency::{ErrorConsistency, SPATIAL_NEES_FREEDOM, TrialErrors};
use crate::dataset::Dataset;
use crate::fitted_traces::check_fitted_to_all;
use crate::front_end::FRONT_ENDS;
use crate::metrics::doubt;
use crate::participant::{Program, SpatialTask};
use crate::results::{FailureRow, write_rows};
use crate::statistics;

/// Time after the touch from which estimates are scored.
pub const START_S: f64 = 1.0;

/// Largest number of instants of a trial whose estimates a run keeps.
const KEPT: usize = 400;

/// Distance of the true point of the surface from an edge or corner within which the contact is one with this feature.
const FEATURE_M: f64 = 20e-6;

/// Probability of the ellipsoids and intervals whose coverage is measured.
const PROBABILITY: f64 = 0.95;

/// Settings of an evaluation in space.
#[derive(Clone, Debug)]
pub struct SpatialEvaluateSettings {
    /// Names of the estimators. `None` for all.
    pub estimators: Option<Vec<String>>,
    /// Settings of estimators by name, over their defaults.
    pub config: BTreeMap<String, Value>,
    /// Measurement noise of both moments, as a fraction of the largest moment of each group of trials with one whisker.
    pub noise: f64,
    /// Seeds of the noise; each is one replay of every trial.
    pub seeds: Vec<u64>,
    /// Folder of the calibrations. `None` for that beside the traces.
    pub calibrations: Option<PathBuf>,
    /// External programs that participate.
    pub programs: Vec<Program>,
}

/// Calibrations and their paths, by the name of the whisker.
pub(super) type Calibrations = BTreeMap<String, (PathBuf, SpatialCalibrationFile)>;

impl SpatialEvaluateSettings {
    /// Calibrations of the whiskers of a dataset's trials. They were fitted to the present calibration traces, to all of those of the
    /// dataset if they lie beside them.
    ///
    /// # Errors
    /// As [`read_calibration`] and [`check_fitted_to_all`], and if a sidecar cannot be read.
    pub(super) fn calibrations(&self, dataset: &Dataset) -> anyhow::Result<Calibrations> {
        let default = || dataset.calibrations(FRONT_ENDS[0].name);
        let folder = self.calibrations.clone().unwrap_or_else(default);
        let mut found = Calibrations::new();
        for path in &dataset.paths {
            let SpatialSidecar { role, whisker, .. } = SpatialSidecar::read(path)?;
            if role != Role::Trial || found.contains_key(&whisker.name) {
                continue;
            }
            let path = folder.join(format!("{}.json", whisker.name));
            let file = read_calibration(&path)?;
            if self.calibrations.is_none() {
                check_fitted_to_all(&path, &file, dataset)?;
            }
            found.insert(whisker.name, (path, file));
        }
        Ok(found)
    }
}

/// Scores of one replay. Errors are those after [`START_S`] of each touch.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SpatialTrialRow {
    /// Name of the trace.
    pub trace: String,
    /// Group of the trace.
    pub group: String,
    /// Name of the whisker.
    pub whisker: String,
    /// Name of the estimator.
    pub estimator: String,
    /// Seed of the noise.
    pub seed: u64,
    /// Standard deviation of the noise of each moment.
    pub noise_sd_n_m: f64,
    /// Share of the instants with an expected estimate that have one. An estimate is expected if the true contact lies in the calibrated
    /// domain, not at the tip and not at several places. `None` if there is no such instant.
    pub answered: Option<f64>,
    /// RMS error of the contact, over all instants with an estimate.
    pub rmse_m: Option<f64>,
    /// RMS error out of the plane of wire and force at the contact.
    pub out_of_plane_m: Option<f64>,
    /// RMS of the posterior Cramér–Rao bound with known sliding.
    pub bound_m: Option<f64>,
    /// RMS of the bound of a contact with an unknown object over all instants that are scored, also those without an estimate.
    /// `None` if the object is no rod, cylinder, edge or sphere.
    pub object_bound_m: Option<f64>,
    /// Normalised squared error of the last estimate, which has three degrees of freedom.
    pub nees: Option<f64>,
    /// Share of the instants at which the 95 % ellipsoid contains the true contact.
    pub coverage: Option<f64>,
    /// Mean distance of the estimated points of the surface from the true solid. `None` for meshes.
    pub surface_m: Option<f64>,
    /// RMS angle between estimated and true normal.
    pub normal_rad: Option<f64>,
    /// RMS angle between the estimated and the true direction of the edge or rod. `None` for other objects and methods.
    pub direction_rad: Option<f64>,
    /// RMS of the bound of this angle with an unknown object.
    pub direction_bound_rad: Option<f64>,
    /// Error of the last stated radius relative to the true one, positive if it is too large. `None` unless the solid is a sphere or
    /// a cylinder.
    pub radius_error: Option<f64>,
    /// Bound of that error with an unknown object, at the instant of the radius.
    pub radius_bound: Option<f64>,
    /// Whether the 95 % interval of that radius contains the true one: 1 or 0.
    pub radius_coverage: Option<f64>,
    /// Mean distance of the estimated points of the surface from the touched edge of a box, over the instants with a contact on one.
    pub edge_m: Option<f64>,
    /// The same of the touched corner of a box.
    pub corner_m: Option<f64>,
    /// Mean normalised squared error over the scored instants, which has three degrees of freedom.
    pub nees_mean: Option<f64>,
    /// Number of independent samples of that error, by its autocorrelation.
    pub nees_samples: Option<f64>,
    /// Time of contact with an estimate, from the touch on.
    pub contact_s: f64,
    /// Share of the estimates, from the touch on, at which the readings contradict the models of the method. `None` for methods that
    /// do not judge them.
    pub doubted: Option<f64>,
    /// Time from the touch until the readings first contradict the models. `None` if they never do.
    pub doubt_time_s: Option<f64>,
}

/// Scores of the trials of one group with one whisker.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SpatialSummaryRow {
    /// Group of the trials.
    pub group: String,
    /// Name of the whisker.
    pub whisker: String,
    /// Name of the estimator.
    pub estimator: String,
    /// Number of replays.
    pub trials: usize,
    /// Mean over the replays of the share of expected estimates that are given.
    pub answered: Option<f64>,
    /// RMS over the replays of their RMS error.
    pub rmse_m: Option<f64>,
    /// The same of the error out of the plane of wire and force.
    pub out_of_plane_m: Option<f64>,
    /// The same of the bound with known sliding.
    pub bound_m: Option<f64>,
    /// The same of the bound with an unknown object.
    pub object_bound_m: Option<f64>,
    /// Mean normalised squared error of the last estimates, per degree of freedom: 1 if the method is consistent.
    pub nees: Option<f64>,
    /// Bounds of its central 95 % interval for a consistent method and independent replays.
    pub nees_low: f64,
    /// Upper bound of that interval.
    pub nees_high: f64,
    /// Mean coverage of the 95 % ellipsoids.
    pub coverage: Option<f64>,
    /// Mean over the replays of the distance of the surface.
    pub surface_m: Option<f64>,
    /// RMS over the replays of the angle of the normal.
    pub normal_rad: Option<f64>,
    /// The same of the angle of the edge.
    pub direction_rad: Option<f64>,
    /// The same of the bound of this angle.
    pub direction_bound_rad: Option<f64>,
    /// RMS over the replays of the relative error of the radius.
    pub radius_error: Option<f64>,
    /// RMS of the bound of the radius' relative error with an unknown object.
    pub radius_bound: Option<f64>,
    /// Share of the replays whose 95 % interval of the radius contains the true one.
    pub radius_coverage: Option<f64>,
    /// Mean over the replays of the distance from the touched edge.
    pub edge_m: Option<f64>,
    /// The same from the touched corner.
    pub corner_m: Option<f64>,
    /// Mean normalised squared error over replays and scored instants, per degree of freedom: 1 if the method is consistent.
    pub nees_mean: Option<f64>,
    /// Verdict on the method by its errors, see [`crate::consistency`]. `None` without an estimate.
    pub verdict: Option<String>,
    /// Mean over the replays of the share of estimates at which the readings contradict the models.
    pub doubted: Option<f64>,
}

/// Wall-clock times of the steps of an estimator with an estimate, in all replays: a row of `space_times.csv`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SpatialTimesRow {
    /// Name of the estimator.
    pub estimator: String,
    /// Number of steps.
    pub steps: usize,
    /// Mean time of a step. `None` if there is none.
    pub mean_us: Option<f64>,
    /// 99th percentile.
    pub p99_us: Option<f64>,
}

impl SpatialTimesRow {
    /// The row of these times.
    fn new(estimator: &str, mut steps_us: Vec<f64>) -> Self {
        steps_us.sort_by(f64::total_cmp);
        Self {
            estimator: estimator.into(),
            steps: steps_us.len(),
            mean_us: statistics::mean(steps_us.iter().copied()),
            p99_us: statistics::quantile_of_sorted(&steps_us, 0.99),
        }
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
}

/// Result of one replay.
struct Scored {
    trial: SpatialTrialRow,
    /// Wall-clock times of the steps with an estimate (us).
    steps_us: Vec<f64>,
    failure: Option<FailureRow>,
}

/// A trial with what does not depend on estimator and noise.
struct Prepared {
    trace: SpatialTrace,
    calibrated: Arc<CalibratedSpace>,
    noise_sd_n_m: f64,
    bound: Vec<Option<SpatialBoundAt>>,
    /// Whether an estimate is expected at each instant.
    expected: Vec<bool>,
    object: Option<TrueObject>,
    solid: Option<Solid>,
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

/// As [`evaluate()`], with calibrations that have been read, and writes the estimates with the first seed, at up to [`KEPT`] instants of
/// every trial, into the folder of a run.
pub(super) fn evaluate_keeping(
    dataset: &Dataset,
    settings: &SpatialEvaluateSettings,
    calibrations: &Calibrations,
    estimates: Option<&Path>,
    progress: &ProgressBar,
) -> anyhow::Result<SpatialEvaluated> {
    let participants = participants(settings)?;
    let prepared = prepared(dataset, settings, calibrations)?;
    settings.programs.iter().try_for_each(Program::check_starts)?;
    progress.set_length((prepared.len() * settings.seeds.len()) as u64);
    let work: Vec<(&Prepared, u64)> =
        prepared.iter().flat_map(|trial| settings.seeds.iter().map(move |seed| (trial, *seed))).collect();
    let found: Vec<anyhow::Result<Vec<Scored>>> = work
        .par_iter()
        .map(|(trial, seed)| {
            let folder = estimates.filter(|_| settings.seeds.first() == Some(seed));
            let scores = participants.iter().map(|one| trial.score(one, settings.noise, *seed, folder)).collect();
            progress.inc(1);
            scores
        })
        .collect();
    let scored: Vec<Scored> = found.into_iter().collect::<anyhow::Result<Vec<_>>>()?.into_iter().flatten().collect();
    let times = participants.iter().map(|one| {
        let of_one = scored.iter().filter(|scored| scored.trial.estimator == one.name());
        SpatialTimesRow::new(one.name(), of_one.flat_map(|scored| &scored.steps_us).copied().collect())
    });
    let times = times.collect();
    let (mut trials, mut failures) = (Vec::with_capacity(scored.len()), Vec::new());
    for Scored { trial, failure, .. } in scored {
        trials.push(trial);
        failures.extend(failure);
    }
    Ok(SpatialEvaluated { summary: summary(&trials)?, trials, times, failures })
}

fn prepared(
    dataset: &Dataset,
    settings: &SpatialEvaluateSettings,
    calibrations: &Calibrations,
) -> anyhow::Result<Vec<Prepared>> {
    let mut faces: BTreeMap<String, Arc<CalibratedSpace>> = BTreeMap::new();
    let mut traces: Vec<SpatialTrace> = Vec::new();
    for path in &dataset.paths {
        if SpatialSidecar::read(path)?.role == Role::Trial {
            traces.push(SpatialTrace::read(path)?);
        }
    }
    if traces.is_empty() {
        bail!("{}: found no traces with the role `{}`", dataset.folder.display(), Role::Trial.name());
    }
    for trace in &traces {
        let name = &trace.sidecar.whisker.name;
        if faces.contains_key(name) {
            continue;
        }
        let (path, file) = calibrations.get(name).with_context(|| {
            format!(
                "{}: found the whisker `{name}`, expected one of the dataset as it was first read",
                trace.sidecar.name
            )
        })?;
        faces.insert(name.clone(), calibrated(path, file, &trace.sidecar)?);
    }
    let of_set = |trace: &SpatialTrace| (trace.sidecar.group.clone(), trace.sidecar.whisker.name.clone());
    let mut largest: BTreeMap<(String, String), f64> = BTreeMap::new();
    for trace in &traces {
        let known = largest.entry(of_set(trace)).or_default();
        *known = known.max(largest_reading_n_m([trace]));
    }
    let prepare = |trace: SpatialTrace| {
        let calibrated = faces[&trace.sidecar.whisker.name].clone();
        let noise_sd_n_m = settings.noise * largest[&of_set(&trace)];
        let solid = trace.sidecar.scene.get("solid").and_then(Solid::of_scene);
        let object = TrueObject::of(&trace, solid.as_ref());
        let bound = bound(&trace, &calibrated, object.as_ref(), noise_sd_n_m);
        let expected = expected(&trace, &calibrated);
        Prepared { calibrated, noise_sd_n_m, bound, expected, object, solid, trace }
    };
    Ok(traces.into_par_iter().map(prepare).collect())
}

/// Whether an estimate is expected at each instant: whether the true contact lies in the calibrated domain, not at the tip and not at
/// several places.
fn expected(trace: &SpatialTrace, calibrated: &CalibratedSpace) -> Vec<bool> {
    let instants = trace.recording.instants.iter().zip(&trace.truth.instants);
    let is_expected = |(known, truth): (&SpatialInstant, &SpatialTruthInstant)| {
        truth.contact.as_ref().is_some_and(|contact| {
            let at = calibrated.around(to_base(&known.base).apply(Point::from_vector(contact.contact)));
            !contact.tip && !contact.split && calibrated.domain.contains(at)
        })
    };
    instants.map(is_expected).collect()
}

/// Sums of squared errors over a replay.
#[derive(Default)]
struct Sums {
    /// Instants at which an estimate is expected, and those of them with one.
    expected: usize,
    expected_answered: usize,
    /// Instants with an estimate.
    answered: usize,
    contact: f64,
    out_of_plane: f64,
    bound: f64,
    object_bound: f64,
    objects: usize,
    direction_bound: f64,
    rods: usize,
    covered: usize,
    surface: f64,
    normal: f64,
    direction: f64,
    directions: usize,
    /// Distances from the touched edges and corners, and their numbers.
    edge: (f64, usize),
    corner: (f64, usize),
    nees: Vec<f64>,
    last_nees: Option<f64>,
    /// The last stated radius, and the bound of its variance relative to its square.
    last_radius: Option<(Radius, Option<f64>)>,
}

impl Prepared {
    /// Scores of one replay. Writes its estimates into `folder`.
    fn score(&self, participant: &Participant, noise: f64, seed: u64, folder: Option<&Path>) -> anyhow::Result<Scored> {
        let name = participant.name();
        let knowledge = Arc::new(Knowledge {
            calibrated: self.calibrated.clone(),
            noise_sd_n_m: self.noise_sd_n_m,
            rate_hz: self.trace.sidecar.rate_hz,
        });
        let readings_n_m = noisy_readings_n_m(&self.trace, self.noise_sd_n_m, seed);
        let samples = samples(&self.trace, &readings_n_m);
        let trace = &self.trace.sidecar.name;
        let replayed = participant.replay(&SpatialTask { knowledge: &knowledge, samples: &samples, trace, seed })?;
        if let Some(folder) = folder {
            let every = readings_n_m.len().div_ceil(KEPT).max(1);
            let kept = (0..readings_n_m.len()).step_by(every);
            let row_of = |i| {
                spatial_estimate_row(&self.trace, &self.calibrated, i, readings_n_m[i], replayed.estimates[i].as_ref())
            };
            write_rows(&ESTIMATES.path_of(folder, &[trace, name]), kept.map(row_of))?;
        }
        let within = |degrees: f64| Ok::<_, anyhow::Error>(ChiSquared::new(degrees)?.inverse_cdf(PROBABILITY));
        let within = [within(1.0)?, within(3.0)?];
        let mut sums = Sums::default();
        for (i, bound) in self.bound.iter().enumerate() {
            if let Some(bound) = bound.filter(|bound| bound.since_touch_s >= START_S) {
                if self.expected[i] {
                    sums.expected += 1;
                    sums.expected_answered += usize::from(replayed.estimates[i].is_some());
                }
                if let Some(object) = bound.object {
                    sums.object_bound += object.covariance_m2.trace();
                    sums.objects += 1;
                    if let Some(direction_rad2) = object.direction_rad2 {
                        sums.direction_bound += direction_rad2;
                        sums.rods += 1;
                    }
                }
                if let Some(estimate) = &replayed.estimates[i] {
                    self.add(&mut sums, i, estimate, &bound, within[1]);
                }
            }
        }
        let Sums { answered, .. } = sums;
        let mean = |sum: f64| (answered > 0).then(|| sum / answered as f64);
        let rms = |sum: f64| mean(sum).map(f64::sqrt);
        let of_bound =
            |sum: f64, count: usize| (count > 0 && self.noise_sd_n_m > 0.0).then(|| (sum / count as f64).sqrt());
        let radius = sums.last_radius.zip(self.solid.as_ref().and_then(Solid::radius_m));
        let radius_bound = sums.last_radius.and_then(|(_, bound)| bound).filter(|_| self.noise_sd_n_m > 0.0);
        // The bound is that of object and wire together.
        let of_both_m = self.object.as_ref().map_or(0.0, TrueObject::radius_m);
        let of_feature = |(sum, count): (f64, usize)| (count > 0).then(|| sum / count as f64);
        let sidecar = &self.trace.sidecar;
        let signals = || {
            let rows = self.bound.iter().zip(&replayed.estimates);
            rows.filter_map(|(bound, estimate)| {
                Some((bound.as_ref()?.since_touch_s, estimate.as_ref()?.model_doubtful?))
            })
        };
        let stated = self.bound.iter().zip(&replayed.estimates).filter(|(bound, of)| bound.is_some() && of.is_some());
        let scores = SpatialTrialRow {
            trace: sidecar.name.clone(),
            group: sidecar.group.clone(),
            whisker: sidecar.whisker.name.clone(),
            estimator: name.into(),
            seed,
            noise_sd_n_m: self.noise_sd_n_m,
            answered: (sums.expected > 0).then(|| sums.expected_answered as f64 / sums.expected as f64),
            rmse_m: rms(sums.contact),
            out_of_plane_m: rms(sums.out_of_plane),
            bound_m: rms(sums.bound).filter(|_| self.noise_sd_n_m > 0.0),
            object_bound_m: of_bound(sums.object_bound, sums.objects),
            nees: sums.last_nees,
            coverage: mean(sums.covered as f64),
            surface_m: self.solid.as_ref().and_then(|_| mean(sums.surface)),
            normal_rad: rms(sums.normal),
            direction_rad: (sums.directions > 0).then(|| (sums.direction / sums.directions as f64).sqrt()),
            direction_bound_rad: of_bound(sums.direction_bound, sums.rods),
            radius_error: radius.map(|((stated, _), truth_m)| stated.radius_m / truth_m - 1.0),
            radius_bound: radius.zip(radius_bound).map(|((_, truth_m), bound)| bound.sqrt() * of_both_m / truth_m),
            radius_coverage: radius.map(|((stated, _), truth_m)| {
                f64::from((stated.radius_m - truth_m).powi(2) <= within[0] * stated.sd_m.powi(2))
            }),
            edge_m: of_feature(sums.edge),
            corner_m: of_feature(sums.corner),
            nees_mean: statistics::mean(sums.nees.iter().copied()),
            nees_samples: statistics::effective_samples(&sums.nees, SPATIAL_NEES_FREEDOM as f64),
            contact_s: stated.count() as f64 / sidecar.rate_hz,
            doubted: doubt::doubted(signals()),
            doubt_time_s: doubt::doubt_time_s(signals()),
        };
        let failed = |reason| FailureRow { trace: trace.clone(), estimator: Some(name.into()), noise, seed, reason };
        Ok(Scored { trial: scores, steps_us: replayed.steps_us, failure: replayed.failure.map(failed) })
    }

    fn add(&self, sums: &mut Sums, i: usize, estimate: &Estimate, bound: &SpatialBoundAt, within: f64) {
        let Some(truth) = self.trace.truth.instants[i].contact else { return };
        let to_base = to_base(&self.trace.recording.instants[i].base);
        let error = estimate.contact.vector() - to_base.apply(Point::from_vector(truth.contact)).vector();
        let (tangent, normal) = (to_base.turn_vector(truth.tangent), to_base.turn_vector(truth.normal));
        let nees = estimate.covariance_m2.cholesky().map(|factor| error.dot(&factor.solve(&error)));
        sums.answered += 1;
        sums.contact += error.norm_squared();
        sums.out_of_plane += error.dot(&tangent.cross(&normal).normalize()).powi(2);
        sums.bound += bound.covariance_m2.trace();
        sums.covered += usize::from(nees.is_some_and(|nees| nees <= within));
        sums.nees.extend(nees);
        sums.last_nees = nees;
        if let Some(solid) = &self.solid {
            let surface = to_base.inverse().apply(self.calibrated.surface(estimate.contact, estimate.normal)).vector();
            sums.surface += solid.distance_m(surface);
            let features = solid.features_m(truth.surface).zip(solid.features_m(surface));
            if let Some(((edge_m, corner_m), (from_edge_m, from_corner_m))) = features
                && edge_m < FEATURE_M
            {
                let is_corner = corner_m < FEATURE_M;
                let (sum, error_m) =
                    if is_corner { (&mut sums.corner, from_corner_m) } else { (&mut sums.edge, from_edge_m) };
                (sum.0, sum.1) = (sum.0 + error_m, sum.1 + 1);
            }
        }
        sums.last_radius = estimate.radius.map(|radius| (radius, bound.object.map(|object| object.log_radius2)));
        sums.normal += normal.angle(&estimate.normal).powi(2);
        if let (Some(rod), Some(found)) = (self.object.as_ref().and_then(TrueObject::rod), estimate.direction) {
            // The direction of an edge has no sign.
            let cosine = to_base.turn_vector(rod.along).dot(&found.along).abs().min(1.0);
            sums.direction += cosine.acos().powi(2);
            sums.directions += 1;
        }
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
            rmse_m: mean(|trial| trial.rmse_m.map(|error| error * error)).map(f64::sqrt),
            out_of_plane_m: mean(|trial| trial.out_of_plane_m.map(|error| error * error)).map(f64::sqrt),
            bound_m: mean(|trial| trial.bound_m.map(|bound| bound * bound)).map(f64::sqrt),
            object_bound_m: mean(|trial| trial.object_bound_m.map(|bound| bound * bound)).map(f64::sqrt),
            nees: statistics::mean(nees).map(|nees| nees / 3.0),
            nees_low,
            nees_high,
            coverage: mean(|trial| trial.coverage),
            surface_m: mean(|trial| trial.surface_m),
            normal_rad: mean(|trial| trial.normal_rad.map(|angle| angle * angle)).map(f64::sqrt),
            direction_rad: mean(|trial| trial.direction_rad.map(|angle| angle * angle)).map(f64::sqrt),
            direction_bound_rad: mean(|trial| trial.direction_bound_rad.map(|angle| angle * angle)).map(f64::sqrt),
            radius_error: mean(|trial| trial.radius_error.map(|error| error * error)).map(f64::sqrt),
            radius_bound: mean(|trial| trial.radius_bound.map(|bound| bound * bound)).map(f64::sqrt),
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
