//! Contact events: whether touches and lost contacts are found, and how soon.
//!
//! The truth is the simulator's contact without its chatter: a whisker that hits an object bounces, and one that slides fast hops, so a gap shorter than
//! [`CHATTER_S`] is no loss, and a contact shorter than that, a mere graze, no touch. An event that was found belongs to the nearest true one within
//! [`WINDOW_S`]; each true event takes one. What an event is told by is the run's touch detection, the same for all estimators. Whether a contact
//! lies at the tip is told by its estimate, instant by instant.

use trace::Trace;
use whisker::sensor::Face;

use super::{Metric, Scored, Summary};
use crate::statistics::{mean, median};

/// Gaps in a contact, and contacts, that are shorter than this do not count.
pub const CHATTER_S: f64 = 0.04;

/// How far from a true event, before or after it, one that was found may lie.
pub const WINDOW_S: f64 = 0.1;

/// Share of the lost contacts found that were such.
pub const LOST_PRECISION: Metric = Metric {
    name: "lost_precision",
    about: "share of the lost contacts found that were lost then",
    summary: Summary::Mean,
    measure: |scored| lost(scored)?.precision(),
};

/// Share of the lost contacts that were found.
pub const LOST_RECALL: Metric = Metric {
    name: "lost_recall",
    about: "share of the lost contacts that were found",
    summary: Summary::Mean,
    measure: |scored| lost(scored)?.recall(),
};

/// Delay of the lost contacts.
pub const LOST_DELAY: Metric = Metric {
    name: "lost_delay_s",
    about: "median time from the loss of a contact until it is found",
    summary: Summary::Median,
    measure: |scored| median(lost(scored)?.delays_s.iter().copied()),
};

/// Share of the touches found that were such.
pub const TOUCH_PRECISION: Metric = Metric {
    name: "touch_precision",
    about: "share of the touches found that began then",
    summary: Summary::Mean,
    measure: |scored| touches(scored)?.precision(),
};

/// Share of the touches that were found.
pub const TOUCH_RECALL: Metric = Metric {
    name: "touch_recall",
    about: "share of the touches that were found",
    summary: Summary::Mean,
    measure: |scored| touches(scored)?.recall(),
};

/// Delay of the touches.
pub const TOUCH_DELAY: Metric = Metric {
    name: "touch_delay_s",
    about: "median time from a touch until it is found",
    summary: Summary::Median,
    measure: |scored| median(touches(scored)?.delays_s.iter().copied()),
};

/// Share of the estimates at the tip that are.
pub const TIP_PRECISION: Metric = Metric {
    name: "tip_precision",
    about: "share of the estimates that may lie at the tip whose contact does",
    summary: Summary::Mean,
    measure: |scored| mean(tips(scored).filter(|tip| tip.found).map(|tip| f64::from(tip.actual))),
};

/// Share of the contacts at the tip that are told.
pub const TIP_RECALL: Metric = Metric {
    name: "tip_recall",
    about: "share of the contacts at the tip whose estimate says that it may lie there",
    summary: Summary::Mean,
    measure: |scored| mean(tips(scored).filter(|tip| tip.actual).map(|tip| f64::from(tip.found))),
};

/// Whether the contact lies at the tip at one instant, and whether the estimate says that it may.
struct Tip {
    actual: bool,
    found: bool,
}

/// The instants of contact at which both are known.
fn tips(scored: &Scored<'_>) -> impl Iterator<Item = Tip> {
    let truth = &scored.trial.trace.truth.instants;
    scored.contacts.iter().filter_map(|contact| {
        Some(Tip { actual: truth[contact.row].tip?, found: scored.estimates[contact.row]?.at_tip })
    })
}

/// True events of one kind beside those found.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Tally {
    /// True events.
    pub actual: usize,
    /// Events found.
    pub found: usize,
    /// How much later than the true event each was found that belongs to one.
    pub delays_s: Vec<f64>,
}

impl Tally {
    fn new(actual_s: &[f64], found_s: &[f64]) -> Self {
        let mut free = found_s.to_vec();
        let mut delays_s = Vec::new();
        for &at_s in actual_s {
            let distance_s = |found_s: f64| (found_s - at_s).abs();
            let nearest = (0..free.len()).min_by(|&a, &b| distance_s(free[a]).total_cmp(&distance_s(free[b])));
            if let Some(nearest) = nearest.filter(|&nearest| distance_s(free[nearest]) <= WINDOW_S) {
                delays_s.push(free.remove(nearest) - at_s);
            }
        }
        Self { actual: actual_s.len(), found: found_s.len(), delays_s }
    }

