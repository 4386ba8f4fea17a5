//! Consistency of estimators over many runs (NEES, NIS).
//!
//! If the stated covariances are correct, the normalised estimation error squared (NEES) is chi-square with two degrees
//! of freedom (three in space) and the normalised innovation squared (NIS) with one. The average over `N` independent runs *at one
//! time*, multiplied by `N`, is then chi-square with `2 N` and `N` degrees of freedom, which determines the interval
//! that contains 95 % of such averages (Bar-Shalom, Li and Kirubarajan, *Estimation with Applications to Tracking and
//! Navigation*, 2001, section 5.4.2). A run is one trial under one noise seed.
//!
//! An average *over time* has more samples, but fewer independent ones than instants, since the errors of a filter are
//! strongly correlated in time. Each trial's average over time is therefore one sample ([`Average`]), and the scatter
//! of these samples gives the equivalent number of independent instants per trial: the average over `m` independent
//! values that are chi-square with `f` degrees of freedom has the relative variance `2 / (f m)`. The interval is that
//! of `N m` samples, with `m` at least one. It is much narrower than that of `N` and rejects any filter if there are
//! enough trials. A [`Verdict`] is consistent if and only if the average lies inside the interval; the ratio of the
//! average to its expectation measures the deviation.
//!
//! # Verdict by the truth
//! Where the truth is known, an estimator is judged by its errors ([`ErrorConsistency`]): by the NEES and by the share
//! of instants at which the stated 95 % ellipse contains the true contact. The innovations of a filter do not show errors
//! that the readings do not, such as those of a wrong mount or gain. Both intervals count effective samples, the smaller
//! of two numbers and at least one per trace:
//!
//! - by autocorrelation, the sum over the trials of [`effective_samples`](crate::statistics::effective_samples),
//! - by scatter, with a trace under all noise seeds as one cluster, because its trials share the errors of the model.

use std::collections::BTreeMap;

use statrs::distribution::{ChiSquared, ContinuousCDF};
use statrs::function::beta::beta_reg;

use crate::metrics::Metric;
use crate::metrics::consistency::{COVERAGE, NEES, NEES_SAMPLES, NIS};
use crate::results::TrialRow;
use crate::statistics::mean;

/// Degrees of freedom of the NEES: two coordinates of the contact.
pub const NEES_FREEDOM: usize = 2;

/// Degrees of freedom of the NEES in space: three coordinates of the contact.
pub const SPATIAL_NEES_FREEDOM: usize = 3;

/// Degrees of freedom of the NIS: one reading.
pub const NIS_FREEDOM: usize = 1;

/// Relative scatter of averages that is due to rounding.
const ROUNDING: f64 = 1e-9;

/// Largest number of independent instants of an average: more than a trial has.
const MOST_INSTANTS: f64 = 1e6;

/// Probability that the average of a consistent estimator is in [`interval`].
const LEVEL: f64 = 0.95;

/// Interval that contains 95 % of the averages over `samples` independent values that are chi-square with `freedom`
/// degrees of freedom. `samples` is at least 1.
pub fn interval(freedom: usize, samples: f64) -> (f64, f64) {
    let all = freedom as f64 * samples;
    let distribution = ChiSquared::new(all).expect("at least one degree of freedom");
    let quantile = |p: f64| {
        // The cumulative distribution is monotone and equals 1 up to rounding beyond ten times the mean.
        let (mut low, mut high) = (0.0, 10.0 * all + 100.0);
        for _ in 0..100 {
            let middle = 0.5 * (low + high);
            if distribution.cdf(middle) < p { low = middle } else { high = middle }
        }
        low / samples
    };
    (quantile(0.5 * (1.0 - LEVEL)), quantile(0.5 * (1.0 + LEVEL)))
}

/// Interval of the shares that are found with a two-sided probability of 95 % among `samples` independent instants, of
/// which each is counted with the probability `share`, by the binomial distribution continued to real numbers.
pub fn share_interval(share: f64, samples: f64) -> (f64, f64) {
    let tail = 0.5 * (1.0 - LEVEL);
    // P(K >= k) and P(K <= k) as regularised incomplete beta functions.
    let at_least = |k: f64| if k <= 0.0 { 1.0 } else { beta_reg(k, samples - k + 1.0, share) };
    let at_most = |k: f64| if k >= samples { 1.0 } else { 1.0 - beta_reg(k + 1.0, samples - k, share) };
    let edge = |is_inside: &dyn Fn(f64) -> bool, mut outside: f64| {
        let mut inside = share;
        for _ in 0..60 {
            let middle = 0.5 * (inside + outside);
            if is_inside(middle) { inside = middle } else { outside = middle }
        }
        inside
    };
    (edge(&|found| at_most(found * samples) >= tail, 0.0), edge(&|found| at_least(found * samples) >= tail, 1.0))
}

