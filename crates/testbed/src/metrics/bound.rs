//! Errors relative to the Cramér–Rao bound, see [`crate::bound`].

use super::{Contact, Metric, Scored, Summary};
use crate::bound::BoundAt;
use crate::statistics::rms;

/// Settling time at the start of each touch, which these metrics exclude. During it the bound is dominated by the prior
/// over the whole whisker, which an estimator that remembers the object from a previous touch does not have.
const SETTLED_S: f64 = 1.0;

/// Cramér–Rao bound.
pub const RMSE: Metric = Metric {
    name: "bound_rmse_m",
    about: "posterior Cramér–Rao bound of rmse_m for a contact with known sliding motion, excluding the first second of each touch",
    summary: Summary::Median,
    measure: bound_rmse_m,
};

/// Bound for unknown deviations from the calibration.
pub const DEVIATING_RMSE: Metric = Metric {
    name: "deviating_bound_rmse_m",
    about: "bound_rmse_m for an estimator that knows which quantities deviate from the calibration, but not by how much",
    summary: Summary::Median,
    measure: |scored| rms(&settled(scored)?.iter().map(|(_, bound)| bound.deviating_sd_m).collect::<Vec<f64>>()),
};

/// Bound for unknown deviations and an unknown size.
pub const UNSIZED_RMSE: Metric = Metric {
    name: "unsized_bound_rmse_m",
    about: "deviating_bound_rmse_m for an estimator that knows the shape and the motion of the object, but not its size",
    summary: Summary::Median,
    measure: |scored| rms(&settled(scored)?.iter().map(|(_, bound)| bound.unsized_sd_m).collect::<Vec<f64>>()),
};

/// Bound for unknown deviations, size and motion.
pub const MOVING_RMSE: Metric = Metric {
    name: "moving_bound_rmse_m",
    about: "unsized_bound_rmse_m if the constant velocity of a moving object is unknown too, or the directions in which an object gives \
        way; the same for an object at rest",
    summary: Summary::Median,
    measure: |scored| rms(&settled(scored)?.iter().map(|(_, bound)| bound.moving_sd_m).collect::<Vec<f64>>()),
};

/// Error relative to the bound.
pub const RATIO: Metric = Metric {
    name: "rmse_over_bound",
    about: "RMS contact error divided by bound_rmse_m on the same rows; 1 at the physical limit of a causal estimator",
    // The bound holds for mean squares. The median of the strongly correlated errors of a trial would be below 1 even
    // at the bound.
    summary: Summary::RootMeanSquare,
    measure: |scored| {
        let stated = settled(scored)?.into_iter().filter_map(|(contact, bound)| Some((contact.error_m?, bound.sd_m)));
        let (errors_m, bounds_m): (Vec<f64>, Vec<f64>) = stated.unzip();
        Some(rms(&errors_m).filter(|_| !scored.is_silent())? / rms(&bounds_m)?)
    },
};

fn bound_rmse_m(scored: &Scored<'_>) -> Option<f64> {
    rms(&settled(scored)?.iter().map(|(_, bound)| bound.sd_m).collect::<Vec<f64>>())
}

/// Steady contact without the settling time of each touch, with the bound. `None` if the bound is unavailable.
fn settled<'a>(scored: &'a Scored<'_>) -> Option<Vec<(&'a Contact, BoundAt)>> {
    let bound = scored.trial.bound?;
    let bounded: Option<Vec<_>> =
        scored.steady().iter().map(|contact| Some((contact, bound.at(contact.row)?))).collect();
    Some(bounded?.into_iter().filter(|(_, bound)| bound.since_touch_s >= SETTLED_S).collect())
}
