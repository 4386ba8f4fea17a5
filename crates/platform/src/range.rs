//! Range checks of lengths and speeds. Messages use the printer's units: mm and mm/min.

use crate::Error;

/// Tolerance at the ends of a range, for rounding, in units of the message.
const ROUNDING: f64 = 1e-6;

/// Checks a length (m).
pub(crate) fn check_length(what: &str, length_m: f64, range_m: [f64; 2]) -> Result<(), Error> {
    check(what, 1e3 * length_m, range_m.map(|end_m| 1e3 * end_m), "mm")
}

/// Checks a speed (m/s).
pub(crate) fn check_speed(what: &str, speed_m_s: f64, range_m_s: [f64; 2]) -> Result<(), Error> {
    check(what, 60e3 * speed_m_s, range_m_s.map(|end_m_s| 60e3 * end_m_s), "mm/min")
}

fn check(what: &str, value: f64, [least, most]: [f64; 2], unit: &str) -> Result<(), Error> {
    if (least - ROUNDING..=most + ROUNDING).contains(&value) {
        return Ok(());
    }
    let found = format!("{} {unit}", shown(value));
    Err(Error::Range { what: what.into(), found, expected: format!("{} to {} {unit}", shown(least), shown(most)) })
}

/// A number as messages show it: rounded to three decimals, without trailing zeros.
pub(crate) fn shown(value: f64) -> f64 {
    (1e3 * value).round() / 1e3
}