/// Consistency test: a metric that is a mean of chi-square variables if the stated covariances are correct.
#[derive(Clone, Copy, Debug)]
pub struct ConsistencyTest {
    /// Metric.
    pub metric: Metric,
    /// Degrees of freedom of the metric.
    pub freedom: usize,
}

/// NEES test, based on the contact errors; requires the truth.
pub const NEES_TEST: ConsistencyTest = ConsistencyTest { metric: NEES, freedom: NEES_FREEDOM };

/// NIS test, based on the innovations; does not require the truth.
pub const NIS_TEST: ConsistencyTest = ConsistencyTest { metric: NIS, freedom: NIS_FREEDOM };

impl ConsistencyTest {
    /// Average over trials. `None` if no trial has the metric.
    pub fn average<'a>(&self, trials: impl IntoIterator<Item = &'a TrialRow>) -> Option<Average> {
        let of_trials: Vec<f64> = trials.into_iter().filter_map(|trial| trial.get(&self.metric)).collect();
        Average::of_trials(self.freedom, &of_trials)
    }
}

/// Average over trials and time, with its interval for a consistent estimator.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Average {
    /// Average.
    pub value: f64,
    /// Interval that contains 95 % of the averages of a consistent estimator.
    pub interval: (f64, f64),
    freedom: usize,
}

impl Average {
    /// Average of the trials' averages over time. `None` without trials.
    pub fn of_trials(freedom: usize, of_trials: &[f64]) -> Option<Self> {
        let value = mean(of_trials.iter().copied())?;
        // Without scatter a trial counts as one independent instant.
        let instants = independent_instants(freedom, of_trials).unwrap_or(1.0);
        Some(Self { value, interval: interval(freedom, of_trials.len() as f64 * instants.max(1.0)), freedom })
    }

    /// Verdict on the estimator.
    pub fn verdict(&self) -> Verdict {
        let (low, high) = self.interval;
        if self.value > high {
            Verdict::Overconfident
        } else if self.value < low {
            Verdict::Underconfident
        } else {
            Verdict::Consistent
        }
    }

    /// Verdict as a sentence.
    pub fn sentence(&self) -> String {
        let times = self.value / self.freedom as f64;
        let word = self.verdict().word();
        match self.verdict() {
            Verdict::Consistent => word.to_owned(),
            _ => format!("{word}: {times:.2} times the chi-square that the right model would have"),
        }
    }
}

/// Errors of one trial relative to the stated covariances.
#[derive(Clone, Debug, PartialEq)]
pub struct TrialErrors {
    /// Name of the trace.
    pub trace: String,
    /// Average NEES.
    pub nees: f64,
    /// Share of the stated 95 % ellipses that contain the true contact.
    pub coverage: f64,
    /// Number of independent samples of the NEES.
    pub samples: f64,
}

impl TrialErrors {
    /// Errors of a row of `trials.csv`. `None` if the estimator stated no covariance.
    pub fn of(trial: &TrialRow) -> Option<Self> {
        Some(Self {
            trace: trial.head.trace.clone(),
            nees: trial.get(&NEES)?,
            coverage: trial.get(&COVERAGE)?,
            samples: trial.get(&NEES_SAMPLES)?,
        })
    }
}

/// Consistency of an estimator on a set by its errors.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ErrorConsistency {
    /// Average NEES over trials and time.
    pub nees: Average,
    /// Share of the stated 95 % ellipses that contain the true contact, over trials and time.
    pub coverage: f64,
    /// Interval that contains 95 % of the shares of a consistent estimator.
    pub coverage_interval: (f64, f64),
}

