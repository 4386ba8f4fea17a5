//! Contact error over rows instead of seconds, for recordings without a clock.

use super::{Contact, Metric, Scored, Summary};
use crate::statistics::mean;

/// Mean error after a third of the contact.
pub const LATE_MEAN: Metric = Metric {
    name: "late_mean_m",
    about: "mean contact error after the first third of the contact",
    summary: Summary::Mean,
    measure: |scored| mean(late(scored)),
};

/// Largest error after a third of the contact.
pub const LATE_WORST: Metric = Metric {
    name: "late_worst_m",
    about: "largest contact error after the first third of the contact",
    summary: Summary::Worst,
    measure: |scored| late(scored).into_iter().reduce(f64::max),
};

/// Rows to an error of 1 mm.
pub const ROWS_TO_1MM: Metric = Metric {
    name: "rows_to_1mm",
    about: "number of rows from the touch until the error is first below 1 mm",
    summary: Summary::Median,
    measure: |scored| rows_to(&scored.contacts, 1e-3),
};

/// Errors after the first third of the contact; empty if an estimate is missing there, since omitting it would bias the
/// metric.
fn late(scored: &Scored<'_>) -> Vec<f64> {
    let late = &scored.contacts[scored.contacts.len() / 3..];
    late.iter().map(|contact| contact.error_m).collect::<Option<_>>().unwrap_or_default()
}

/// Rows before the first error below a bound.
fn rows_to(contacts: &[Contact], bound_m: f64) -> Option<f64> {
    let reached = contacts.iter().find(|contact| contact.error_m.is_some_and(|error| error < bound_m))?;
    Some((reached.row - contacts[0].row) as f64)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn verif_rows_are_counted_from_the_touch() {
        let contact = |row: usize, error_m: f64| Contact {
            row,
            t_contact_s: 0.0,
            is_calibrated: true,
            error_m: Some(error_m),
            nees: None,
            nis: None,
        };
        let contacts = [contact(7, 4e-3), contact(8, 2e-3), contact(9, 0.9e-3), contact(10, 3e-3)];
        assert_eq!(rows_to(&contacts, 1e-3), Some(2.0));
        assert_eq!(rows_to(&contacts[..2], 1e-3), None);
    }
}
