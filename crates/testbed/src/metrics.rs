//! Scores of one trial: distance of the estimates from the truth, unaligned, in World.

use trace::{Outline, Trace};
use whisker::estimators::{Estimate, Knowledge};

use crate::results::TrialRow;
use crate::statistics::{quantile, rms};

/// Start-up ends this long after the touch.
pub const START_UP_S: f64 = 2.0;

/// Contact error at one instant of contact.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ContactError {
    /// Time since the true first touch.
    pub t_contact_s: f64,
    /// Distance between estimated and true contact; nothing without an estimate.
    pub error_m: Option<f64>,
}

/// Which trial was scored.
#[derive(Clone, Copy, Debug)]
pub struct Trial<'a> {
    /// The trace, with the truth.
    pub trace: &'a Trace,
    /// The object's outline, where known.
    pub outline: Option<&'a Outline>,
    /// What the robot knew.
    pub knowledge: &'a Knowledge,
    /// What it read.
    pub readings_n_m: &'a [f64],
    /// Measurement noise as a fraction of the set's largest reading.
    pub noise: f64,
    /// Seed of that noise.
    pub seed: u64,
}

/// Why a trial cannot be scored.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum Unscored {
    /// The recording does not tell where the contact was.
    #[error("the true contact is not known; there is nothing to score against")]
    TruthUnknown,
    /// There was none.
    #[error("the whisker never touches; there is nothing to score")]
    NeverTouches,
}

/// An estimator that is silent for more than this share of the steady contact has no steady score: what it left out would flatter it.
const MOST_MISSING: f64 = 0.1;

/// Contact errors of a trial, at each instant at which the whisker truly touches in one place, and the instant of the first.
///
/// # Errors
/// [`Unscored`] where there is no such instant.
pub fn contact_errors(trace: &Trace, estimates: &[Option<Estimate>]) -> Result<(f64, Vec<ContactError>), Unscored> {
    let mut touch_s = None;
    let mut errors = Vec::new();
    for ((known, truth), estimate) in trace.recording.instants.iter().zip(&trace.truth.instants).zip(estimates) {
        let Some(contact) = truth.contact else { continue };
        let touch_s = *touch_s.get_or_insert(known.t_s);
        if truth.split == Some(true) {
            continue;
        }
        errors.push(ContactError {
            t_contact_s: known.t_s - touch_s,
            error_m: estimate.map(|estimate| known.base.apply(estimate.contact).distance(&contact)),
        });
    }
    let is_known = trace.truth.instants.iter().any(|truth| truth.touching.is_some());
    touch_s.map(|touch_s| (touch_s, errors)).ok_or(if is_known {
        Unscored::NeverTouches
    } else {
        Unscored::TruthUnknown
    })
}

/// Time after which the error stays below a bound to the end. A missing estimate is not below it.
fn time_to_stay_below(errors: &[ContactError], bound_m: f64) -> Option<f64> {
    let below = |error: &ContactError| error.error_m.is_some_and(|error| error < bound_m);
    let start = errors.iter().rposition(|error| !below(error)).map_or(0, |last| last + 1);
    errors.get(start).map(|error| error.t_contact_s)
}

/// Scores one estimator on one trial.
///
/// # Errors
/// [`Unscored`] where there is nothing to score.
pub fn score(
    trial: &Trial<'_>,
    estimator: &str,
    estimates: &[Option<Estimate>],
) -> Result<(TrialRow, Vec<ContactError>), Unscored> {
    let (touch_s, errors) = contact_errors(trial.trace, estimates)?;
    let is_steady = |error: &&ContactError| error.t_contact_s >= START_UP_S;
    let stated: Vec<f64> = errors.iter().filter(is_steady).filter_map(|e| e.error_m).collect();
    let start: Vec<f64> = errors.iter().filter(|e| !is_steady(e)).filter_map(|e| e.error_m).collect();
    let samples = errors.iter().filter(is_steady).count();
    let missing = samples - stated.len();
    let is_silent = missing as f64 > MOST_MISSING * samples as f64;
    let steady = if is_silent { Vec::new() } else { stated };
    let outline = if is_silent { Vec::new() } else { outline_distances(trial, touch_s + START_UP_S, estimates) };
    let sidecar = &trial.trace.sidecar;
    let row = TrialRow {
        trace: sidecar.name.clone(),
        group: sidecar.group.clone(),
        whisker: sidecar.whisker.name.clone(),
        object: sidecar.object.clone(),
        estimator: estimator.into(),
        noise: trial.noise,
        seed: trial.seed,
        touch_s,
        samples,
        missing,
        rmse_m: rms(&steady),
        median_m: quantile(&steady, 0.5),
        p95_m: quantile(&steady, 0.95),
        worst_m: quantile(&steady, 1.0),
        start_rmse_m: rms(&start),
        time_to_1mm_s: time_to_stay_below(&errors, 1e-3),
        time_to_0p3mm_s: time_to_stay_below(&errors, 0.3e-3),
        outline_median_m: quantile(&outline, 0.5),
        outline_p95_m: quantile(&outline, 0.95),
    };
    Ok((row, errors))
}

/// Distances of the estimated surface points from the true outline, from `from_s` on.
fn outline_distances(trial: &Trial<'_>, from_s: f64, estimates: &[Option<Estimate>]) -> Vec<f64> {
    let Some(outline) = trial.outline else { return Vec::new() };
    let instants = &trial.trace.recording.instants;
    instants
        .iter()
        .zip(trial.readings_n_m)
        .zip(estimates)
        .filter(|((known, _), _)| known.t_s >= from_s)
        .filter_map(|((known, &reading), estimate)| {
            let surface = trial.knowledge.surface(estimate.as_ref()?, reading);
            Some(outline.distance_m(known.base.apply(surface)))
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn errors(values: &[Option<f64>]) -> Vec<ContactError> {
        values.iter().enumerate().map(|(i, &error_m)| ContactError { t_contact_s: i as f64, error_m }).collect()
    }

    #[test]
    fn verif_time_to_stay_below_counts_from_the_last_excess() {
        let mm = 1e-3;
        assert_eq!(time_to_stay_below(&errors(&[Some(0.1 * mm); 3]), mm), Some(0.0));
        assert_eq!(time_to_stay_below(&errors(&[Some(2.0 * mm), Some(0.1 * mm), Some(0.2 * mm)]), mm), Some(1.0));
        assert_eq!(time_to_stay_below(&errors(&[Some(0.1 * mm), None, Some(0.2 * mm)]), mm), Some(2.0));
        assert_eq!(time_to_stay_below(&errors(&[Some(0.1 * mm), Some(2.0 * mm)]), mm), None);
    }
}
