//! Estimates in space as a table.

use nalgebra::{Matrix3, Quaternion, UnitQuaternion, Vector2, Vector3};
use serde::{Deserialize, Serialize};
use trace::{SpatialInstant, SpatialTruthInstant};
use whisker::space::estimators::Estimate;
use whisker::space::sensor::CalibratedSpace;

use super::to_world;

/// One instant of a replay in space. Positions and directions are in World, moments in Base.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SpatialEstimateRow {
    /// Time since the start of the trace.
    pub t_s: f64,
    /// Position of the base, x.
    pub base_x_m: f64,
    /// Position of the base, y.
    pub base_y_m: f64,
    /// Position of the base, z.
    pub base_z_m: f64,
    /// Rotation from Base to World as a unit quaternion, scalar part.
    pub base_qw: f64,
    /// Its part along x.
    pub base_qx: f64,
    /// Its part along y.
    pub base_qy: f64,
    /// Its part along z.
    pub base_qz: f64,
    /// Bending moment about y of Base with measurement noise, as given to the estimator.
    pub moment_y_n_m: f64,
    /// The same about z of Base.
    pub moment_z_n_m: f64,
    /// Estimated contact, x.
    pub contact_x_m: Option<f64>,
    /// Estimated contact, y.
    pub contact_y_m: Option<f64>,
    /// Estimated contact, z.
    pub contact_z_m: Option<f64>,
    /// Estimated point of the object's surface, x.
    pub surface_x_m: Option<f64>,
    /// Estimated point of the object's surface, y.
    pub surface_y_m: Option<f64>,
    /// Estimated point of the object's surface, z.
    pub surface_z_m: Option<f64>,
    /// Posterior variance of the contact along x.
    pub cov_xx_m2: Option<f64>,
    /// Posterior covariance of the contact between x and y.
    pub cov_xy_m2: Option<f64>,
    /// Posterior covariance of the contact between x and z.
    pub cov_xz_m2: Option<f64>,
    /// Posterior variance of the contact along y.
    pub cov_yy_m2: Option<f64>,
    /// Posterior covariance of the contact between y and z.
    pub cov_yz_m2: Option<f64>,
    /// Posterior variance of the contact along z.
    pub cov_zz_m2: Option<f64>,
    /// Estimated normal out of the object, x.
    pub normal_x: Option<f64>,
    /// Estimated normal, y.
    pub normal_y: Option<f64>,
    /// Estimated normal, z.
    pub normal_z: Option<f64>,
    /// Standard deviation of the estimated normal: root mean square of those about two axes across it. `None`
    /// if the estimator does not state it.
    pub normal_sd_rad: Option<f64>,
    /// Estimated direction of the edge or rod, x.
    pub direction_x: Option<f64>,
    /// Estimated direction, y.
    pub direction_y: Option<f64>,
    /// Estimated direction, z.
    pub direction_z: Option<f64>,
    /// Standard deviation of the angle of the direction in the tangent plane of the contact.
    pub direction_sd_rad: Option<f64>,
    /// Whether the estimated contact lies in the calibrated domain of the sensor model.
    pub calibrated: Option<bool>,
    /// Whether the readings contradict the models of the estimator.
    pub model_doubtful: Option<bool>,
    /// True contact, x.
    pub truth_contact_x_m: Option<f64>,
    /// True contact, y.
    pub truth_contact_y_m: Option<f64>,
    /// True contact, z.
    pub truth_contact_z_m: Option<f64>,
    /// True point of the solid's surface, x.
    pub truth_surface_x_m: Option<f64>,
    /// True point of the solid's surface, y.
    pub truth_surface_y_m: Option<f64>,
    /// True point of the solid's surface, z.
    pub truth_surface_z_m: Option<f64>,
}

impl SpatialEstimateRow {
    /// Position of the base, 3x1.
    pub fn base_m(&self) -> Vector3<f64> {
        Vector3::new(self.base_x_m, self.base_y_m, self.base_z_m)
    }

    /// Estimated contact, 3x1.
    pub fn contact_m(&self) -> Option<Vector3<f64>> {
        Some(Vector3::new(self.contact_x_m?, self.contact_y_m?, self.contact_z_m?))
    }

    /// Magnitude of the bending moment as given to the estimator.
    pub fn reading_n_m(&self) -> f64 {
        self.moment_y_n_m.hypot(self.moment_z_n_m)
    }

    /// Rotation from Base to World.
    pub fn rotation(&self) -> UnitQuaternion<f64> {
        UnitQuaternion::from_quaternion(Quaternion::new(self.base_qw, self.base_qx, self.base_qy, self.base_qz))
    }

