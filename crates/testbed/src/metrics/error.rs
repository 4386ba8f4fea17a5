//! Distance between estimated and true contact, without alignment.

use super::scored::errors_m;
use super::{Contact, Metric, Summary};
use crate::statistics::{mean, quantile, rms};

/// RMS of the steady error.
pub const RMSE: Metric = Metric {
    name: "rmse_m",
    about: "RMS contact error after the first two seconds of contact",
    summary: Summary::Median,
    measure: |scored| rms(&errors_m(scored.steady())),
};

/// Median of the steady error.
pub const MEDIAN: Metric = Metric {
    name: "median_m",
    about: "median contact error after the first two seconds of contact",
    summary: Summary::Median,
    measure: |scored| quantile(&errors_m(scored.steady()), 0.5),
};

/// 95th percentile of the steady error.
pub const P95: Metric = Metric {
    name: "p95_m",
    about: "95th percentile of the contact error after the first two seconds of contact",
    summary: Summary::Median,
    measure: |scored| quantile(&errors_m(scored.steady()), 0.95),
};

/// Largest steady error.
pub const WORST: Metric = Metric {
    name: "worst_m",
    about: "largest contact error after the first two seconds of contact",
    summary: Summary::Worst,
    measure: |scored| quantile(&errors_m(scored.steady()), 1.0),
};

/// RMS of the error during start-up.
pub const START_RMSE: Metric = Metric {
    name: "start_rmse_m",
    about: "RMS contact error within the first two seconds of contact",
    summary: Summary::Median,
    measure: |scored| rms(&errors_m(scored.start_up())),
};

/// Time to an error of 1 mm.
pub const TIME_TO_1MM: Metric = Metric {
    name: "time_to_1mm_s",
    about: "time from the touch after which the error stays below 1 mm",
    summary: Summary::Median,
    measure: |scored| time_to_stay_below(&scored.contacts, 1e-3),
};

/// Time to an error of 0.3 mm.
pub const TIME_TO_0P3MM: Metric = Metric {
    name: "time_to_0p3mm_s",
    about: "time from the touch after which the error stays below 0.3 mm",
    summary: Summary::Median,
    measure: |scored| time_to_stay_below(&scored.contacts, 0.3e-3),
};

/// Whether the error never stays below 1 mm.
pub const NEVER_1MM: Metric = Metric {
    name: "never_1mm",
    about: "1 if the error never stays below 1 mm, else 0; over trials, the fraction",
    summary: Summary::Mean,
    measure: |scored| Some(f64::from(time_to_stay_below(&scored.contacts, 1e-3).is_none())),
};

/// Share of the contact with an estimate.
pub const ANSWERED: Metric = Metric {
    name: "answered",
    about: "fraction of the instants of true contact in the calibrated domain and before the tip, from the first touch \
        on, at which the estimator states an estimate",
    summary: Summary::Mean,
    measure: |scored| {
        let calibrated = scored.contacts.iter().filter(|contact| contact.is_calibrated);
        mean(calibrated.map(|contact| f64::from(contact.error_m.is_some())))
    },
};

/// Time after which the error stays below a bound until the end. Missing estimates count as above it where one is expected: in the
/// calibrated domain and before the tip.
fn time_to_stay_below(contacts: &[Contact], bound_m: f64) -> Option<f64> {
    let below = |contact: &Contact| contact.error_m.map_or(!contact.is_calibrated, |error_m| error_m < bound_m);
    let start = contacts.iter().rposition(|contact| !below(contact)).map_or(0, |last| last + 1);
    contacts[start..].iter().find(|contact| contact.error_m.is_some()).map(|contact| contact.t_contact_s)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn contacts(errors_m: &[Option<f64>]) -> Vec<Contact> {
        let contact = |(row, &error_m)| Contact {
            row,
            t_contact_s: row as f64,
            is_calibrated: true,
            error_m,
            nees: None,
            nis: None,
        };
        errors_m.iter().enumerate().map(contact).collect()
    }

    #[test]
    fn verif_time_to_stay_below_starts_after_the_last_excess() {
        let mm = 1e-3;
        assert_eq!(time_to_stay_below(&contacts(&[Some(0.1 * mm); 3]), mm), Some(0.0));
        assert_eq!(time_to_stay_below(&contacts(&[Some(2.0 * mm), Some(0.1 * mm), Some(0.2 * mm)]), mm), Some(1.0));
        assert_eq!(time_to_stay_below(&contacts(&[Some(0.1 * mm), None, Some(0.2 * mm)]), mm), Some(2.0));
        assert_eq!(time_to_stay_below(&contacts(&[Some(0.1 * mm), Some(2.0 * mm)]), mm), None);
    }

    #[test]
    fn regress_an_estimate_that_is_not_expected_is_no_error() {
        let mut beyond = contacts(&[None, Some(0.1e-3), None]);
        (beyond[0].is_calibrated, beyond[2].is_calibrated) = (false, false);
        assert_eq!(time_to_stay_below(&beyond, 1e-3), Some(1.0));
        assert_eq!(time_to_stay_below(&beyond[..1], 1e-3), None, "without any estimate");
    }
}
