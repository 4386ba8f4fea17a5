//! Recorded logs: samples and labels of presses.
//!
//! The first line of a file determines its layout, not its name. To add a layout of samples: one file with its
//! [`Layout`] and one row in [`LAYOUTS`].

mod deflections;
mod gather;
mod labels;
mod native;
mod reader;
mod static_grid;
mod table;

pub use gather::{GatherError, Gathered, Source, gather};
pub use labels::{Labels, Span};
pub use reader::LogReader;

use crate::Sample;

/// Largest distance of a press from the whisker's root (m). A larger one has another unit.
const FARTHEST_M: f64 = 1.0;

/// Byte order mark of UTF-8, which editors on Windows write at the beginning of a file.
const MARK: char = '\u{feff}';

/// Values expected in place of a distance (m) of a press. `None` if the distance is plausible.
fn expected_distance(distance_m: f64) -> Option<String> {
    if distance_m > FARTHEST_M {
        return Some(format!("at most {FARTHEST_M} m; compare the unit"));
    }
    (distance_m <= 0.0 || distance_m.is_nan()).then(|| "a distance above zero".into())
}

/// Parser of the fields of a line.
pub type Parse = fn(&[&str]) -> Result<Sample, (usize, &'static str)>;

/// Layout of a log with one sample per line.
#[derive(Debug)]
pub struct Layout {
    /// Name.
    pub name: &'static str,
    /// Description in one line.
    pub about: &'static str,
    /// Accepted headers.
    pub headers: &'static [&'static str],
    /// Names of its columns.
    pub columns: &'static [&'static str],
    /// Parses a line's fields, as many as there are columns. The error is the index of the wrong field, from 0, and the
    /// expected content.
    pub parse: Parse,
}

/// Registry of layouts. A log without a header has the first layout whose `parse` accepts its first line.
pub const LAYOUTS: &[Layout] = &[native::LAYOUT, deflections::LAYOUT, static_grid::LAYOUT];

/// Sample whose first four fields are the time (s) and three axes.
fn three_axes(fields: &[&str]) -> Result<Sample, (usize, &'static str)> {
    let counts = [counts(fields, 1)?, counts(fields, 2)?, counts(fields, 3)?];
    Ok(Sample { t_s: seconds(fields, 0)?, counts })
}

/// Finite number in field `i` (s).
fn seconds(fields: &[&str], i: usize) -> Result<f64, (usize, &'static str)> {
    fields[i].parse().ok().filter(|value: &f64| value.is_finite()).ok_or((i, "a finite number of seconds"))
}

/// 16-bit counts in field `i`.
fn counts(fields: &[&str], i: usize) -> Result<u16, (usize, &'static str)> {
    fields[i].parse().map_err(|_| (i, "counts from 0 to 65535"))
}
