//! Answers in space: version 2 of the protocol.

use nalgebra::{Matrix3, Vector3};
use serde::{Deserialize, Serialize};
use whisker::space::estimators::{Direction, Estimate, Knowledge, Radius};
use whisker::space::frames::Point;

use super::{BadValue, answer, check_contact, checked_covariance};

/// Version of the protocol for trials in space, sent in the first line.
pub const SPATIAL_PROTOCOL: u32 = 2;

/// Largest relative difference of a stated unit vector's length from 1.
const UNIT: f64 = 1e-3;

/// Answer to a row in space, or to both readings of an instant of a live stream. A program must state a contact with its
/// covariance; `null` stands for no estimate.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct SpatialAnswerLine {
    /// Name of the whisker, in the answers of a live stream with several whiskers.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub name: Option<String>,
    /// Time of the reading, in the answers of a live stream.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub t_s: Option<f64>,
    /// Fate of the reading, in the answers of a live stream.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub status: Option<String>,
    /// Position of the base at the time of the reading, x, in the answers of a live stream.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub base_x_m: Option<f64>,
    /// The same, y.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub base_y_m: Option<f64>,
    /// The same, z.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub base_z_m: Option<f64>,
    /// Rotation from Base to its frame at rest as a unit quaternion, scalar part.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub base_qw: Option<f64>,
    /// Its part along x.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub base_qx: Option<f64>,
    /// Its part along y.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub base_qy: Option<f64>,
    /// Its part along z.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub base_qz: Option<f64>,
    /// Contact on the centre line in Base, x.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub contact_x_m: Option<f64>,
    /// The same, y.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub contact_y_m: Option<f64>,
    /// The same, z.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub contact_z_m: Option<f64>,
    /// Posterior variance of the contact along x.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub cov_xx_m2: Option<f64>,
    /// Its covariance between x and y.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub cov_xy_m2: Option<f64>,
    /// Its covariance between x and z.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub cov_xz_m2: Option<f64>,
    /// Its variance along y.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub cov_yy_m2: Option<f64>,
    /// Its covariance between y and z.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub cov_yz_m2: Option<f64>,
    /// Its variance along z.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub cov_zz_m2: Option<f64>,
    /// Unit normal of the touched surface in Base, out of the object, x.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub normal_x: Option<f64>,
    /// The same, y.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub normal_y: Option<f64>,
    /// The same, z.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub normal_z: Option<f64>,
    /// Unit vector along a rod or an edge in Base, x.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub direction_x: Option<f64>,
    /// The same, y.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub direction_y: Option<f64>,
    /// The same, z.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub direction_z: Option<f64>,
    /// Standard deviation of its angle.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub direction_sd_rad: Option<f64>,
    /// Radius of a sphere, or of a rod across its axis.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub radius_m: Option<f64>,
    /// Its standard deviation.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub radius_sd_m: Option<f64>,
    /// Whether the contact lies in the calibrated domain.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub calibrated: Option<bool>,
    /// Whether the readings contradict the models of the estimator.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub model_doubtful: Option<bool>,
}

/// Expected form of an answer.
const EXPECTED: &str = "null or contact_x_m, contact_y_m, contact_z_m, cov_xx_m2, cov_xy_m2, cov_xz_m2, cov_yy_m2, cov_yz_m2 and \
                        cov_zz_m2, and optionally normal_x, normal_y and normal_z; direction_x, direction_y, direction_z and \
                        direction_sd_rad; or radius_m and radius_sd_m";

/// Parses a program's answer to a row in space. `None` if the answer is `null`.
///
/// # Errors
/// Found and expected text if the line is not a valid answer.
pub fn spatial_estimate(line: &str, knowledge: &Knowledge) -> Result<Option<Estimate>, String> {
    answer(line, EXPECTED, |answer: SpatialAnswerLine| answer.estimate(knowledge))
}

impl SpatialAnswerLine {
    /// Answer with an estimate. Without one, all keys are missing.
    pub fn new(estimate: Option<&Estimate>) -> Self {
        let Some(estimate) = estimate else { return Self::default() };
        let (contact_m, covariance, normal) = (estimate.contact.vector(), estimate.covariance_m2, estimate.normal);
        let along = estimate.direction.map(|direction| direction.along);
        Self {
            contact_x_m: Some(contact_m.x),
            contact_y_m: Some(contact_m.y),
            contact_z_m: Some(contact_m.z),
            cov_xx_m2: Some(covariance.m11),
            cov_xy_m2: Some(covariance.m12),
            cov_xz_m2: Some(covariance.m13),
            cov_yy_m2: Some(covariance.m22),
            cov_yz_m2: Some(covariance.m23),
            cov_zz_m2: Some(covariance.m33),
            normal_x: Some(normal.x),
            normal_y: Some(normal.y),
            normal_z: Some(normal.z),
            direction_x: along.map(|along| along.x),
            direction_y: along.map(|along| along.y),
            direction_z: along.map(|along| along.z),
            direction_sd_rad: estimate.direction.map(|direction| direction.sd_rad),
            radius_m: estimate.radius.map(|radius| radius.radius_m),
            radius_sd_m: estimate.radius.map(|radius| radius.sd_m),
            calibrated: Some(estimate.calibrated),
            model_doubtful: estimate.model_doubtful,
            ..Self::default()
        }
    }

