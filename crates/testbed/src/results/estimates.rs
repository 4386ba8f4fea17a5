//! Rows by instant of a replayed trial.

use serde::{Deserialize, Serialize};
use trace::{Instant, TruthInstant};
use whisker::estimators::{Estimate, Knowledge};

/// One instant of one replayed trial: known motion and reading, estimate, and truth. Points in World.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct EstimateRow {
    /// Time since the start of the trace.
    pub t_s: f64,
    /// Position of the base, x.
    pub base_x_m: f64,
    /// Position of the base, y.
    pub base_y_m: f64,
    /// Yaw of the base.
    pub base_yaw_rad: f64,
    /// Reading with measurement noise, as given to the estimator.
    pub reading_n_m: f64,
    /// Estimated contact, x.
    pub contact_x_m: Option<f64>,
    /// Estimated contact, y.
    pub contact_y_m: Option<f64>,
    /// Estimated point of the object's surface, x.
    pub surface_x_m: Option<f64>,
    /// Estimated point of the object's surface, y.
    pub surface_y_m: Option<f64>,
    /// Posterior variance of the contact along x.
    pub cov_xx_m2: Option<f64>,
    /// Posterior covariance of the contact between x and y.
    pub cov_xy_m2: Option<f64>,
    /// Posterior variance of the contact along y.
    pub cov_yy_m2: Option<f64>,
    /// Whether the estimated contact lies in the calibrated domain of the sensor model.
    pub calibrated: Option<bool>,
    /// Whether the estimated contact may lie at the tip.
    pub at_tip: Option<bool>,
    /// Estimated radius of curvature of the object at the contact.
    pub radius_m: Option<f64>,
    /// Standard deviation of `radius_m`.
    pub radius_sd_m: Option<f64>,
    /// Estimated coefficient of friction between whisker and object.
    pub friction: Option<f64>,
    /// Standard deviation of `friction`.
    pub friction_sd: Option<f64>,
    /// Estimated velocity of the object in World, x (m/s), if it moves.
    pub object_vx_m_s: Option<f64>,
    /// Standard deviation of `object_vx_m_s`.
    pub object_vx_sd_m_s: Option<f64>,
    /// Estimated velocity of the object in World, y (m/s), if it moves.
    pub object_vy_m_s: Option<f64>,
    /// Standard deviation of `object_vy_m_s`.
    pub object_vy_sd_m_s: Option<f64>,
    /// Estimated relative error of the sensor's gain, if the sensor deviates from its calibration.
    pub gain: Option<f64>,
    /// Standard deviation of `gain`.
    pub gain_sd: Option<f64>,
    /// Estimated yaw of the calibrated Base in the actual one, if the sensor deviates.
    pub mount_rad: Option<f64>,
    /// Standard deviation of `mount_rad`.
    pub mount_sd_rad: Option<f64>,
    /// Estimated position of the calibrated Base in the actual one, x, if the sensor deviates.
    pub mount_x_m: Option<f64>,
    /// Standard deviation of `mount_x_m`.
    pub mount_x_sd_m: Option<f64>,
    /// Estimated position of the calibrated Base in the actual one, y, if the sensor deviates.
    pub mount_y_m: Option<f64>,
    /// Standard deviation of `mount_y_m`.
    pub mount_y_sd_m: Option<f64>,
    /// Probabilities of the models that the estimator averages, the most probable first, as `sliding=0.970 ekf=0.030`.
    pub models: Option<String>,
    /// Whether the readings contradict the models that the estimator averages.
    pub model_doubtful: Option<bool>,
    /// Whether a second contact has taken load.
    pub second_contact: Option<bool>,
    /// True contact, x.
    pub truth_contact_x_m: Option<f64>,
    /// True contact, y.
    pub truth_contact_y_m: Option<f64>,
    /// True point of the object's surface, x.
    pub truth_surface_x_m: Option<f64>,
    /// True point of the object's surface, y.
    pub truth_surface_y_m: Option<f64>,
}

