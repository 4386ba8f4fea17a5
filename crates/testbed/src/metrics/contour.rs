//! The outline that an estimator makes of an object ([`crate::contour`]) and the contacts it is made of, against the truth. Both, since the one hides the
//! other: errors lie along the outline, and an outline whose points are in the wrong order of time is still an outline.
//!
//! A *stroke* lasts from one reversal of the base's motion to the next ([`second_stroke`](crate::contour::second_stroke)); from the second on, an estimator that
//! remembers what it touched has an advantage.

use super::{Contact, Metric, Scored, Summary};
use crate::statistics::rms;

/// Contacts count from so long after the touch on.
const FIRST_S: f64 = 1.0;

/// Contact error once the first second is over.
pub const CONTACT_RMSE: Metric = Metric {
    name: "contact_rmse_m",
    about: "root mean square contact error after the first second of contact",
    summary: Summary::Median,
    measure: |scored| contact_rmse_m(scored, |contact| contact.t_contact_s >= FIRST_S),
};

/// Contact error from the second stroke on.
pub const LATER_CONTACT_RMSE: Metric = Metric {
    name: "later_contact_rmse_m",
    about: "root mean square contact error from the second stroke on",
    summary: Summary::Median,
    measure: |scored| {
        let second_stroke = scored.second_stroke?;
        contact_rmse_m(scored, |contact| contact.row >= second_stroke)
    },
};

/// Mean distance of the outline.
pub const MEAN: Metric = Metric {
    name: "contour_mean_m",
    about: "mean distance of the outline found from the true one",
    summary: Summary::Median,
    measure: |scored| Some(scored.contour?.mean_m),
};

/// 95th percentile of that distance.
pub const P95: Metric = Metric {
    name: "contour_p95_m",
    about: "95th percentile of that distance",
    summary: Summary::Median,
    measure: |scored| Some(scored.contour?.p95_m),
};

/// Largest distance, both ways.
pub const HAUSDORFF: Metric = Metric {
    name: "contour_hausdorff_m",
    about: "largest distance of the outline found from the true one, or of the touched part of the true one from it",
    summary: Summary::Median,
    measure: |scored| scored.contour?.hausdorff_m,
};

/// Mean distance of the outline from the second stroke on.
pub const LATER_MEAN: Metric = Metric {
    name: "later_contour_mean_m",
    about: "mean distance from the true outline of the outline found from the second stroke on",
    summary: Summary::Median,
    measure: |scored| Some(scored.later_contour?.mean_m),
};

/// 95th percentile of that distance.
pub const LATER_P95: Metric = Metric {
    name: "later_contour_p95_m",
    about: "95th percentile of that distance",
    summary: Summary::Median,
    measure: |scored| Some(scored.later_contour?.p95_m),
};

/// Share of the outline whose band holds the truth.
pub const BAND_COVERAGE: Metric = Metric {
    name: "band_coverage",
    about: "share of the outline through whose 95 % regions the true outline runs",
    summary: Summary::Mean,
    measure: |scored| scored.contour?.band_coverage,
};

/// Root mean square error of some contacts; nothing where the estimator is silent for too much of the contact.
fn contact_rmse_m(scored: &Scored<'_>, counts: impl Fn(&Contact) -> bool) -> Option<f64> {
    let contacts = scored.contacts.iter().filter(|contact| counts(contact));
    let errors_m: Vec<f64> = contacts.filter_map(|contact| contact.error_m).collect();
    rms(&errors_m).filter(|_| !scored.is_silent())
}
