//! Rows of the tables of a run.

use serde::{Deserialize, Serialize};
use testbed::bound::{BoundAt, TraceBound};
use testbed::consistency::{NEES_TEST, NIS_TEST, interval};
use testbed::metrics::{Contact, Scored, Trial};
use testbed::results::{BoundRow, ConsistencyRow, ErrorBandRow, EstimateRow, EventRow, SetKey, estimate_row};
use testbed::statistics::{mean, median, quantile_of_sorted, rms};
use trace::Trace;
use whisker::estimators::{Estimate, ModelShares};
use whisker::events::Signals;

/// Width of the time bins of `error_over_time.csv`.
const ERROR_BIN_S: f64 = 0.02;

/// Width of the time bins of `consistency.csv`, whose averages change more slowly.
const CONSISTENCY_BIN_S: f64 = 0.1;

/// Values of a trial for the tables over time, by bin in the order of time: those of the last instant with an estimate in each bin.
#[derive(Serialize, Deserialize)]
pub(super) struct OverTime {
    pub(super) errors_m: Vec<(u64, f64)>,
    pub(super) states: Vec<(u64, State)>,
}

/// Error, consistency and posterior Cramér–Rao bound at one instant.
#[derive(Clone, Copy, Serialize, Deserialize)]
pub(super) struct State {
    error_m: f64,
    nees: Option<f64>,
    nis: Option<f64>,
    bound_m: Option<f64>,
    condition: Option<f64>,
}

impl OverTime {
    pub(super) fn of(scored: &Scored<'_>) -> Self {
        let bound = scored.trial.bound;
        Self {
            errors_m: last_in_bins(&scored.contacts, ERROR_BIN_S, |_, error_m| error_m),
            states: last_in_bins(&scored.contacts, CONSISTENCY_BIN_S, |contact, error_m| {
                let bound = bound.and_then(|bound| bound.at(contact.row));
                State {
                    error_m,
                    nees: contact.nees,
                    nis: contact.nis,
                    bound_m: bound.map(|bound| bound.sd_m),
                    condition: bound.and_then(|bound| Some(bound.window?.condition)),
                }
            }),
        }
    }
}

/// Value of the last instant with an estimate in each bin.
fn last_in_bins<T>(contacts: &[Contact], width_s: f64, value: impl Fn(&Contact, f64) -> T) -> Vec<(u64, T)> {
    let estimated: Vec<(u64, &Contact, f64)> = contacts
        .iter()
        .filter_map(|contact| Some(((contact.t_contact_s / width_s).floor() as u64, contact, contact.error_m?)))
        .collect();
    let of_bin = |bin: &[(u64, &Contact, f64)]| {
        let (bin, contact, error_m) = *bin.last()?;
        Some((bin, value(contact, error_m)))
    };
    estimated.chunk_by(|a, b| a.0 == b.0).filter_map(of_bin).collect()
}

/// Centre of a bin.
fn center_s(bin: u64, width_s: f64) -> f64 {
    (bin as f64 + 0.5) * width_s
}

/// Rows of `events/<trace>.<detector>.csv`.
pub(super) fn event_rows(trace: &Trace, readings_n_m: &[f64], signals: &[Signals]) -> impl Iterator<Item = EventRow> {
    let instants = trace.recording.instants.iter().zip(&trace.truth.instants);
    instants.zip(readings_n_m.iter().zip(signals)).map(|((known, truth), (&reading_n_m, signals))| EventRow {
        t_s: known.t_s,
        reading_n_m,
        watched_n_m: signals.watched_n_m,
        threshold_n_m: signals.threshold_n_m,
        touched: signals.touched.is_some(),
        truth_touching: truth.touching,
    })
}

/// Rows of `estimates/<trace>.<estimator>.csv`.
pub(super) fn estimate_rows(trial: &Trial<'_>, estimates: &[Option<Estimate>]) -> impl Iterator<Item = EstimateRow> {
    let instants = trial.trace.recording.instants.iter().zip(&trial.trace.truth.instants);
    let seen = instants.zip(trial.readings_n_m).zip(estimates);
    let row = move |(((known, truth), &reading_n_m), estimate): (((_, _), _), &Option<Estimate>)| {
        estimate_row(trial.knowledge, known, truth, reading_n_m, estimate.as_ref())
    };
    seen.map(row)
}

/// Rows of `bounds/<trace>.csv`.
pub(super) fn bound_rows(trace: &Trace, bound: &TraceBound) -> impl Iterator<Item = BoundRow> {
    let instants = trace.recording.instants.iter().enumerate();
    instants.filter_map(move |(row, known)| {
        let BoundAt { sd_m, window, .. } = bound.at(row)?;
        Some(BoundRow {
            t_s: known.t_s,
            bound_m: sd_m,
            window_m: window.map(|window| window.sd_m),
            condition: window.map(|window| window.condition),
        })
    })
}

/// Mean of model probabilities. `None` if there are none.
pub(super) fn mean_shares(shares: impl Iterator<Item = ModelShares>) -> Option<ModelShares> {
    let all: Vec<ModelShares> = shares.collect();
    let names: Vec<&'static str> = all.first()?.iter().map(|(name, _)| name).collect();
    let mean = |name| all.iter().filter_map(|shares| shares.of(name)).sum::<f64>() / all.len() as f64;
    Some(ModelShares::new(names.into_iter().map(|name| (name, mean(name)))))
}

/// Row of `error_over_time.csv` from the errors in a bin.
pub(super) fn error_band(key: &SetKey, bin: u64, mut errors_m: Vec<f64>) -> ErrorBandRow {
    errors_m.sort_by(f64::total_cmp);
    let at = |q| quantile_of_sorted(&errors_m, q).expect("a bin holds at least one trial");
    ErrorBandRow {
        group: key.set.group.clone(),
        whisker: key.set.whisker.clone(),
        estimator: key.estimator.clone(),
        noise: key.noise,
        t_contact_s: center_s(bin, ERROR_BIN_S),
        trials: errors_m.len(),
        p10_m: at(0.1),
        median_m: at(0.5),
        p90_m: at(0.9),
    }
}

/// Row of `consistency.csv` from the states in a bin.
pub(super) fn consistency(key: &SetKey, bin: u64, states: &[State]) -> ConsistencyRow {
    let all = |value: fn(&State) -> Option<f64>| -> Vec<f64> { states.iter().filter_map(value).collect() };
    let (nees, nis) = (all(|state| state.nees), all(|state| state.nis));
    let within = |freedom, values: &[f64]| (!values.is_empty()).then(|| interval(freedom, values.len() as f64));
    let (of_nees, of_nis) = (within(NEES_TEST.freedom, &nees), within(NIS_TEST.freedom, &nis));
    ConsistencyRow {
        group: key.set.group.clone(),
        whisker: key.set.whisker.clone(),
        estimator: key.estimator.clone(),
        noise: key.noise,
        t_contact_s: center_s(bin, CONSISTENCY_BIN_S),
        trials: states.len(),
        rmse_m: rms(&all(|state| Some(state.error_m))).expect("a bin holds at least one trial"),
        bound_m: rms(&all(|state| state.bound_m)),
        anees: mean(nees),
        anees_low: of_nees.map(|(low, _)| low),
        anees_high: of_nees.map(|(_, high)| high),
        anis: mean(nis),
        anis_low: of_nis.map(|(low, _)| low),
        anis_high: of_nis.map(|(_, high)| high),
        condition: median(all(|state| state.condition)),
    }
}
