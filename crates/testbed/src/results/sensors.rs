//! Magnetic sensors of a front end.

use serde::{Deserialize, Serialize};

/// Counts of a resting sensor while it is turned by half a circle and back, from zero.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TurnRow {
    /// Time since the start.
    pub t_s: f64,
    /// Yaw of the base since the start.
    pub yaw_rad: f64,
    /// Counts of the axis that is read.
    pub counts: f64,
    /// The same counts with the common mode removed.
    pub compensated_counts: f64,
}

/// Counts of a sensor at one rotation of the root, without noise.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TransferRow {
    /// Gain relative to the sensor without amplifier.
    pub amplified: f64,
    /// Rotation of the root against the base.
    pub rotation_rad: f64,
    /// Counts of the axis along the root.
    pub x_counts: f64,
    /// Counts of the axis across the root in the plane of motion: the one that is read.
    pub y_counts: f64,
    /// Counts of the axis normal to the plane of motion.
    pub z_counts: f64,
}
