//! The signal that a second contact has taken load ([`whisker::estimators::Estimate::second_contact`]), for traces whose truth has
//! second contacts.

use statrs::distribution::{ContinuousCDF, Normal};
use trace::Instant;

use super::{Metric, Scored, Summary};
use crate::statistics::mean;

/// Time after the beginning of a second contact within which its signal is expected, and after its end until which a signal still
/// belongs to it.
const WINDOW_S: f64 = 0.2;

/// Duration of gaps in a second contact that are bridged.
const GAP_S: f64 = 0.04;

/// Recall of second contacts.
pub const RECALL: Metric = Metric {
    name: "second_recall",
    about: "fraction of the second contacts that are signalled within 0.2 s of their beginning",
    summary: Summary::Mean,
    measure: |scored| {
        let (actual, found) = (contacts_s(scored), signals_s(scored));
        let is_found =
            |&(start_s, _): &(f64, f64)| found.iter().any(|at_s| (start_s..=start_s + WINDOW_S).contains(at_s));
        share(actual.iter().map(is_found))
    },
};

/// Probability that a test takes a single contact for a second one within [`WINDOW_S`]: at three per thousand, one in ten
/// trials of seven seconds has a false signal.
const FALSE_SIGNAL: f64 = 3e-3;

/// Largest recall.
pub const IDEAL_RECALL: Metric = Metric {
    name: "second_ideal_recall",
    about: "bound of second_recall: mean probability that a test which knows the readings with and without the second contact \
            detects it, at a false alarm probability of 0.3 % per 0.2 s",
    summary: Summary::Mean,
    measure: |scored| mean(contacts_s(scored).iter().filter_map(|&(start_s, _)| ideal_recall(scored, start_s))),
};

/// Precision of second contacts.
pub const PRECISION: Metric = Metric {
    name: "second_precision",
    about: "fraction of the signals of a second contact that are raised during one or within 0.2 s after it",
    summary: Summary::Mean,
    measure: |scored| {
        let actual = contacts_s(scored);
        let is_true = |at_s: f64| actual.iter().any(|(start_s, end_s)| (*start_s..=end_s + WINDOW_S).contains(&at_s));
        share(signals_s(scored).into_iter().map(is_true))
    },
};

/// Rate of false signals.
pub const FALSE_RATE: Metric = Metric {
    name: "second_false_per_s",
    about: "signals of a second contact without one, per second of contact",
    summary: Summary::Mean,
    measure: |scored| {
        let actual = contacts_s(scored);
        let is_false = |at_s: &f64| !actual.iter().any(|(start_s, end_s)| (*start_s..=end_s + WINDOW_S).contains(at_s));
        let count = signals_s(scored).iter().filter(|at_s| is_false(at_s)).count();
        let touching = scored.trial.trace.truth.instants.iter().filter(|truth| truth.touching == Some(true)).count();
        (touching > 0).then(|| count as f64 * scored.trial.trace.sidecar.rate_hz / touching as f64)
    },
};

/// Beginnings and ends of the true second contacts.
fn contacts_s(scored: &Scored<'_>) -> Vec<(f64, f64)> {
    let trace = scored.trial.trace;
    let rows = trace.recording.instants.iter().zip(&trace.truth.instants);
    let mut contacts: Vec<(f64, f64)> = Vec::new();
    for (known, _) in rows.filter(|(_, truth)| truth.second.is_some()) {
        match contacts.last_mut() {
            Some((_, end_s)) if known.t_s - *end_s <= GAP_S => *end_s = known.t_s,
            _ => contacts.push((known.t_s, known.t_s)),
        }
    }
    contacts
}

/// Probability that the most powerful test of two known signals in white noise (Neyman and Pearson; Kay, "Fundamentals of
/// Statistical Signal Processing", volume 2, 1998, section 4.3) detects a second contact within [`WINDOW_S`] of its beginning:
/// `Phi(d - q)`, with the root `d` of the sum of the squared differences between the readings and those of the first contact alone,
/// in standard deviations of the noise, and the quantile `q` of the normal distribution of a false alarm.
fn ideal_recall(scored: &Scored<'_>, start_s: f64) -> Option<f64> {
    let trial = scored.trial;
    let (instants, truths) = (&trial.trace.recording.instants, &trial.trace.truth.instants);
    let begin = instants.iter().position(|known| known.t_s >= start_s)?;
    let first = truths[..begin].last()?.contact?;
    let face = trial.knowledge.face(trial.trace.sidecar.face)?;
    let window = instants[begin..].iter().take_while(|known| known.t_s <= start_s + WINDOW_S);
    let alone_n_m = |known: &Instant| Some(face.predict(known.base.inverse().apply(first))?.reading_n_m);
    let differences =
        window.filter_map(|known| Some((known.moment_z_n_m - alone_n_m(known)?) / trial.knowledge.noise_sd_n_m));
    let distance = differences.map(|difference| difference * difference).sum::<f64>().sqrt();
    distance.is_finite().then(|| detection(distance))
}

/// Probability of detection of a difference at this distance in standard deviations.
fn detection(distance: f64) -> f64 {
    let normal = Normal::standard();
    normal.cdf(distance - normal.inverse_cdf(1.0 - FALSE_SIGNAL))
}

/// Times at which the signal is raised.
fn signals_s(scored: &Scored<'_>) -> Vec<f64> {
    let mut was_raised = false;
    let mut signals = Vec::new();
    for (known, estimate) in scored.trial.trace.recording.instants.iter().zip(scored.estimates) {
        let is_raised = estimate.is_some_and(|estimate| estimate.second_contact);
        if is_raised && !was_raised {
            signals.push(known.t_s);
        }
        was_raised = is_raised;
    }
    signals
}

/// Share of true values. `None` without values.
fn share(values: impl Iterator<Item = bool>) -> Option<f64> {
    let (mut count, mut right) = (0, 0);
    values.for_each(|value| {
        count += 1;
        right += usize::from(value);
    });
    (count > 0).then(|| right as f64 / f64::from(count))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn verif_equal_readings_are_detected_as_often_as_a_false_signal() {
        assert!((detection(0.0) - FALSE_SIGNAL).abs() < 1e-9);
        // The quantile of 0.997.
        assert!((detection(2.747_781) - 0.5).abs() < 1e-6 && detection(6.0) > 0.999);
    }
}
