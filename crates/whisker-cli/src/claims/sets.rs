//! Sets of a random suite, in the plane or in space, with their coverage and the rates of `model_doubtful`.

use std::collections::BTreeMap;
use std::path::Path;

use testbed::metrics::{Metric, consistency, doubt};
use testbed::results::TrialRow;
use testbed::space::rows::SpatialTrialRow;
use testbed::statistics::{beyond, mean};
use trace::Sidecar;

use super::RECOMMENDED;

/// Coverage below which a set counts as overconfident.
const OVERCONFIDENT_COVERAGE: f64 = 0.8;

/// Coverage below which `model_doubtful` must be raised.
const DOUBTFUL_COVERAGE: f64 = 0.6;

/// Time from the touch within which it must be raised.
const DOUBT_WITHIN_S: f64 = 2.0;

/// A scored trial of a random suite.
pub(super) trait Scored {
    /// Group of the trace.
    fn group(&self) -> &str;
    /// Name of the estimator.
    fn estimator(&self) -> &str;
    /// Share of the stated 95 % regions that hold the true contact.
    fn coverage(&self) -> Option<f64>;
    /// Time of contact with an estimate.
    fn contact_s(&self) -> Option<f64>;
    /// Time from the touch until `model_doubtful` is first raised.
    fn doubt_time_s(&self) -> Option<f64>;
    /// Number of counted alarms of `model_doubtful`.
    fn alarms(&self) -> Option<f64>;
}

impl Scored for TrialRow {
    fn group(&self) -> &str {
        &self.head.group
    }

    fn estimator(&self) -> &str {
        &self.head.estimator
    }

    fn coverage(&self) -> Option<f64> {
        self.get(&consistency::COVERAGE)
    }

    fn contact_s(&self) -> Option<f64> {
        self.get(&doubt::CONTACT_TIME)
    }

    fn doubt_time_s(&self) -> Option<f64> {
        self.get(&doubt::DOUBT_TIME)
    }

    fn alarms(&self) -> Option<f64> {
        self.get(&doubt::ALARMS)
    }
}

impl Scored for SpatialTrialRow {
    fn group(&self) -> &str {
        &self.group
    }

    fn estimator(&self) -> &str {
        &self.estimator
    }

    fn coverage(&self) -> Option<f64> {
        self.coverage
    }

    fn contact_s(&self) -> Option<f64> {
        Some(self.contact_s)
    }

    fn doubt_time_s(&self) -> Option<f64> {
        self.doubt_time_s
    }

    /// One if the replay is ever in doubt.
    fn alarms(&self) -> Option<f64> {
        self.doubt_time_s.map(|_| 1.0)
    }
}

/// A set of a random suite: the trials of `recommended` on one object.
pub(super) struct Set<'a, T = TrialRow> {
    pub(super) trials: Vec<&'a T>,
}

impl<T: Scored> Set<'_, T> {
    /// Mean coverage over the trials that have one.
    pub(super) fn coverage(&self) -> Option<f64> {
        mean(self.trials.iter().filter_map(|trial| trial.coverage()))
    }
}

impl Set<'_> {
    pub(super) fn object(&self) -> &str {
        &self.trials[0].head.object
    }

    pub(super) fn mean(&self, metric: &Metric) -> Option<f64> {
        mean(self.trials.iter().filter_map(|trial| trial.get(metric)))
    }

    /// Sidecar of the first trace, in the dataset of this suite.
    pub(super) fn sidecar(&self, suite: &str) -> anyhow::Result<Sidecar> {
        sidecar(suite, self.trials[0])
    }
}

/// Sidecar of the trace of a trial.
pub(super) fn sidecar(suite: &str, trial: &TrialRow) -> anyhow::Result<Sidecar> {
    Ok(Sidecar::read(&Path::new("datasets").join(suite).join(format!("{}.csv", trial.head.trace)))?)
}

/// The sets of the trials of a random suite.
pub(super) fn sets_of<T: Scored>(trials: &[T]) -> Vec<Set<'_, T>> {
    let mut by_group: BTreeMap<&str, Vec<&T>> = BTreeMap::new();
    for trial in trials.iter().filter(|trial| trial.estimator() == RECOMMENDED) {
        by_group.entry(trial.group()).or_default().push(trial);
    }
    by_group.into_values().map(|trials| Set { trials }).collect()
}

/// Share (%) of values that meet a condition. `None` if there are none.
pub(super) fn share<T>(values: impl IntoIterator<Item = T>, condition: impl Fn(&T) -> bool) -> Option<f64> {
    mean(values.into_iter().map(|value| f64::from(condition(&value)))).map(|share| 100.0 * share)
}