impl ErrorConsistency {
    /// Consistency over the trials of a set, whose NEES have `freedom` degrees of freedom. `None` without trials.
    pub fn of_trials(freedom: usize, trials: &[TrialErrors]) -> Option<Self> {
        let value = mean(trials.iter().map(|trial| trial.nees))?;
        let coverage = mean(trials.iter().map(|trial| trial.coverage))?;
        let mut clusters: BTreeMap<&str, Vec<f64>> = BTreeMap::new();
        trials.iter().for_each(|trial| clusters.entry(&trial.trace).or_default().push(trial.nees));
        let of_clusters: Vec<f64> = clusters.into_values().filter_map(mean).collect();
        let by_autocorrelation: f64 = trials.iter().map(|trial| trial.samples).sum();
        let count = of_clusters.len() as f64;
        let by_scatter = independent_instants(freedom, &of_clusters).map_or(f64::INFINITY, |each| each * count);
        let samples = by_autocorrelation.min(by_scatter).max(count);
        let nees = Average { value, interval: interval(freedom, samples), freedom };
        Some(Self { nees, coverage, coverage_interval: share_interval(LEVEL, samples) })
    }

    /// Verdict on the estimator: overconfident if the NEES is too large or the coverage too small.
    pub fn verdict(&self) -> Verdict {
        if self.coverage < self.coverage_interval.0 { Verdict::Overconfident } else { self.nees.verdict() }
    }

    /// Verdict as a sentence.
    pub fn sentence(&self) -> String {
        let (word, times) = (self.verdict().word(), self.nees.value / self.nees.freedom as f64);
        match self.verdict() {
            Verdict::Consistent => word.to_owned(),
            _ => format!("{word}: NEES {times:.2} times its expectation, coverage {:.0} %", 100.0 * self.coverage),
        }
    }
}

/// Equivalent number of independent instants per average over time, by the scatter of averages about their mean: averages
/// over `m` independent values that are chi-square with `f` degrees of freedom have the relative variance `2 / (f m)`.
/// `None` without scatter beyond rounding, as of a single average.
fn independent_instants(freedom: usize, averages: &[f64]) -> Option<f64> {
    let value = mean(averages.iter().copied())?;
    let squares: f64 = averages.iter().map(|average| (average - value).powi(2)).sum();
    let relative_variance = squares / (averages.len() as f64 - 1.0) / value.powi(2);
    (relative_variance > ROUNDING * ROUNDING).then(|| (2.0 / (freedom as f64 * relative_variance)).min(MOST_INSTANTS))
}

/// Verdict of a consistency test.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Verdict {
    /// Errors are larger than the stated covariances.
    Overconfident,
    /// Errors agree with the stated covariances.
    Consistent,
    /// Errors are smaller than the stated covariances.
    Underconfident,
}

impl Verdict {
    /// Verdict in one word.
    pub fn word(self) -> &'static str {
        match self {
            Self::Overconfident => "overconfident",
            Self::Consistent => "consistent",
            Self::Underconfident => "underconfident",
        }
    }
}

#[cfg(test)]
mod tests {
    use rand::{RngExt, SeedableRng};
    use rand_distr::StandardNormal;
    use rand_pcg::Pcg64;

    use super::*;

    /// Quantiles of the chi-square distribution from printed tables.
    #[test]
    fn val_intervals_match_published_tables() {
        for (freedom, runs, low, high) in
            [(1, 1.0, 0.000982, 5.0239), (2, 1.0, 0.0506, 7.3778), (2, 50.0, 1.4844, 2.5912)]
        {
            let (found_low, found_high) = interval(freedom, runs);
            assert!((found_low - low).abs() < 5e-5 && (found_high - high).abs() < 5e-5, "{found_low} {found_high}");
        }
    }

    #[test]
    fn verif_the_verdict_depends_on_the_side_of_the_interval() {
        let trials = |average: f64| [0.9, 1.0, 1.1, 0.95, 1.05].map(|factor| average * factor);
        let verdicts =
            [1.0, 2.0, 3.0].map(|average| Average::of_trials(NEES_FREEDOM, &trials(average)).unwrap().verdict());
        assert_eq!(verdicts, [Verdict::Underconfident, Verdict::Consistent, Verdict::Overconfident]);
        let just_below = Average::of_trials(NEES_FREEDOM, &trials(1.8)).unwrap();
        assert!(just_below.value < just_below.interval.0 && just_below.value > 0.95 * just_below.interval.0);
        assert_eq!(just_below.verdict(), Verdict::Underconfident);
        let wrong = Average::of_trials(NIS_FREEDOM, &trials(3.4)).unwrap();
        assert_eq!(wrong.sentence(), "overconfident: 3.40 times the chi-square that the right model would have");
    }

