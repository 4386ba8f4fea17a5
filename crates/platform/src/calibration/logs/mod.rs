//! Recorded logs: samples, and what is known of the presses in them.
//!
//! What a file is, its first line tells, never its name. To add a layout of samples: one file with its [`Layout`] and one row in [`LAYOUTS`].

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

/// Reads the fields of a line.
pub type Parse = fn(&[&str]) -> Result<Sample, (usize, &'static str)>;

/// How the samples of a log are written, a line each.
#[derive(Debug)]
pub struct Layout {
    /// Name.
    pub name: &'static str,
    /// One line about it.
    pub about: &'static str,
    /// First lines that are headers of it.
    pub headers: &'static [&'static str],
    /// Names of its columns.
    pub columns: &'static [&'static str],
    /// Reads a line's fields, as many as there are columns; the number of the field that is wrong, from 0, and what it should be.
    pub parse: Parse,
}

/// The registry of layouts. A log without a header has the first whose `parse` takes its first line.
pub const LAYOUTS: &[Layout] = &[native::LAYOUT, deflections::LAYOUT, static_grid::LAYOUT];

/// A number that is finite, in field `i`.
fn seconds(fields: &[&str], i: usize) -> Result<f64, (usize, &'static str)> {
    fields[i].parse().ok().filter(|value: &f64| value.is_finite()).ok_or((i, "a finite number of seconds"))
}

/// Counts of 16 bits, in field `i`.
fn counts(fields: &[&str], i: usize) -> Result<u16, (usize, &'static str)> {
    fields[i].parse().map_err(|_| (i, "counts from 0 to 65535"))
}
