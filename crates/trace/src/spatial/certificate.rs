//! Certificate of the ground truth of a simulated trace in space.

use serde::{Deserialize, Serialize};

use crate::Breach;
use crate::certificate::breaches;

/// Deviation of the simulation from the exact quasi-static rod, at a sample of the trace's quasi-static instants.
///
/// Error figures are `None` if there are no such instants.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SpatialCertificate {
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
    /// RMS error of the worst component of the root moment, relative to the largest moment of the trace.
    pub moment_rms: Option<f64>,
    /// Largest error of a component of the root moment, relative to the largest moment of the trace.
    pub moment_worst: Option<f64>,
    /// Largest change of a component's error from one row to the next, relative to the largest moment of the trace.
    pub moment_jump: Option<f64>,
    /// RMS error of the axial force, relative to the largest contact force of the trace.
    pub axial_rms: Option<f64>,
    /// RMS error of the contact on the solid's surface.
    pub surface_rms_m: Option<f64>,
    /// Largest error of the contact on the solid's surface.
    pub surface_worst_m: Option<f64>,
    /// RMS error of the contact's arc length.
    pub arc_rms_m: Option<f64>,
    /// Largest error of the contact's arc length.
    pub arc_worst_m: Option<f64>,
    /// RMS angle between the normals of the contact.
    pub normal_rms_rad: Option<f64>,
    /// Largest angle between the normals of the contact.
    pub normal_worst_rad: Option<f64>,
    /// Largest angle between the simulated force and the normal of the contact.
    pub force_worst_rad: Option<f64>,
    /// Largest penetration.
    pub penetration_worst_m: Option<f64>,
}

impl SpatialCertificate {
    /// Bound of the RMS moment error, relative to the largest moment of the trace.
    pub const MOMENT_RMS: f64 = 1e-3;
    /// Bound of the change of the moment error between two rows.
    pub const MOMENT_JUMP: f64 = 1e-3;
    /// Bound of the RMS error of the contact on the surface.
    pub const SURFACE_RMS_M: f64 = 20e-6;
    /// Bound of the RMS angle between the normals: 0.2 degrees.
    pub const NORMAL_RMS_RAD: f64 = 3.5e-3;
    /// Bound of the penetration.
    pub const PENETRATION_WORST_M: f64 = 10e-6;

    /// Figures that exceed their bounds. Missing figures are not checked.
    pub fn breaches(&self) -> Vec<Breach> {
        breaches([
            ("unsolved", Some(self.unsolved as f64), 0.0),
            ("moment_rms", self.moment_rms, Self::MOMENT_RMS),
            ("moment_jump", self.moment_jump, Self::MOMENT_JUMP),
            ("surface_rms_m", self.surface_rms_m, Self::SURFACE_RMS_M),
            ("normal_rms_rad", self.normal_rms_rad, Self::NORMAL_RMS_RAD),
            ("penetration_worst_m", self.penetration_worst_m, Self::PENETRATION_WORST_M),
        ])
    }
}