    /// Estimated point of the object's surface, 3x1.
    pub fn surface_m(&self) -> Option<Vector3<f64>> {
        Some(Vector3::new(self.surface_x_m?, self.surface_y_m?, self.surface_z_m?))
    }

    /// Estimated unit normal out of the object, 3x1.
    pub fn normal(&self) -> Option<Vector3<f64>> {
        Some(Vector3::new(self.normal_x?, self.normal_y?, self.normal_z?))
    }

    /// Posterior covariance of the contact (m2), 3x3.
    pub fn covariance_m2(&self) -> Option<Matrix3<f64>> {
        let (xx, xy, xz) = (self.cov_xx_m2?, self.cov_xy_m2?, self.cov_xz_m2?);
        let (yy, yz, zz) = (self.cov_yy_m2?, self.cov_yz_m2?, self.cov_zz_m2?);
        Some(Matrix3::new(xx, xy, xz, xy, yy, yz, xz, yz, zz))
    }

    /// True contact, 3x1.
    pub fn truth_contact_m(&self) -> Option<Vector3<f64>> {
        Some(Vector3::new(self.truth_contact_x_m?, self.truth_contact_y_m?, self.truth_contact_z_m?))
    }

    /// Distance between the estimated and the true contact. `None` if either is unknown.
    pub fn contact_error_m(&self) -> Option<f64> {
        Some((self.contact_m()? - self.truth_contact_m()?).norm())
    }
}

/// Row of one instant of a trace with its truth, the readings given to the estimator (N m, 2x1) and its answer.
pub fn spatial_estimate_row(
    now: &SpatialInstant,
    truth: &SpatialTruthInstant,
    calibrated: &CalibratedSpace,
    reading_n_m: Vector2<f64>,
    estimate: Option<&Estimate>,
) -> SpatialEstimateRow {
    let base = to_world(&now.base);
    let contact = estimate.map(|estimate| base.apply(estimate.contact).vector());
    let surface = estimate.map(|estimate| calibrated.surface(estimate.contact, estimate.normal));
    let surface = surface.map(|surface| base.apply(surface).vector());
    let covariance = estimate.map(|estimate| base.turn(estimate.covariance_m2));
    let normal = estimate.map(|estimate| base.turn_vector(estimate.normal));
    let direction = estimate.and_then(|estimate| estimate.direction);
    let along = direction.map(|direction| base.turn_vector(direction.along));
    let (place, truth) = (truth.contact_m(), truth.contact);
    let quaternion = now.base.rotation.quaternion();
    SpatialEstimateRow {
        t_s: now.t_s,
        base_x_m: now.base.position.x,
        base_y_m: now.base.position.y,
        base_z_m: now.base.position.z,
        base_qw: quaternion.w,
        base_qx: quaternion.i,
        base_qy: quaternion.j,
        base_qz: quaternion.k,
        moment_y_n_m: reading_n_m.x,
        moment_z_n_m: reading_n_m.y,
        contact_x_m: contact.map(|at| at.x),
        contact_y_m: contact.map(|at| at.y),
        contact_z_m: contact.map(|at| at.z),
        surface_x_m: surface.map(|at| at.x),
        surface_y_m: surface.map(|at| at.y),
        surface_z_m: surface.map(|at| at.z),
        cov_xx_m2: covariance.map(|of| of.m11),
        cov_xy_m2: covariance.map(|of| of.m12),
        cov_xz_m2: covariance.map(|of| of.m13),
        cov_yy_m2: covariance.map(|of| of.m22),
        cov_yz_m2: covariance.map(|of| of.m23),
        cov_zz_m2: covariance.map(|of| of.m33),
        normal_x: normal.map(|of| of.x),
        normal_y: normal.map(|of| of.y),
        normal_z: normal.map(|of| of.z),
        normal_sd_rad: estimate
            .map(|estimate| (0.5 * estimate.normal_covariance.trace()).sqrt())
            .filter(|sd| *sd > 0.0),
        direction_x: along.map(|of| of.x),
        direction_y: along.map(|of| of.y),
        direction_z: along.map(|of| of.z),
        direction_sd_rad: direction.map(|of| of.sd_rad),
        calibrated: estimate.map(|estimate| estimate.calibrated),
        model_doubtful: estimate.and_then(|estimate| estimate.model_doubtful),
        truth_contact_x_m: place.map(|at| at.x),
        truth_contact_y_m: place.map(|at| at.y),
        truth_contact_z_m: place.map(|at| at.z),
        truth_surface_x_m: truth.map(|of| of.surface.x),
        truth_surface_y_m: truth.map(|of| of.surface.y),
        truth_surface_z_m: truth.map(|of| of.surface.z),
    }
}
