//! Distance between estimated and true contact, unaligned.

use super::{Contact, Metric, Scored, Summary};
use crate::statistics::{quantile, rms};

/// Root mean square of the steady error.
pub const RMSE: Metric = Metric {
    name: "rmse_m",
    about: "root mean square contact error after the first two seconds of contact",
    summary: Summary::Median,
    measure: |scored| rms(&steady(scored)),
};

/// Root mean square of the error once the contact has lasted a second.
pub const RMSE_AFTER_1S: Metric = Metric {
    name: "rmse_after_1s_m",
    about: "root mean square contact error after the first second of contact",
    summary: Summary::Median,
    measure: |scored| {
        let late = scored.contacts.iter().filter(|contact| contact.t_contact_s >= 1.0);
        if scored.is_silent() { None } else { rms(&late.filter_map(|contact| contact.error_m).collect::<Vec<_>>()) }
    },
};

/// Median of the steady error.
pub const MEDIAN: Metric = Metric {
    name: "median_m",
    about: "median contact error after the first two seconds of contact",
    summary: Summary::Median,
    measure: |scored| quantile(&steady(scored), 0.5),
};

/// 95th percentile of the steady error.
pub const P95: Metric = Metric {
    name: "p95_m",
    about: "95th percentile of the contact error after the first two seconds of contact",
    summary: Summary::Median,
    measure: |scored| quantile(&steady(scored), 0.95),
};

/// Largest steady error.
pub const WORST: Metric = Metric {
    name: "worst_m",
    about: "largest contact error after the first two seconds of contact",
    summary: Summary::Worst,
    measure: |scored| quantile(&steady(scored), 1.0),
};

/// Root mean square of the error during start-up.
pub const START_RMSE: Metric = Metric {
    name: "start_rmse_m",
    about: "root mean square contact error within the first two seconds of contact",
    summary: Summary::Median,
    measure: |scored| rms(&stated(scored.start_up())),
};

/// Time to 1 mm.
pub const TIME_TO_1MM: Metric = Metric {
    name: "time_to_1mm_s",
    about: "time from the touch until the error stays below 1 mm to the end",
    summary: Summary::Median,
    measure: |scored| time_to_stay_below(&scored.contacts, 1e-3),
};

/// Time to 0.3 mm.
pub const TIME_TO_0P3MM: Metric = Metric {
    name: "time_to_0p3mm_s",
    about: "time from the touch until the error stays below 0.3 mm to the end",
    summary: Summary::Median,
    measure: |scored| time_to_stay_below(&scored.contacts, 0.3e-3),
};

/// Whether the error never stays below 1 mm.
pub const NEVER_1MM: Metric = Metric {
    name: "never_1mm",
    about: "1 where the error never stays below 1 mm; over trials, their share",
    summary: Summary::Mean,
    measure: |scored| Some(f64::from(time_to_stay_below(&scored.contacts, 1e-3).is_none())),
};

/// Errors of the steady contact; none where the estimator is silent for too much of it.
fn steady(scored: &Scored<'_>) -> Vec<f64> {
    if scored.is_silent() { Vec::new() } else { stated(scored.steady()) }
}

fn stated(contacts: &[Contact]) -> Vec<f64> {
    contacts.iter().filter_map(|contact| contact.error_m).collect()
}

/// Time after which the error stays below a bound to the end. A missing estimate is not below it.
fn time_to_stay_below(contacts: &[Contact], bound_m: f64) -> Option<f64> {
    let below = |contact: &Contact| contact.error_m.is_some_and(|error| error < bound_m);
    let start = contacts.iter().rposition(|contact| !below(contact)).map_or(0, |last| last + 1);
    contacts.get(start).map(|contact| contact.t_contact_s)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn contacts(errors_m: &[Option<f64>]) -> Vec<Contact> {
        let contact = |(row, &error_m)| Contact { row, t_contact_s: row as f64, error_m, nees: None, nis: None };
        errors_m.iter().enumerate().map(contact).collect()
    }

    #[test]
    fn verif_time_to_stay_below_counts_from_the_last_excess() {
        let mm = 1e-3;
        assert_eq!(time_to_stay_below(&contacts(&[Some(0.1 * mm); 3]), mm), Some(0.0));
        assert_eq!(time_to_stay_below(&contacts(&[Some(2.0 * mm), Some(0.1 * mm), Some(0.2 * mm)]), mm), Some(1.0));
        assert_eq!(time_to_stay_below(&contacts(&[Some(0.1 * mm), None, Some(0.2 * mm)]), mm), Some(2.0));
        assert_eq!(time_to_stay_below(&contacts(&[Some(0.1 * mm), Some(2.0 * mm)]), mm), None);
    }
}
