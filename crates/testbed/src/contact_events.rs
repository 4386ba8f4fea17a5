//! Contact events of a trial: true and detected touches and lost contacts.
//!
//! The true events are those of the simulator's contact without chatter: a whisker bounces when it hits an object and hops
//! when it slides fast, so gaps shorter than [`CHATTER_S`] are bridged and contacts shorter than that are dropped. Each true
//! event, in the order of time, is matched to the nearest detection within [`WINDOW_S`] that is not matched yet. Events are
//! detected by the contact detector of the run, which is common to all estimators.

use trace::Trace;
use whisker::sensor::Face;

/// Duration below which gaps in a contact, and contacts, are ignored.
pub const CHATTER_S: f64 = 0.04;

/// Largest time difference between matched events.
pub const WINDOW_S: f64 = 0.1;

/// True and detected events of one kind.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Tally {
    /// Number of true events.
    pub actual: usize,
    /// Number of detected events.
    pub found: usize,
    /// Delay of each matched detection relative to its true event.
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

    /// Fraction of the detected events that match a true one. `None` without detected events.
    pub fn precision(&self) -> Option<f64> {
        (self.found > 0).then(|| self.delays_s.len() as f64 / self.found as f64)
    }

    /// Fraction of the true events that were detected. `None` without true events.
    pub fn recall(&self) -> Option<f64> {
        (self.actual > 0).then(|| self.delays_s.len() as f64 / self.actual as f64)
    }
}

/// Contact events of a trial, common to all estimators.
#[derive(Clone, Debug, PartialEq)]
pub struct Events {
    /// Lost contacts.
    pub lost: Tally,
    /// Touches.
    pub touches: Tally,
}

impl Events {
    /// Compares the contacts of a trace with the detector's output per row. `None` if the truth is unknown.
    pub fn of(trace: &Trace, touched: &[Option<Face>]) -> Option<Self> {
        let (actual, found) = (true_contacts(trace)?, spans(trace, touched.iter().map(Option::is_some)));
        let ends = |spans: &[Span]| spans.iter().filter_map(|span| span.end_s).collect::<Vec<f64>>();
        let starts = |spans: &[Span]| spans.iter().map(|span| span.start_s).collect::<Vec<f64>>();
        let (lost, touches) =
            (Tally::new(&ends(&actual), &ends(&found)), Tally::new(&starts(&actual), &starts(&found)));
        Some(Self { lost, touches })
    }
}

/// Interval of contact.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Span {
    start_s: f64,
    /// Instant of the first free row. `None` if the contact lasts until the end of the recording.
    end_s: Option<f64>,
}

/// True contacts of a trace without chatter. `None` if the truth is unknown.
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
    fn verif_true_events_are_matched_to_the_nearest_detection() {
        let tally = Tally::new(&[1.0, 2.0, 3.0], &[1.02, 1.08, 1.97, 2.5]);
        assert_eq!((tally.actual, tally.found), (3, 4));
        assert_eq!(tally.delays_s.iter().map(|s| (s * 1e3).round()).collect::<Vec<_>>(), [20.0, -30.0]);
        assert_eq!((tally.precision(), tally.recall()), (Some(0.5), Some(2.0 / 3.0)));
        assert_eq!(Tally::default().precision(), None);
    }

    #[test]
    fn verif_short_gaps_are_bridged_and_short_contacts_dropped() {
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