    /// Trials of 40 instants, each a chi-square variable with two degrees of freedom that is constant for 10 instants:
    /// four independent instants per trial.
    #[test]
    fn val_intervals_count_independent_instants() {
        let mut rng = Pcg64::seed_from_u64(1);
        let mut square = || rng.sample::<f64, _>(StandardNormal).powi(2);
        let trials: Vec<f64> = (0..4000).map(|_| (0..4).map(|_| square() + square()).sum::<f64>() / 4.0).collect();
        let (low, high) = Average::of_trials(2, &trials).unwrap().interval;
        let (exact_low, exact_high) = interval(2, 16_000.0);
        assert!((low - exact_low).abs() < 2e-3 && (high - exact_high).abs() < 2e-3, "{low} {high}");
        let alone = Average::of_trials(2, &[1.7]).unwrap();
        assert_eq!(alone.interval, interval(2, 1.0));
    }

    #[test]
    fn regress_trials_that_are_alike_have_an_interval_at_once() {
        let rounded = Average::of_trials(2, &[1.7, 1.7 + 2e-16, 1.7 - 2e-16]).unwrap();
        assert_eq!(rounded.interval, interval(2, 3.0), "differences by rounding are no scatter");
        let alike = Average::of_trials(2, &[1.7, 1.7 + 1e-7, 1.7 - 1e-7]).unwrap();
        assert_eq!(alike.interval, interval(2, 3.0 * MOST_INSTANTS));
    }

    /// Quantiles of the binomial distribution: among 25 instants, 20 and fewer have the probability 0.0072 and 21 and
    /// fewer 0.0341; among 400, 370 and fewer 0.0190, 371 and fewer 0.0307, 388 and more 0.0355, 389 and more 0.0190.
    #[test]
    fn val_share_intervals_match_the_binomial_distribution() {
        let (low, high) = share_interval(0.95, 25.0);
        assert!((20.0 / 25.0..21.0 / 25.0).contains(&low) && high > 1.0 - 1e-9, "{low} {high}");
        let (low, high) = share_interval(0.95, 400.0);
        assert!((370.0..371.0).contains(&(400.0 * low)) && (388.0..389.0).contains(&(400.0 * high)), "{low} {high}");
    }

    /// Trials of a consistent estimator and of others, four traces under five seeds.
    #[test]
    fn verif_errors_are_judged_by_nees_and_coverage() {
        let mut rng = Pcg64::seed_from_u64(3);
        let mut verdict = |nees: f64, coverage: f64| {
            let trial = |index: usize| TrialErrors {
                trace: format!("trace {}", index / 5),
                nees: nees * rng.random_range(0.8..1.2),
                coverage,
                samples: 12.0,
            };
            ErrorConsistency::of_trials(NEES_FREEDOM, &(0..20).map(trial).collect::<Vec<_>>()).unwrap()
        };
        assert_eq!(verdict(2.0, 0.95).verdict(), Verdict::Consistent);
        assert_eq!(verdict(2.0, 0.95).sentence(), "consistent");
        assert_eq!(verdict(7.0, 0.94).verdict(), Verdict::Overconfident);
        assert_eq!(verdict(2.0, 0.80).verdict(), Verdict::Overconfident);
        assert_eq!(verdict(0.5, 1.00).verdict(), Verdict::Underconfident);
        let wrong = verdict(14.0, 0.61).sentence();
        assert!(wrong.starts_with("overconfident: NEES ") && wrong.ends_with("coverage 61 %"), "{wrong}");
    }

    /// Traces that differ more than their autocorrelation explains count as fewer samples, at least one each.
    #[test]
    fn verif_scatter_of_traces_widens_the_interval() {
        let trial =
            |trace: usize, nees: f64| TrialErrors { trace: trace.to_string(), nees, coverage: 0.95, samples: 1e3 };
        let alike: Vec<TrialErrors> = (0..6).map(|trace| trial(trace, 2.0 + 0.01 * trace as f64)).collect();
        let apart: Vec<TrialErrors> = (0..6).map(|trace| trial(trace, [0.4, 4.0][trace % 2])).collect();
        let width = |trials: &[TrialErrors]| {
            let (low, high) = ErrorConsistency::of_trials(NEES_FREEDOM, trials).unwrap().nees.interval;
            high - low
        };
        assert!(width(&alike) < 0.12 && width(&apart) > 1.0, "{} {}", width(&alike), width(&apart));
        let far: Vec<TrialErrors> = (0..6).map(|trace| trial(trace, [0.1, 90.0][trace % 2])).collect();
        assert_eq!(ErrorConsistency::of_trials(NEES_FREEDOM, &far).unwrap().nees.interval, interval(NEES_FREEDOM, 6.0));
    }
}
