//! Consistency of estimators over many runs (NEES, NIS).
//!
//! If the stated covariances are correct, the normalised estimation error squared (NEES) is chi-square with two degrees
//! of freedom and the normalised innovation squared (NIS) with one. The average over `N` independent runs *at one
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

use statrs::distribution::{ChiSquared, ContinuousCDF};

use crate::metrics::Metric;
use crate::metrics::consistency::{NEES, NIS};
use crate::results::TrialRow;
use crate::statistics::mean;

/// Degrees of freedom of the NEES: two coordinates of the contact.
pub const NEES_FREEDOM: usize = 2;

/// Degrees of freedom of the NIS: one reading.
pub const NIS_FREEDOM: usize = 1;

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
        let count = of_trials.len() as f64;
        let squares: f64 = of_trials.iter().map(|of_trial| (of_trial - value).powi(2)).sum();
        let relative_variance = squares / (count - 1.0) / value.powi(2);
        // A single trial has no scatter; without scatter a trial counts as one independent instant.
        let instants = if relative_variance > 0.0 { 2.0 / (freedom as f64 * relative_variance) } else { 1.0 };
        Some(Self { value, interval: interval(freedom, count * instants.max(1.0)), freedom })
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
}