    /// Share of the events found that belong to a true one; nothing where none was found.
    pub fn precision(&self) -> Option<f64> {
        (self.found > 0).then(|| self.delays_s.len() as f64 / self.found as f64)
    }

    /// Share of the true events that were found; nothing where there was none.
    pub fn recall(&self) -> Option<f64> {
        (self.actual > 0).then(|| self.delays_s.len() as f64 / self.actual as f64)
    }
}

/// The contact events of a trial, the same for all estimators.
#[derive(Clone, Debug, PartialEq)]
pub struct Events {
    /// Lost contacts.
    pub lost: Tally,
    /// Touches.
    pub touches: Tally,
}

impl Events {
    /// Contacts of a trace beside those that a detection found, which says of each row on which side it saw a touch; nothing where the truth is not known.
    pub fn of(trace: &Trace, touched: &[Option<Face>]) -> Option<Self> {
        let (actual, found) = (true_contacts(trace)?, spans(trace, touched.iter().map(Option::is_some)));
        let ends = |spans: &[Span]| spans.iter().filter_map(|span| span.end_s).collect::<Vec<f64>>();
        let starts = |spans: &[Span]| spans.iter().map(|span| span.start_s).collect::<Vec<f64>>();
        let (lost, touches) =
            (Tally::new(&ends(&actual), &ends(&found)), Tally::new(&starts(&actual), &starts(&found)));
        Some(Self { lost, touches })
    }
}

fn touches<'a>(scored: &Scored<'a>) -> Option<&'a Tally> {
    scored.trial.events.map(|events| &events.touches)
}

fn lost<'a>(scored: &Scored<'a>) -> Option<&'a Tally> {
    scored.trial.events.map(|events| &events.lost)
}

/// A contact.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Span {
    start_s: f64,
    /// Instant of the first free row; nothing where the contact lasts to the end of the recording.
    end_s: Option<f64>,
}

/// The contacts of a trace without chatter; nothing where they are not known.
fn true_contacts(trace: &Trace) -> Option<Vec<Span>> {
    let touching: Vec<bool> = trace.truth.instants.iter().map(|truth| truth.touching).collect::<Option<_>>()?;
    Some(without_chatter(spans(trace, touching)))
}

fn spans(trace: &Trace, touching: impl IntoIterator<Item = bool>) -> Vec<Span> {
    let mut spans: Vec<Span> = Vec::new();
    let mut was = false;
    for (instant, is) in trace.recording.instants.iter().zip(touching) {
        match (was, is, spans.last_mut()) {
            (false, true, _) => spans.push(Span { start_s: instant.t_s, end_s: None }),
            (true, false, Some(span)) => span.end_s = Some(instant.t_s),
            _ => {}
        }
        was = is;
    }
    spans
}

fn without_chatter(spans: Vec<Span>) -> Vec<Span> {
    let mut bridged: Vec<Span> = Vec::new();
    for span in spans {
        match bridged.last_mut() {
            Some(Span { end_s, .. }) if end_s.is_some_and(|end_s| span.start_s - end_s < CHATTER_S) => {
                *end_s = span.end_s;
            }
            _ => bridged.push(span),
        }
    }
    bridged.retain(|span| span.end_s.is_none_or(|end_s| end_s - span.start_s >= CHATTER_S));
    bridged
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn verif_each_true_event_takes_the_nearest_found_one() {
        let tally = Tally::new(&[1.0, 2.0, 3.0], &[1.02, 1.08, 1.97, 2.5]);
        assert_eq!((tally.actual, tally.found), (3, 4));
        assert_eq!(tally.delays_s.iter().map(|s| (s * 1e3).round()).collect::<Vec<_>>(), [20.0, -30.0]);
        assert_eq!((tally.precision(), tally.recall()), (Some(0.5), Some(2.0 / 3.0)));
        assert_eq!(Tally::default().precision(), None);
    }

    #[test]
    fn verif_chatter_is_bridged_and_grazes_are_dropped() {
        let span = |start_s, end_s| Span { start_s, end_s };
        let chattering = vec![
            span(0.5, Some(0.504)),
            span(1.0, Some(1.004)),
            span(1.012, Some(1.5)),
            span(1.52, Some(2.0)),
            span(3.0, None),
        ];
        assert_eq!(without_chatter(chattering), [span(1.0, Some(2.0)), span(3.0, None)]);
    }
}
