//! Sets of a random suite, on which certainty is judged.

use std::collections::BTreeMap;
use std::path::Path;

use testbed::metrics::{Metric, consistency, doubt};
use testbed::results::TrialRow;
use testbed::statistics::mean;
use trace::Sidecar;

use super::{Context, RECOMMENDED};

/// Coverage below which a set is overconfident, and below which the signal of doubt has to find it.
const LEAST_COVERAGE: f64 = 0.8;
const MISSED_COVERAGE: f64 = 0.6;

/// Time within which it has to find it.
const DOUBT_WITHIN_S: f64 = 2.0;

/// A set of a random suite: the trials of `recommended` on one object.
pub(super) struct Set<'a> {
    /// Suite whose folder has the traces.
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

/// Share (%) of sets whose certainty is overstated.
pub(super) fn overconfident(sets: &[Set<'_>]) -> Option<f64> {
    share(sets.iter().filter_map(Set::coverage), |coverage| *coverage < LEAST_COVERAGE)
}

/// Share (%) of the trials of overconfident sets that are in doubt in time.
pub(super) fn doubt_found(sets: Vec<Set<'_>>) -> Option<f64> {
    let missed = sets.into_iter().filter(|set| set.coverage().is_some_and(|share| share < MISSED_COVERAGE));
    let is_found = |trial: &&TrialRow| trial.get(&doubt::DOUBT_TIME).is_some_and(|time_s| time_s <= DOUBT_WITHIN_S);
    share(missed.flat_map(|set| set.trials), is_found)
}

/// Alarms per minute of contact in the sets whose certainty is not overstated.
pub(super) fn doubt_false_per_min(sets: Vec<Set<'_>>) -> Option<f64> {
    let is_good = |set: &Set<'_>| set.coverage().is_some_and(|coverage| coverage >= LEAST_COVERAGE);
    let good: Vec<&TrialRow> = sets.into_iter().filter(is_good).flat_map(|set| set.trials).collect();
    let total = |metric: &Metric| good.iter().filter_map(|trial| trial.get(metric)).sum::<f64>();
    let minutes = total(&doubt::CONTACT_TIME) / 60.0;
    (minutes > 0.0).then(|| total(&doubt::ALARMS) / minutes)
}
