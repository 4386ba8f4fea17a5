//! What a simulated trace says of its own truth.

use serde::{Deserialize, Serialize};

/// Disagreement of the simulator with the exact quasi-static whisker, at a sample of a trace's quasi-static instants.
///
/// A figure is missing where there are no such instants.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Certificate {
    /// Rows in contact.
    pub touching: usize,
    /// Rows in contact at the tip.
    pub tip: usize,
    /// Rows in contact in places apart from one another.
    pub split: usize,
    /// Quasi-static rows.
    pub quasi_static: usize,
    /// Quasi-static rows that were solved again.
    pub sampled: usize,
    /// Sampled rows for which theory finds no contact in one place.
    pub unsolved: usize,
    /// Moment at the root, RMS, relative to the trace's largest.
    pub moment_rms: Option<f64>,
    /// The same, worst.
    pub moment_worst: Option<f64>,
    /// Contact on the object's surface, RMS.
    pub surface_rms_m: Option<f64>,
    /// The same, worst.
    pub surface_worst_m: Option<f64>,
    /// Arc length of the contact, RMS.
    pub arc_rms_m: Option<f64>,
    /// The same, worst.
    pub arc_worst_m: Option<f64>,
    /// Penetration, worst.
    pub penetration_worst_m: Option<f64>,
}

/// A figure of a certificate that lies above its bound.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Breach {
    /// Key of the figure.
    pub key: &'static str,
    /// The figure.
    pub found: f64,
    /// What it may be at most.
    pub bound: f64,
}

impl Certificate {
    /// Largest moment error, relative to the trace's largest moment, RMS.
    pub const MOMENT_RMS: f64 = 1e-3;
    /// Largest error of the contact on the surface, RMS.
    pub const SURFACE_RMS_M: f64 = 10e-6;
    /// Largest error of the contact on the surface at any instant.
    pub const SURFACE_WORST_M: f64 = 60e-6;
    /// Largest error of the arc length, RMS.
    pub const ARC_RMS_M: f64 = 40e-6;
    /// Deepest penetration.
    pub const PENETRATION_WORST_M: f64 = 10e-6;

    /// The figures that lie above their bounds; a certificate without figures has none.
    pub fn breaches(&self) -> Vec<Breach> {
        [
            ("unsolved", Some(self.unsolved as f64), 0.0),
            ("moment_rms", self.moment_rms, Self::MOMENT_RMS),
            ("surface_rms_m", self.surface_rms_m, Self::SURFACE_RMS_M),
            ("surface_worst_m", self.surface_worst_m, Self::SURFACE_WORST_M),
            ("arc_rms_m", self.arc_rms_m, Self::ARC_RMS_M),
            ("penetration_worst_m", self.penetration_worst_m, Self::PENETRATION_WORST_M),
        ]
        .into_iter()
        .filter_map(|(key, found, bound)| {
            found.filter(|found| *found > bound).map(|found| Breach { key, found, bound })
        })
        .collect()
    }
}
