//! Quantities that an estimator states beside the contact.

use serde::{Deserialize, Serialize};

/// A quantity that an estimator states in one trial at its last estimate during a contact at a single place, against the true
/// value. There are no rows for several whiskers on an arm, for recordings of real sensors, and through front ends with sensors,
/// whose deviations are not known.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct QuantityRow {
    /// Name of the trace.
    pub trace: String,
    /// Group of the trace.
    pub group: String,
    /// Whisker of the trace.
    pub whisker: String,
    /// Shape of the object.
    pub object: String,
    /// Name of the estimator in the registry.
    pub estimator: String,
    /// Measurement noise as a fraction of the set's largest reading.
    pub noise: f64,
    /// Seed of the measurement noise.
    pub seed: u64,
    /// Duration of all contacts at a single place up to the estimate.
    pub contact_s: f64,
    /// Deviation of the sensor from its calibration, `gain` (relative), `mount_rad`, `mount_x_m` or `mount_y_m`, or velocity of the
    /// object in World, `object_vx_m_s` or `object_vy_m_s`.
    pub quantity: String,
    /// True value.
    pub truth: f64,
    /// Estimated value.
    pub estimate: f64,
    /// Estimated minus true value.
    pub error: f64,
    /// Standard deviation of the estimated value.
    pub sd: f64,
    /// Posterior Cramér–Rao bound of the standard deviation with an object of unknown size: for a deviation with unknown gain and
    /// mounting, for a velocity with those deviations unknown that are not zero. `None` without noise; for a velocity also if the
    /// object rests.
    pub bound: Option<f64>,
}
