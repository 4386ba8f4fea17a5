//! Whether estimators are as sure as they may be, judged over many runs.
//!
//! If the stated covariances are right, the normalised error squared (NEES) is chi-square with two degrees of freedom and the normalised innovation
//! squared (NIS) with one. The average over `N` independent runs *at one time* times `N` is then chi-square with `2 N` and `N` degrees of freedom, which
//! gives the interval that holds 95 % of such averages (Bar-Shalom, Li and Kirubarajan, *Estimation with Applications to Tracking and
//! Navigation*, 2001, section 5.4.2). A run is one trial under one noise seed. Errors of neighbouring instants are far from independent, since a
//! filter carries them on; averages *over time* are therefore judged with the runs as the only samples, as if each were a single instant. That
//! interval is too wide rather than too narrow.

use statrs::distribution::{ChiSquared, ContinuousCDF};

/// Degrees of freedom of the NEES: the contact has two coordinates.
pub const NEES_FREEDOM: usize = 2;

/// Degrees of freedom of the NIS: there is one reading.
pub const NIS_FREEDOM: usize = 1;

/// Probability with which the average of a consistent estimator lies in [`interval`].
const LEVEL: f64 = 0.95;

/// The interval that holds 95 % of the averages over `runs` independent values that are chi-square with `freedom` degrees of freedom; `runs` is at least 1.
pub fn interval(freedom: usize, runs: usize) -> (f64, f64) {
    let distribution = ChiSquared::new((freedom * runs) as f64).expect("at least one degree of freedom");
    let quantile = |p: f64| {
        // The cumulative distribution rises from 0, and is 1 at ten times the mean and more to within rounding.
        let (mut low, mut high) = (0.0, 10.0 * (freedom * runs) as f64 + 100.0);
        for _ in 0..100 {
            let middle = 0.5 * (low + high);
            if distribution.cdf(middle) < p { low = middle } else { high = middle }
        }
        low / runs as f64
    };
    (quantile(0.5 * (1.0 - LEVEL)), quantile(0.5 * (1.0 + LEVEL)))
}

/// What an average says of the estimator.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Verdict {
    /// Errors are larger than stated.
    Overconfident,
    /// Errors are as large as stated.
    Consistent,
    /// Errors are smaller than stated.
    Underconfident,
}

impl Verdict {
    /// The verdict on an average over `runs` runs.
    pub fn of(average: f64, freedom: usize, runs: usize) -> Self {
        let (low, high) = interval(freedom, runs);
        if average > high {
            Self::Overconfident
        } else if average < low {
            Self::Underconfident
        } else {
            Self::Consistent
        }
    }

    /// The word for it.
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
    use super::*;

    /// Quantiles of the chi-square distribution from printed tables.
    #[test]
    fn val_intervals_are_those_of_the_tables() {
        for (freedom, runs, low, high) in [(1, 1, 0.000982, 5.0239), (2, 1, 0.0506, 7.3778), (2, 50, 1.4844, 2.5912)] {
            let (found_low, found_high) = interval(freedom, runs);
            assert!((found_low - low).abs() < 5e-5 && (found_high - high).abs() < 5e-5, "{found_low} {found_high}");
        }
    }

    #[test]
    fn verif_the_verdict_is_by_the_side_on_which_the_average_lies() {
        let verdicts = [1.0, 2.0, 3.0].map(|average| Verdict::of(average, NEES_FREEDOM, 100));
        assert_eq!(verdicts, [Verdict::Underconfident, Verdict::Consistent, Verdict::Overconfident]);
    }
}
