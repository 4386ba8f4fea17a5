//! Errors against the least that the readings allow, see [`crate::bound`].

use super::{Metric, Scored, Summary, error};
use crate::statistics::rms;

/// The bound itself.
pub const RMSE: Metric = Metric {
    name: "bound_rmse_m",
    about: "posterior Cramer-Rao bound of rmse_m, for a contact whose slide is known",
    summary: Summary::Median,
    measure: bound_rmse_m,
};

/// How far from it an estimator is.
pub const RATIO: Metric = Metric {
    name: "rmse_over_bound",
    about: "rmse_m over bound_rmse_m: 1 at the physical limit, for an estimator without hindsight",
    // The bound holds for mean squares. A median of the strongly correlated errors of a trial would lie below 1 even at the limit.
    summary: Summary::RootMeanSquare,
    measure: |scored| Some((error::RMSE.measure)(scored)? / bound_rmse_m(scored)?),
};

fn bound_rmse_m(scored: &Scored<'_>) -> Option<f64> {
    let bound = scored.trial.bound?;
    let sds: Option<Vec<f64>> = scored.steady().iter().map(|contact| Some(bound.at(contact.row)?.sd_m)).collect();
    rms(&sds?)
}