/// Row of `estimates/<trace>.<estimator>.csv`: estimate and truth at one instant.
pub fn estimate_row(
    knowledge: &Knowledge,
    known: &Instant,
    truth: &TruthInstant,
    reading_n_m: f64,
    estimate: Option<&Estimate>,
) -> EstimateRow {
    let contact = estimate.map(|e| known.base.apply(e.contact));
    let surface = estimate.map(|e| known.base.apply(knowledge.surface(e, reading_n_m)));
    let covariance = estimate.and_then(|e| e.covariance_m2).map(|p| known.base.turn(p));
    let moves = estimate.and_then(|e| e.velocity).map(|velocity| velocity.turned(&known.base));
    let velocity = |axis: usize| moves.map(|velocity| velocity.velocity_m_s[axis]);
    let velocity_sd = |axis: usize| moves.map(|velocity| velocity.sds_m_s()[axis]);
    let deviates = estimate.and_then(|e| e.installation);
    EstimateRow {
        t_s: known.t_s,
        base_x_m: known.base.origin().x(),
        base_y_m: known.base.origin().y(),
        base_yaw_rad: known.base.yaw_rad(),
        reading_n_m,
        contact_x_m: contact.map(|p| p.x()),
        contact_y_m: contact.map(|p| p.y()),
        surface_x_m: surface.map(|p| p.x()),
        surface_y_m: surface.map(|p| p.y()),
        cov_xx_m2: covariance.map(|p| p[(0, 0)]),
        cov_xy_m2: covariance.map(|p| p[(0, 1)]),
        cov_yy_m2: covariance.map(|p| p[(1, 1)]),
        calibrated: estimate.map(|e| e.calibrated),
        at_tip: estimate.map(|e| e.at_tip),
        radius_m: estimate.and_then(|e| e.radius).map(|radius| radius.radius_m),
        radius_sd_m: estimate.and_then(|e| e.radius).map(|radius| radius.sd_m),
        friction: estimate.and_then(|e| e.friction).map(|friction| friction.coefficient),
        friction_sd: estimate.and_then(|e| e.friction).map(|friction| friction.sd),
        object_vx_m_s: velocity(0),
        object_vx_sd_m_s: velocity_sd(0),
        object_vy_m_s: velocity(1),
        object_vy_sd_m_s: velocity_sd(1),
        gain: deviates.map(|found| found.gain.value),
        gain_sd: deviates.map(|found| found.gain.sd),
        mount_rad: deviates.map(|found| found.mount_rad.value),
        mount_sd_rad: deviates.map(|found| found.mount_rad.sd),
        mount_x_m: deviates.map(|found| found.mount_x_m.value),
        mount_x_sd_m: deviates.map(|found| found.mount_x_m.sd),
        mount_y_m: deviates.map(|found| found.mount_y_m.value),
        mount_y_sd_m: deviates.map(|found| found.mount_y_m.sd),
        models: estimate.and_then(|e| e.models).map(|models| models.to_string()),
        model_doubtful: estimate.filter(|e| e.models.is_some()).map(|e| e.model_doubtful),
        second_contact: estimate.filter(|e| e.models.is_some()).map(|e| e.second_contact),
        truth_contact_x_m: truth.contact.map(|p| p.x()),
        truth_contact_y_m: truth.contact.map(|p| p.y()),
        truth_surface_x_m: truth.surface.map(|p| p.x()),
        truth_surface_y_m: truth.surface.map(|p| p.y()),
    }
}

impl EstimateRow {
    /// Distance between the estimated and the true contact. `None` if either is unknown.
    pub fn contact_error_m(&self) -> Option<f64> {
        let (dx_m, dy_m) = (self.contact_x_m? - self.truth_contact_x_m?, self.contact_y_m? - self.truth_contact_y_m?);
        Some(dx_m.hypot(dy_m))
    }
}

/// State of a contact detector at one instant.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct EventRow {
    /// Time since the start of the recording.
    pub t_s: f64,
    /// Reading with measurement noise.
    pub reading_n_m: f64,
    /// Filtered reading that the detector compares with the threshold.
    pub watched_n_m: f64,
    /// Threshold of the absolute value of `watched_n_m`.
    pub threshold_n_m: f64,
    /// Whether the detector reports a contact.
    pub touched: bool,
    /// Whether the whisker touches. `None` if unknown.
    pub truth_touching: Option<bool>,
}

/// Information on the contact in the readings of a trace at one instant of contact, for any estimator. See [`crate::bound`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BoundRow {
    /// Time since the start of the trace.
    pub t_s: f64,
    /// Posterior Cramér–Rao bound of the root mean square error.
    pub bound_m: f64,
    /// The same bound from the readings of the last half second alone. `None` if their information matrix is singular.
    pub window_m: Option<f64>,
    /// Condition number of the information matrix of that window.
    pub condition: Option<f64>,
}