    /// Estimate, or the expected form.
    fn estimate(&self, knowledge: &Knowledge) -> Result<Option<Estimate>, String> {
        let required = [
            ("contact_x_m", self.contact_x_m),
            ("contact_y_m", self.contact_y_m),
            ("contact_z_m", self.contact_z_m),
            ("cov_xx_m2", self.cov_xx_m2),
            ("cov_xy_m2", self.cov_xy_m2),
            ("cov_xz_m2", self.cov_xz_m2),
            ("cov_yy_m2", self.cov_yy_m2),
            ("cov_yz_m2", self.cov_yz_m2),
            ("cov_zz_m2", self.cov_zz_m2),
        ];
        // A live stream answers every reading, those without an estimate too.
        if self.status.is_some() && required.iter().all(|(_, value)| value.is_none()) {
            return Ok(None);
        }
        let mut values = [0.0; 9];
        for (value, (name, stated)) in values.iter_mut().zip(required) {
            *value = stated.ok_or_else(|| format!("{EXPECTED} (missing field `{name}`)"))?;
        }
        let [x_m, y_m, z_m, xx, xy, xz, yy, yz, zz] = values;
        let direction_keys = "direction_x, direction_y, direction_z and direction_sd_rad";
        let along = vector("direction", [self.direction_x, self.direction_y, self.direction_z])?;
        let stated = StatedSpatialEstimate {
            contact_m: Vector3::new(x_m, y_m, z_m),
            covariance_m2: Matrix3::new(xx, xy, xz, xy, yy, yz, xz, yz, zz),
            normal: vector("normal", [self.normal_x, self.normal_y, self.normal_z])?,
            direction: both(along, self.direction_sd_rad, direction_keys)?,
            radius: both(self.radius_m, self.radius_sd_m, "radius_m and radius_sd_m")?,
            model_doubtful: self.model_doubtful,
        };
        stated.checked(knowledge).map(Some).map_err(|bad| bad.to_string())
    }
}

/// Both of two values, or neither; otherwise the expected form.
fn both<One, Other>(one: Option<One>, other: Option<Other>, keys: &str) -> Result<Option<(One, Other)>, String> {
    match (one, other) {
        (None, None) => Ok(None),
        (Some(one), Some(other)) => Ok(Some((one, other))),
        _ => Err(format!("all of {keys}, or none")),
    }
}

/// A vector, if it is stated; otherwise the expected form.
fn vector(name: &str, entries: [Option<f64>; 3]) -> Result<Option<Vector3<f64>>, String> {
    match entries {
        [None, None, None] => Ok(None),
        [Some(x), Some(y), Some(z)] => Ok(Some(Vector3::new(x, y, z))),
        _ => Err(format!("all of {name}_x, {name}_y and {name}_z, or none")),
    }
}

/// An estimate in space that a program or Python code states, in Base, before its values are checked.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StatedSpatialEstimate {
    /// Contact (m), 3x1.
    pub contact_m: Vector3<f64>,
    /// Its covariance (m2), 3x3.
    pub covariance_m2: Matrix3<f64>,
    /// Unit normal of the surface out of the object. `None`: that of a contact without friction at this place.
    pub normal: Option<Vector3<f64>>,
    /// Unit vector along a rod or an edge, and the standard deviation of its angle (rad).
    pub direction: Option<(Vector3<f64>, f64)>,
    /// Radius of a sphere, or of a rod across its axis, and its standard deviation (m).
    pub radius: Option<(f64, f64)>,
    /// Whether the readings contradict the models of the estimator.
    pub model_doubtful: Option<bool>,
}

impl StatedSpatialEstimate {
    /// The estimate.
    ///
    /// # Errors
    /// The first value that cannot be used.
    pub fn checked(&self, knowledge: &Knowledge) -> Result<Estimate, BadValue> {
        check_contact(self.contact_m.as_slice())?;
        let covariance_m2 = checked_covariance(self.covariance_m2)?;
        let stated_normal = self.normal.map(|normal| unit("normal", normal)).transpose()?;
        let direction = self.direction.map(|(along, sd_rad)| -> Result<_, BadValue> {
            let along = unit("direction", along)?;
            check_positive("direction_sd_rad", sd_rad)?;
            Ok(Direction { along, sd_rad })
        });
        let radius = self.radius.map(|(radius_m, sd_m)| -> Result<_, BadValue> {
            if radius_m < 0.0 {
                return Err(BadValue::new("radius_m", "a number of 0 or more"));
            }
            check_positive("radius_sd_m", sd_m)?;
            Ok(Radius { radius_m, sd_m })
        });
        let (calibrated, contact) = (&*knowledge.calibrated, Point::from_vector(self.contact_m));
        let at = calibrated.around(contact);
        Ok(Estimate {
            contact,
            covariance_m2,
            normal: stated_normal.unwrap_or_else(|| calibrated.normal(at)),
            normal_covariance: Matrix3::zeros(),
            direction: direction.transpose()?,
            radius: radius.transpose()?,
            calibrated: calibrated.domain.contains(at),
            innovation: None,
            models: None,
            model_doubtful: self.model_doubtful,
        })
    }
}

fn check_positive(of: &'static str, value: f64) -> Result<(), BadValue> {
    (value > 0.0).then_some(()).ok_or_else(|| BadValue::new(of, "a positive number"))
}

/// A unit vector, normalised.
fn unit(of: &'static str, stated: Vector3<f64>) -> Result<Vector3<f64>, BadValue> {
    let is_unit = (stated.norm() - 1.0).abs() <= UNIT;
    is_unit.then(|| stated.normalize()).ok_or_else(|| BadValue::new(of, "a unit vector in Base"))
}
