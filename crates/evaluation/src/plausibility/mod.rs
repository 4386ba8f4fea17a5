//! Plausibility of a trace: tests that a wrong unit, sign, frame or rate would break.
//!
//! A trace can satisfy its format and still state millimetres as metres or degrees as radians. Each row of [`TESTS`]
//! compares redundant quantities of a trace, or a quantity with its physical bound, and states the probable
//! error that causes a disagreement. The bounds lie far outside the values of the project's suites; a test without the
//! data that it requires has no findings.
//!
//! To add a test: one file with a function from a [`Subject`] to its [`Finding`]s, and one row in [`TESTS`]. Traces in space have
//! their own registry, [`SPATIAL_TESTS`].

mod frozen;
mod mechanics;
mod moment;
mod motion;
mod spatial;
mod time;

use std::fmt;

use trace::{CalibrationFile, Instant, Trace};
use whisker::sensor::Face;

use crate::glitches;

pub use spatial::{SPATIAL_TESTS, SpatialTest, spatial_findings};
pub use time::{TimeSteps, contradicted_rate, contradicted_rate_in_space};

/// Largest moment, in standard deviations of the noise that a recording contains, up to which its whisker may be free.
const FREE_SDS: f64 = 8.0;

/// Trace to be tested.
#[derive(Clone, Copy, Debug)]
pub struct Subject<'a> {
    /// The trace.
    pub trace: &'a Trace,
    /// Calibration of its whisker, if known.
    pub calibration: Option<&'a CalibrationFile>,
    /// Largest magnitude of the moment without single outliers: that of its running median of five.
    largest_n_m: f64,
}

/// Disagreement of a trace with itself or with physics.
#[derive(Clone, Debug, PartialEq)]
pub struct Finding {
    /// Quantities that disagree, as column or key names.
    pub place: &'static str,
    /// Value found.
    pub found: String,
    /// Value expected.
    pub expected: String,
    /// Probable error that causes it.
    pub looks_like: String,
}

impl fmt::Display for Finding {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { place, found, expected, looks_like } = self;
        write!(formatter, "{place}: found {found}, expected {expected}: {looks_like}")
    }
}

/// A row of the registry of tests.
pub struct Test {
    /// Name.
    pub name: &'static str,
    /// One-line description.
    pub about: &'static str,
    find: fn(&Subject<'_>) -> Vec<Finding>,
}

#[rustfmt::skip]
/// The registry of tests.
pub const TESTS: &[Test] = &[
    Test { name: "rate", about: "rate_hz against the times", find: time::rate },
    Test { name: "twist", about: "twist against finite differences of the poses", find: motion::twist },
    Test { name: "yaw", about: "size, rate and continuity of the yaw", find: motion::yaw },
    Test { name: "travel", about: "speed of the base, jumps of its position and its travel in one touch", find: motion::travel },
    Test { name: "glitches", about: "single readings far above all others", find: moment::glitches },
    Test { name: "frozen", about: "equal readings while the touched whisker moves", find: frozen::readings },
    Test { name: "rotation", about: "moment against the rotation of the root", find: moment::rotation },
    Test { name: "strength", about: "moment against the largest deflection that the whisker withstands", find: moment::strength },
    Test { name: "calibrated", about: "moment against the largest calibrated reading", find: moment::calibrated },
    Test { name: "face", about: "face against the sign of the moment", find: moment::face },
    Test { name: "mechanics", about: "moment against the elastica through the true contact", find: mechanics::elastica },
];

impl<'a> Subject<'a> {
    /// A trace, with the calibration of its whisker if known.
    pub fn new(trace: &'a Trace, calibration: Option<&'a CalibrationFile>) -> Self {
        let largest_n_m = glitches::largest(&trace.moments_n_m());
        Self { trace, calibration, largest_n_m }
    }

    /// Findings of all tests. Of several findings with the same probable error, the first.
    pub fn findings(&self) -> Vec<Finding> {
        let mut findings: Vec<Finding> = Vec::new();
        for found in TESTS.iter().flat_map(|test| (test.find)(self)) {
            if findings.iter().all(|known| known.looks_like != found.looks_like) {
                findings.push(found);
            }
        }
        findings
    }

    /// Face to which the sign of the moment belongs in most of the loaded rows. `None` without such rows.
    pub fn touching_face(&self) -> Option<Face> {
        moment::touching_face(self).map(|(face, _)| face)
    }

    fn instants(&self) -> &'a [Instant] {
        &self.trace.recording.instants
    }

    /// Indices of the rows in which the whisker is loaded by more than this share of the largest moment, without
    /// glitches. Empty if all moments may be noise.
    fn loaded(&self, share: f64) -> impl Iterator<Item = usize> {
        let range = share * self.largest_n_m..=self.largest_n_m;
        let touches = self.largest_n_m > FREE_SDS * self.trace.sidecar.own_noise_sd_n_m();
        let is_loaded = move |row: &usize| range.contains(&self.instants()[*row].moment_z_n_m.abs());
        (0..self.instants().len()).filter(move |row| touches && is_loaded(row))
    }
}

/// Median of values. `None` if there are none.
fn median(values: &mut [f64]) -> Option<f64> {
    let middle = values.len().checked_sub(1)? / 2;
    Some(*values.select_nth_unstable_by(middle, f64::total_cmp).1)
}

/// Value below which this share of the values lies. `None` if there are none.
fn quantile(values: &mut [f64], share: f64) -> Option<f64> {
    let last = values.len().checked_sub(1)?;
    Some(*values.select_nth_unstable_by((share * last as f64) as usize, f64::total_cmp).1)
}

#[cfg(test)]
mod tests;
