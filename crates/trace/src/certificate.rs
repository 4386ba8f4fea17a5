//! Certificate of a simulated trace's ground truth.

use serde::{Deserialize, Serialize};

/// Deviation of the simulation from the exact quasi-static whisker (elastica), at a sample of the trace's quasi-static
/// instants.
///
/// Error figures are `None` if there are no such instants.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Certificate {
    /// Rows in contact.
    pub touching: usize,
    /// Rows in contact at the tip.
    pub tip: usize,
    /// Rows with several separate contacts.
    pub split: usize,
    /// Quasi-static rows.
    pub quasi_static: usize,
    /// Quasi-static rows compared with the exact solution.
    pub sampled: usize,
    /// Compared rows for which the exact solution has no single contact.
    pub unsolved: usize,
    /// RMS error of the root moment, relative to the largest moment of the trace.
    pub moment_rms: Option<f64>,
    /// Largest error of the root moment, relative to the largest moment of the trace.
    pub moment_worst: Option<f64>,
    /// RMS error of the contact on the object's surface.
    pub surface_rms_m: Option<f64>,
    /// Largest error of the contact on the object's surface.
    pub surface_worst_m: Option<f64>,
    /// RMS error of the contact's arc length.
    pub arc_rms_m: Option<f64>,
    /// Largest error of the contact's arc length.
    pub arc_worst_m: Option<f64>,
    /// Largest penetration.
    pub penetration_worst_m: Option<f64>,
    /// Compared rows with two contacts. `None` for convex objects.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sampled_twice: Option<usize>,
}

/// Figure of a certificate that exceeds its bound.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Breach {
    /// Key of the figure.
    pub key: &'static str,
    /// Value found.
    pub found: f64,
    /// Upper bound.
    pub bound: f64,
}

impl Certificate {
    /// Bound of the RMS moment error, relative to the largest moment of the trace.
    pub const MOMENT_RMS: f64 = 1e-3;
    /// Bound of the RMS error of the contact on the surface.
    pub const SURFACE_RMS_M: f64 = 10e-6;
    /// Bound of the largest error of the contact on the surface.
    pub const SURFACE_WORST_M: f64 = 60e-6;
    /// Bound of the RMS error of the arc length.
    pub const ARC_RMS_M: f64 = 40e-6;
    /// Bound of the penetration.
    pub const PENETRATION_WORST_M: f64 = 10e-6;

    /// Figures that exceed their bounds. Missing figures are not checked.
    pub fn breaches(&self) -> Vec<Breach> {
        breaches([
            ("unsolved", Some(self.unsolved as f64), 0.0),
            ("moment_rms", self.moment_rms, Self::MOMENT_RMS),
            ("surface_rms_m", self.surface_rms_m, Self::SURFACE_RMS_M),
            ("surface_worst_m", self.surface_worst_m, Self::SURFACE_WORST_M),
            ("arc_rms_m", self.arc_rms_m, Self::ARC_RMS_M),
            ("penetration_worst_m", self.penetration_worst_m, Self::PENETRATION_WORST_M),
        ])
    }
}

/// Of figures with their keys and upper bounds, those that exceed the bound. Missing figures are not checked.
pub(crate) fn breaches<const COUNT: usize>(figures: [(&'static str, Option<f64>, f64); COUNT]) -> Vec<Breach> {
    let exceeds = |(key, found, bound): (_, Option<f64>, f64)| {
        found.filter(|found| *found > bound).map(|found| Breach { key, found, bound })
    };
    figures.into_iter().filter_map(exceeds).collect()
}
