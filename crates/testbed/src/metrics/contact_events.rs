//! Contact events: precision, recall and delay of detected touches and lost contacts ([`crate::contact_events`]), and
//! precision and recall of contact at the tip, which is a property of each estimate.

use super::{Metric, Scored, Summary};
use crate::contact_events::Tally;
use crate::statistics::{mean, median};

/// Precision of lost contacts.
pub const LOST_PRECISION: Metric = Metric {
    name: "lost_precision",
    about: "fraction of the detected losses of contact that match a true loss",
    summary: Summary::Mean,
    measure: |scored| lost(scored)?.precision(),
};

/// Recall of lost contacts.
pub const LOST_RECALL: Metric = Metric {
    name: "lost_recall",
    about: "fraction of the true losses of contact that were detected",
    summary: Summary::Mean,
    measure: |scored| lost(scored)?.recall(),
};

/// Delay of lost contacts.
pub const LOST_DELAY: Metric = Metric {
    name: "lost_delay_s",
    about: "median time from a loss of contact to its detection",
    summary: Summary::Median,
    measure: |scored| median(lost(scored)?.delays_s.iter().copied()),
};

/// Precision of touches.
pub const TOUCH_PRECISION: Metric = Metric {
    name: "touch_precision",
    about: "fraction of the detected touches that match a true touch",
    summary: Summary::Mean,
    measure: |scored| touches(scored)?.precision(),
};

/// Recall of touches.
pub const TOUCH_RECALL: Metric = Metric {
    name: "touch_recall",
    about: "fraction of the true touches that were detected",
    summary: Summary::Mean,
    measure: |scored| touches(scored)?.recall(),
};

/// Delay of touches.
pub const TOUCH_DELAY: Metric = Metric {
    name: "touch_delay_s",
    about: "median time from a touch to its detection",
    summary: Summary::Median,
    measure: |scored| median(touches(scored)?.delays_s.iter().copied()),
};

/// Precision of tip contacts.
pub const TIP_PRECISION: Metric = Metric {
    name: "tip_precision",
    about: "fraction of the estimates flagged as possible tip contacts that are tip contacts",
    summary: Summary::Mean,
    measure: |scored| mean(tips(scored).filter(|tip| tip.found).map(|tip| f64::from(tip.actual))),
};

/// Recall of tip contacts.
pub const TIP_RECALL: Metric = Metric {
    name: "tip_recall",
    about: "fraction of the tip contacts whose estimate is flagged as a possible tip contact",
    summary: Summary::Mean,
    measure: |scored| mean(tips(scored).filter(|tip| tip.actual).map(|tip| f64::from(tip.found))),
};

/// True and estimated tip contact at one instant.
struct Tip {
    actual: bool,
    found: bool,
}

/// Instants of contact at which both are known.
fn tips(scored: &Scored<'_>) -> impl Iterator<Item = Tip> {
    let truth = &scored.trial.trace.truth.instants;
    scored.contacts.iter().filter_map(|contact| {
        Some(Tip { actual: truth[contact.row].tip?, found: scored.estimates[contact.row]?.at_tip })
    })
}

fn touches<'a>(scored: &Scored<'a>) -> Option<&'a Tally> {
    scored.trial.events.map(|events| &events.touches)
}

fn lost<'a>(scored: &Scored<'a>) -> Option<&'a Tally> {
    scored.trial.events.map(|events| &events.lost)
}
