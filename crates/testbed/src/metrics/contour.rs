//! Errors of an estimated outline ([`crate::contour`]) and of the contacts it is made of. Both are reported, since
//! neither implies the other: contact errors along the outline do not change it, and an outline does not depend on the
//! order of its points in time.
//!
//! A *stroke* is the motion between two reversals of the base ([`second_stroke`](crate::contour::second_stroke)). From
//! the second stroke on, estimators that remember the object have an advantage.

use super::scored::errors_m;
use super::{Contact, Metric, Scored, Summary};
use crate::statistics::rms;

/// Time after the touch from which contacts count.
const FIRST_S: f64 = 1.0;

/// Contact error after the first second.
pub const CONTACT_RMSE: Metric = Metric {
    name: "contact_rmse_m",
    about: "RMS contact error after the first second of contact",
    summary: Summary::Median,
    measure: |scored| contact_rmse_m(scored, |contact| contact.t_contact_s >= FIRST_S),
};

/// Contact error from the second stroke on.
pub const LATER_CONTACT_RMSE: Metric = Metric {
    name: "later_contact_rmse_m",
    about: "RMS contact error from the second stroke on",
    summary: Summary::Median,
    measure: |scored| {
        let second_stroke = scored.second_stroke?;
        contact_rmse_m(scored, |contact| contact.row >= second_stroke)
    },
};

/// Contact error of the first touch.
pub const FIRST_TOUCH_RMSE: Metric = Metric {
    name: "first_touch_rmse_m",
    about: "RMS contact error until the whisker is first released",
    summary: Summary::Median,
    measure: |scored| {
        let released = first_release(scored)?;
        contact_rmse_m(scored, |contact| contact.row < released)
    },
};

/// Contact error of the later touches.
pub const LATER_TOUCHES_RMSE: Metric = Metric {
    name: "later_touches_rmse_m",
    about: "RMS contact error after the whisker was first released",
    summary: Summary::Median,
    measure: |scored| {
        let released = first_release(scored)?;
        contact_rmse_m(scored, |contact| contact.row > released)
    },
};

/// Mean distance of the outline.
pub const MEAN: Metric = Metric {
    name: "contour_mean_m",
    about: "mean distance of the estimated outline from the true one",
    summary: Summary::Median,
    measure: |scored| Some(scored.contour?.mean_m),
};

/// 95th percentile of the distance of the outline.
pub const P95: Metric = Metric {
    name: "contour_p95_m",
    about: "95th percentile of the distance of the estimated outline from the true one",
    summary: Summary::Median,
    measure: |scored| Some(scored.contour?.p95_m),
};

/// Hausdorff distance.
pub const HAUSDORFF: Metric = Metric {
    name: "contour_hausdorff_m",
    about: "Hausdorff distance between the estimated outline and the touched part of the true one",
    summary: Summary::Median,
    measure: |scored| scored.contour?.hausdorff_m,
};

/// Mean distance of the touched places from the outline.
pub const TOUCHED_MEAN: Metric = Metric {
    name: "contour_touched_mean_m",
    about: "mean distance of the places that were touched from the estimated outline",
    summary: Summary::Median,
    measure: |scored| scored.contour?.touched_mean_m,
};

/// Depth of the outline in free space.
pub const IN_FREE_SPACE: Metric = Metric {
    name: "contour_in_free_space_m",
    about: "largest depth of the estimated outline in the space that the whisker has swept; for objects that are not convex",
    summary: Summary::Median,
    measure: |scored| scored.in_free_space_m,
};

/// Mean distance of the outline from the second stroke on.
pub const LATER_MEAN: Metric = Metric {
    name: "later_contour_mean_m",
    about: "mean distance of the outline estimated from the second stroke on",
    summary: Summary::Median,
    measure: |scored| Some(scored.later_contour?.mean_m),
};

/// 95th percentile of that distance.
pub const LATER_P95: Metric = Metric {
    name: "later_contour_p95_m",
    about: "95th percentile of the distance of the outline estimated from the second stroke on",
    summary: Summary::Median,
    measure: |scored| Some(scored.later_contour?.p95_m),
};

/// Coverage of the outline's 95 % band.
pub const BAND_COVERAGE: Metric = Metric {
    name: "band_coverage",
    about: "fraction of the estimated outline whose 95 % regions intersect the true outline",
    summary: Summary::Mean,
    measure: |scored| scored.contour?.band_coverage,
};

/// First row after the first contact in which the whisker does not touch. `None` if there is none.
fn first_release(scored: &Scored<'_>) -> Option<usize> {
    let first = scored.contacts.first()?.row;
    let truths = &scored.trial.trace.truth.instants[first..];
    Some(first + truths.iter().position(|truth| truth.touching == Some(false))?)
}

/// RMS error of selected contacts. `None` if the estimates of too many of them are missing.
fn contact_rmse_m(scored: &Scored<'_>, counts: impl Fn(&Contact) -> bool + Copy) -> Option<f64> {
    rms(&errors_m(scored.contacts.iter().filter(move |contact| counts(contact))))
}
