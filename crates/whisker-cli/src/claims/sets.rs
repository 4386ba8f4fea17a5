//! Sets of a random suite, with their coverage and the rates of `model_doubtful`.

use std::collections::BTreeMap;
use std::path::Path;

use testbed::metrics::{Metric, consistency, doubt};
use testbed::results::TrialRow;
use testbed::statistics::{beyond, mean};
use trace::Sidecar;

use super::{Context, RECOMMENDED};

/// Coverage below which a set counts as overconfident.
const OVERCONFIDENT_COVERAGE: f64 = 0.8;

/// Coverage below which `model_doubtful` must be raised.
const DOUBTFUL_COVERAGE: f64 = 0.6;

/// Time from the touch within which it must be raised.
const DOUBT_WITHIN_S: f64 = 2.0;

/// A set of a random suite: the trials of `recommended` on one object.
pub(super) struct Set<'a> {
    /// Name of the suite; its traces are in `datasets/<suite>`.
    suite: &'a str,
    pub(super) trials: Vec<&'a TrialRow>,
}

impl Set<'_> {
    pub(super) fn object(&self) -> &str {
        &self.trials[0].head.object
    }

    pub(super) fn mean(&self, metric: &Metric) -> Option<f64> {
        mean(self.trials.iter().filter_map(|trial| trial.get(metric)))
    }

    pub(super) fn coverage(&self) -> Option<f64> {
        self.mean(&consistency::COVERAGE)
    }

    /// Sidecar of the first trace.
    pub(super) fn sidecar(&self) -> anyhow::Result<Sidecar> {
        sidecar(self.suite, self.trials[0])
    }
}

/// Sidecar of the trace of a trial.
pub(super) fn sidecar(suite: &str, trial: &TrialRow) -> anyhow::Result<Sidecar> {
    Ok(Sidecar::read(&Path::new("datasets").join(suite).join(format!("{}.csv", trial.head.trace)))?)
}

/// The sets of a run of a random suite.
pub(super) fn sets_of<'a>(context: &'a Context, run: &str, suite: &'a str) -> Vec<Set<'a>> {
    let mut by_group: BTreeMap<&str, Vec<&TrialRow>> = BTreeMap::new();
    for trial in context.run(run).trials.iter().filter(|trial| trial.head.estimator == RECOMMENDED) {
        by_group.entry(&trial.head.group).or_default().push(trial);
    }
    by_group.into_values().map(|trials| Set { suite, trials }).collect()
}

/// Share (%) of values that meet a condition. `None` if there are none.
pub(super) fn share<T>(values: impl IntoIterator<Item = T>, condition: impl Fn(&T) -> bool) -> Option<f64> {
    mean(values.into_iter().map(|value| f64::from(condition(&value)))).map(|share| 100.0 * share)
}

/// Mean coverage of sets (%).
pub(super) fn coverage_of(sets: &[Set<'_>]) -> Option<f64> {
    mean(sets.iter().filter_map(Set::coverage)).map(|coverage| 100.0 * coverage)
}

/// Share (%) of the sets that are overconfident, those with a coverage below [`OVERCONFIDENT_COVERAGE`].
pub(super) fn overconfident(sets: &[Set<'_>]) -> Option<f64> {
    share(sets.iter().filter_map(Set::coverage), |coverage| *coverage < OVERCONFIDENT_COVERAGE)
}

/// Whether `model_doubtful` must be raised: the coverage of a set is below [`DOUBTFUL_COVERAGE`].
fn is_missed(set: &Set<'_>) -> bool {
    set.coverage().is_some_and(|coverage| coverage < DOUBTFUL_COVERAGE)
}

/// Whether a set is not overconfident.
fn is_good(set: &Set<'_>) -> bool {
    set.coverage().is_some_and(|coverage| coverage >= OVERCONFIDENT_COVERAGE)
}

/// Share (%) of the trials in which `model_doubtful` is raised within [`DOUBT_WITHIN_S`], over the sets in which it must be.
pub(super) fn doubt_found(sets: Vec<Set<'_>>) -> Option<f64> {
    let is_found = |trial: &&TrialRow| trial.get(&doubt::DOUBT_TIME).is_some_and(|time_s| time_s <= DOUBT_WITHIN_S);
    share(sets.into_iter().filter(is_missed).flat_map(|set| set.trials), is_found)
}

/// Mean normalised innovation squared of the sets in which `model_doubtful` must be raised, over that of the sets that are not
/// overconfident. At most 1 if the innovations of the former are no larger.
pub(super) fn nis_of_missed(sets: &[Set<'_>]) -> Option<f64> {
    let nis_of = |counts: fn(&Set<'_>) -> bool| {
        mean(sets.iter().filter(|set| counts(set)).filter_map(|set| set.mean(&consistency::NIS)))
    };
    Some(nis_of(is_missed)? / nis_of(is_good)?)
}

/// Number of times that `model_doubtful` is raised per minute of contact, over the sets that are not overconfident.
pub(super) fn doubt_false_per_min(sets: Vec<Set<'_>>) -> Option<f64> {
    let good: Vec<&TrialRow> = sets.into_iter().filter(is_good).flat_map(|set| set.trials).collect();
    let total = |metric: &Metric| good.iter().filter_map(|trial| trial.get(metric)).sum::<f64>();
    let minutes = total(&doubt::CONTACT_TIME) / 60.0;
    (minutes > 0.0).then(|| total(&doubt::ALARMS) / minutes)
}

/// Whether the bound of a trial is known and at most `error_m`.
pub(super) fn allows(trial: &TrialRow, bound: &Metric, error_m: f64) -> bool {
    trial.get(bound).is_some_and(|bound_m| bound_m <= error_m)
}

/// Expected share (%) of the trials whose error exceeds `error_m` for an estimator at the bound. The error of a trial is taken as one
/// normally distributed value with the bound as its standard deviation: the error along the wire is by far the largest, and the
/// calibration, size and velocity that cause it are constant in a trial.
pub(super) fn expected_above<'a>(
    trials: impl Iterator<Item = &'a TrialRow>,
    bound: &Metric,
    error_m: f64,
) -> Option<f64> {
    let bounds = trials.filter_map(|trial| trial.get(bound));
    mean(bounds.map(|bound_m| 100.0 * beyond(error_m, bound_m)))
}
