//! Errors against the least that the readings allow, see [`crate::bound`].

use super::{Contact, Metric, Scored, Summary};
use crate::statistics::rms;

/// A later touch counts from so long after it on. Before that the bound is that of a prior as long as the whisker, which an estimator that knows the object from the touch
/// before does not have.
const SETTLED_S: f64 = 1.0;

/// The bound itself.
pub const RMSE: Metric = Metric {
    name: "bound_rmse_m",
    about: "posterior Cramer-Rao bound of rmse_m, for a contact whose slide is known, from a second after each touch on",
    summary: Summary::Median,
    measure: bound_rmse_m,
};

/// How far from it an estimator is.
pub const RATIO: Metric = Metric {
    name: "rmse_over_bound",
    about: "root mean square contact error over bound_rmse_m, on the same rows: 1 at the physical limit, for an estimator without hindsight",
    // The bound holds for mean squares. A median of the strongly correlated errors of a trial would lie below 1 even at the limit.
    summary: Summary::RootMeanSquare,
    measure: |scored| {
        let errors_m: Vec<f64> = settled(scored)?.iter().filter_map(|(contact, _)| contact.error_m).collect();
        Some(rms(&errors_m).filter(|_| !scored.is_silent())? / bound_rmse_m(scored)?)
    },
};

fn bound_rmse_m(scored: &Scored<'_>) -> Option<f64> {
    rms(&settled(scored)?.iter().map(|(_, sd_m)| *sd_m).collect::<Vec<f64>>())
}

/// The steady contact, but for the start of each touch, with the bound; nothing where there is none.
fn settled<'a>(scored: &'a Scored<'_>) -> Option<Vec<(&'a Contact, f64)>> {
    let bound = scored.trial.bound?;
    let bounded: Option<Vec<_>> =
        scored.steady().iter().map(|contact| Some((contact, bound.at(contact.row)?))).collect();
    let settled = bounded?.into_iter().filter(|(_, bound)| bound.since_touch_s >= SETTLED_S);
    Some(settled.map(|(contact, bound)| (contact, bound.sd_m)).collect())
}