/// Mean coverage of sets (%).
pub(super) fn coverage_of<T: Scored>(sets: &[Set<'_, T>]) -> Option<f64> {
    mean(sets.iter().filter_map(Set::coverage)).map(|coverage| 100.0 * coverage)
}

/// Share (%) of the sets that are overconfident, those with a coverage below [`OVERCONFIDENT_COVERAGE`].
pub(super) fn overconfident<T: Scored>(sets: &[Set<'_, T>]) -> Option<f64> {
    share(sets.iter().filter_map(Set::coverage), |coverage| *coverage < OVERCONFIDENT_COVERAGE)
}

/// Whether `model_doubtful` must be raised: the coverage of a set is below [`DOUBTFUL_COVERAGE`].
fn is_missed<T: Scored>(set: &Set<'_, T>) -> bool {
    set.coverage().is_some_and(|coverage| coverage < DOUBTFUL_COVERAGE)
}

/// Whether a set is not overconfident.
fn is_good<T: Scored>(set: &Set<'_, T>) -> bool {
    set.coverage().is_some_and(|coverage| coverage >= OVERCONFIDENT_COVERAGE)
}

/// Share (%) of the trials in which `model_doubtful` is raised within [`DOUBT_WITHIN_S`], over the sets in which it must be.
pub(super) fn doubt_found<T: Scored>(sets: &[Set<'_, T>]) -> Option<f64> {
    let missed = sets.iter().filter(|set| is_missed(set)).flat_map(|set| &set.trials);
    share(missed, |trial| trial.doubt_time_s().is_some_and(|time_s| time_s <= DOUBT_WITHIN_S))
}

/// Mean normalised innovation squared of the sets in which `model_doubtful` must be raised, over that of the sets that are not
/// overconfident. At most 1 if the innovations of the former are no larger.
pub(super) fn nis_of_missed(sets: &[Set<'_>]) -> Option<f64> {
    let nis_of = |counts: fn(&Set<'_>) -> bool| {
        mean(sets.iter().filter(|set| counts(set)).filter_map(|set| set.mean(&consistency::NIS)))
    };
    Some(nis_of(is_missed)? / nis_of(is_good)?)
}

/// Number of alarms of `model_doubtful` per minute of contact, over the sets that are not overconfident.
pub(super) fn doubt_false_per_min<T: Scored>(sets: &[Set<'_, T>]) -> Option<f64> {
    let total = |of: fn(&T) -> Option<f64>| {
        let good = sets.iter().filter(|set| is_good(set)).flat_map(|set| &set.trials);
        good.filter_map(|trial| of(trial)).sum::<f64>()
    };
    let minutes = total(T::contact_s) / 60.0;
    (minutes > 0.0).then(|| total(T::alarms) / minutes)
}

/// Whether the bound of a trial is known and at most `error_m`.
pub(super) fn allows(trial: &TrialRow, bound: &Metric, error_m: f64) -> bool {
    trial.get(bound).is_some_and(|bound_m| bound_m <= error_m)
}

/// Expected share (%) of the trials whose error exceeds `error_m` for an estimator at the bound. The error of a trial is taken as
/// one normally distributed value with the bound as its standard deviation: the error along the wire is by far the largest, and the
/// calibration, size and velocity that cause it are constant in a trial.
pub(super) fn expected_above<'a>(
    trials: impl Iterator<Item = &'a TrialRow>,
    bound: &Metric,
    error_m: f64,
) -> Option<f64> {
    let bounds = trials.filter_map(|trial| trial.get(bound));
    mean(bounds.map(|bound_m| 100.0 * beyond(error_m, bound_m)))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A trial with scores as they are given.
    #[derive(Clone)]
    struct Given {
        group: &'static str,
        coverage: Option<f64>,
        contact_s: f64,
        doubt_time_s: Option<f64>,
    }

    impl Scored for Given {
        fn group(&self) -> &str {
            self.group
        }

        fn estimator(&self) -> &str {
            RECOMMENDED
        }

        fn coverage(&self) -> Option<f64> {
            self.coverage
        }

        fn contact_s(&self) -> Option<f64> {
            Some(self.contact_s)
        }

        fn doubt_time_s(&self) -> Option<f64> {
            self.doubt_time_s
        }

        fn alarms(&self) -> Option<f64> {
            self.doubt_time_s.map(|_| 1.0)
        }
    }

    fn given(group: &'static str, coverage: Option<f64>, doubt_time_s: Option<f64>) -> Given {
        Given { group, coverage, contact_s: 30.0, doubt_time_s }
    }

    /// Five sets: two covered, one without estimates, one overconfident, and one in which doubt must be raised.
    fn trials() -> [Given; 7] {
        [
            given("covered", Some(1.0), None),
            given("covered", Some(0.8), Some(5.0)),
            given("silent", None, None),
            given("just", Some(0.8), None),
            given("overconfident", Some(0.7), Some(1.0)),
            given("missed", Some(0.2), Some(1.0)),
            given("missed", Some(0.4), Some(2.5)),
        ]
    }

    #[test]
    fn verif_coverage_is_the_mean_over_sets() {
        let trials = trials();
        let coverage = coverage_of(&sets_of(&trials)).unwrap();
        assert!((coverage - 100.0 * (0.9 + 0.8 + 0.7 + 0.3) / 4.0).abs() < 1e-9);
    }

    #[test]
    fn verif_overconfident_sets_are_those_below_the_threshold() {
        assert_eq!(overconfident(&sets_of(&trials())), Some(50.0));
        assert_eq!(overconfident(&sets_of(&trials()[2..3])), None);
    }

    #[test]
    fn verif_doubt_is_found_if_it_is_raised_in_time_where_it_must_be() {
        assert_eq!(doubt_found(&sets_of(&trials())), Some(50.0));
        assert_eq!(doubt_found(&sets_of(&trials()[..5])), None);
    }

    #[test]
    fn verif_false_alarms_are_counted_per_minute_where_sets_are_covered() {
        // One alarm in 90 s: the trial without coverage is in no covered set.
        let rate = doubt_false_per_min(&sets_of(&trials())).unwrap();
        assert!((rate - 1.0 / 1.5).abs() < 1e-9);
    }
}
