//! Repeated deflections of the Ratatouille whisker: wall-clock time and two axes, with or without a header.

use super::{Layout, counts};
use crate::Sample;

pub(super) const LAYOUT: Layout = Layout {
    name: "deflections",
    about: "wall-clock time `2024-04-17_11:48:11.545069` and two axes, as Ratatouille records them",
    headers: &["timestamp,AX,AY"],
    columns: &["timestamp", "AX", "AY"],
    parse,
};

fn parse(fields: &[&str]) -> Result<Sample, (usize, &'static str)> {
    let t_s = wall_clock_s(fields[0]).ok_or((0, "a time like 2024-04-17_11:48:11.545069"))?;
    Ok(Sample { t_s, counts: [counts(fields, 1)?, counts(fields, 2)?, 0] })
}

/// Seconds since the beginning of 1970, in the log's time zone.
fn wall_clock_s(text: &str) -> Option<f64> {
    let (date, time) = text.split_once('_')?;
    let [year, month, day] = parts(date, '-')?.map(|part| part.parse::<i64>().ok());
    let [hours, minutes, seconds] = parts(time, ':')?;
    let (hours, minutes) = (hours.parse::<u32>().ok()?, minutes.parse::<u32>().ok()?);
    let seconds = seconds.parse::<f64>().ok()?;
    let (year, month, day) = (year?, month?, day?);
    let valid = (1..=12).contains(&month) && (1..=31).contains(&day) && hours < 24 && minutes < 60;
    let valid = valid && (1970..=9999).contains(&year) && (0.0..61.0).contains(&seconds);
    valid
        .then(|| 86_400.0 * days_since_1970(year, month, day) as f64 + f64::from(3600 * hours + 60 * minutes) + seconds)
}

fn parts(text: &str, separator: char) -> Option<[&str; 3]> {
    text.split(separator).collect::<Vec<_>>().try_into().ok()
}

/// Days since 1970-01-01 in the Gregorian calendar, computed with years that begin in March, so that a leap day is the
/// last of its year.
fn days_since_1970(year: i64, month: i64, day: i64) -> i64 {
    let (year, month) = if month > 2 { (year, month - 3) } else { (year - 1, month + 9) };
    let of_year = (153 * month + 2) / 5 + day - 1;
    365 * year + year / 4 - year / 100 + year / 400 + of_year - 719_468
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn val_wall_clock_against_unix_time() {
        for (text, unix_s) in [
            ("1970-01-01_00:00:00.0", 0.0),
            ("2000-02-29_12:00:00", 951_825_600.0),
            ("2024-04-17_11:48:11.545069", 1_713_354_491.545_069),
            ("2100-03-01_00:00:00", 4_107_542_400.0),
        ] {
            assert_eq!(wall_clock_s(text), Some(unix_s), "{text}");
        }
        for text in ["", "2024-04-17", "2024-13-17_11:48:11", "2024-04-17_24:48:11", "2024-04-17_11:48:x", "24_1_1"] {
            assert_eq!(wall_clock_s(text), None, "{text}");
        }
    }
}
