//! Comparison of methods with the baselines.

use testbed::baseline::{self, START_UP, STEADY};
use testbed::metrics::error;
use testbed::results::{RunSet, TrialRow};

use super::run_data::RunData;
use super::style::two_digits;

/// Part of a contact that is scored separately.
#[derive(Clone, Copy)]
pub(crate) enum Phase {
    /// The first two seconds of contact.
    Start,
    /// The rest of the contact.
    Steady,
}

impl Phase {
    /// In the order of time.
    pub(crate) const ALL: [Self; 2] = [Self::Start, Self::Steady];

    /// Its name in figures and tables.
    pub(crate) fn words(self) -> &'static str {
        match self {
            Self::Start => "first 2 s of contact",
            Self::Steady => "steady state",
        }
    }

    fn rmse_m(self, trial: &TrialRow) -> Option<f64> {
        trial.get(match self {
            Self::Start => &error::START_RMSE,
            Self::Steady => &error::RMSE,
        })
    }
}

/// Root mean square error of each trial in metres.
pub(crate) fn phase_errors<'a>(
    data: &'a RunData,
    set: &RunSet,
    estimator: &str,
    phase: Phase,
) -> impl Iterator<Item = f64> + use<'a> {
    data.trials_of(set, estimator).into_iter().filter_map(move |trial| phase.rmse_m(trial))
}

/// Ratio of the error of the better baseline to that of an estimator. `None` for baselines, and if either has no errors.
pub(crate) fn factor_over_baseline(data: &RunData, set: &RunSet, estimator: &str, phase: Phase) -> Option<f64> {
    let when_s = match phase {
        Phase::Start => START_UP,
        Phase::Steady => STEADY,
    };
    baseline::factor(&data.run, &data.bands, &set.group, &set.whisker, estimator, &when_s)
}

/// A factor as figures and tables print it.
pub(crate) fn format_factor(factor: f64) -> String {
    format!("{} ×", two_digits(factor))
}
