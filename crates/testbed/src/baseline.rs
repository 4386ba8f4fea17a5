//! Ratio of the error of the baselines to that of an estimator.

use std::collections::BTreeMap;
use std::ops::Range;

use crate::metrics::START_UP_S;
use crate::results::{ErrorBandRow, Run};
use crate::statistics::rms;
use whisker::estimators::MethodClass;

/// Start-up, as time since the touch.
pub const START_UP: Range<f64> = 0.0..START_UP_S;

/// Steady state, as time since the touch.
pub const STEADY: Range<f64> = START_UP_S..f64::INFINITY;

/// Error of the better baseline over that of an estimator, on one group and whisker at the run's first noise level. An
/// error is the root mean square over time of the median over trials, at the times in `when_s` at which every trial has
/// an estimate of both: the baselines give none until the whisker has been pushed. `None` for a baseline, or if there
/// are no such times.
pub fn factor(
    run: &Run,
    bands: &[ErrorBandRow],
    group: &str,
    whisker: &str,
    estimator: &str,
    when_s: &Range<f64>,
) -> Option<f64> {
    let complete = |estimator: &str| -> BTreeMap<u64, f64> {
        let of_set = || {
            bands.iter().filter(|row| {
                row.group == group
                    && row.whisker == whisker
                    && row.estimator == estimator
                    && Some(&row.noise) == run.noise.first()
            })
        };
        let trials = of_set().map(|row| row.trials).max();
        of_set()
            .filter(|row| Some(row.trials) == trials && when_s.contains(&row.t_contact_s))
            .map(|row| (row.t_contact_s.to_bits(), row.median_m))
            .collect()
    };
    let is_baseline =
        |name: &str| run.estimators.iter().any(|row| row.name == name && row.class == MethodClass::Baseline);
    if is_baseline(estimator) {
        return None;
    }
    let own = complete(estimator);
    let ratio = |baseline: &str| {
        let both: Vec<(f64, f64)> =
            complete(baseline).iter().filter_map(|(t, error)| Some((*error, *own.get(t)?))).collect();
        let (baseline, own): (Vec<f64>, Vec<f64>) = both.into_iter().unzip();
        Some(rms(&baseline)? / rms(&own)?)
    };
    let baselines = run.estimators.iter().filter(|row| row.class == MethodClass::Baseline);
    baselines.filter_map(|row| ratio(&row.name)).min_by(f64::total_cmp)
}
