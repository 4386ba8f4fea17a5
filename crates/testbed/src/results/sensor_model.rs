//! Sensor models and their residuals, written beside a calibration and copied into a run.

use serde::{Deserialize, Serialize};
use whisker::sensor::Face;

/// Sensor model at one node of a grid over its calibrated domain.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SurfaceRow {
    /// Arc length of the nearest point of the undeflected whisker.
    pub arc_m: f64,
    /// Distance from the undeflected whisker, positive away from the object.
    pub distance_m: f64,
    /// Contact in Base, x.
    pub x_m: f64,
    /// Contact in Base, y.
    pub y_m: f64,
    /// Expected reading.
    pub reading_n_m: f64,
}

/// Residual of one calibration sample under the model fitted to the other traces.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ResidualRow {
    /// Name of the calibration trace.
    pub trace: String,
    /// Contact in Base, x.
    pub x_m: f64,
    /// Contact in Base, y.
    pub y_m: f64,
    /// Reading without measurement noise.
    pub reading_n_m: f64,
    /// Predicted less true reading.
    pub residual_n_m: f64,
}

/// Stem of the files about one face, beside a calibration or in a run.
pub fn face_stem(whisker: &str, face: Face) -> String {
    format!("{whisker}_{}", face.name())
}
