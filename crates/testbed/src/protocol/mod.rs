//! Answers of external programs to an evaluation, and of live streams: JSON lines, specified in `docs/your-estimator.md` and
//! `docs/LIVE.md`. Those in space are in [`space`].
//!
//! The module also defines the parts of the first line that both an evaluation and a live stream use.

pub mod space;

use filters::Innovation;
use nalgebra::{Matrix1, Matrix2, Matrix3, SMatrix, Vector1, Vector2};
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use strict_json::{one_line, shown};
use trace::FARTHEST_M;
use whisker::estimators::{BaseNoise, ContactPrior, Estimate, Knowledge};
use whisker::frames::Point;
use whisker::sensor::Face;

/// Version of the protocol, sent in the first line.
pub const PROTOCOL: u32 = 1;

/// Maximum number of characters of an invalid answer that are quoted.
const QUOTED: usize = 120;

/// Largest difference of two entries of a covariance that are equal but for rounding, relative to the largest variance.
const SYMMETRIC: f64 = 1e-9;

/// Covariance of the error of the measured base pose, in Base.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BaseNoiseLine {
    cov_xx_m2: f64,
    cov_xy_m2: f64,
    cov_yy_m2: f64,
    cov_x_yaw_m_rad: f64,
    cov_y_yaw_m_rad: f64,
    cov_yaw_yaw_rad2: f64,
}

impl BaseNoiseLine {
    /// The message with a covariance.
    pub fn new(BaseNoise(covariance): &BaseNoise) -> Self {
        Self {
            cov_xx_m2: covariance[(0, 0)],
            cov_xy_m2: covariance[(0, 1)],
            cov_yy_m2: covariance[(1, 1)],
            cov_x_yaw_m_rad: covariance[(0, 2)],
            cov_y_yaw_m_rad: covariance[(1, 2)],
            cov_yaw_yaw_rad2: covariance[(2, 2)],
        }
    }

    /// The covariance.
    ///
    /// # Errors
    /// The expected form, if it is no covariance.
    pub fn base_noise(&self) -> Result<BaseNoise, String> {
        let covariance = Matrix3::new(
            self.cov_xx_m2,
            self.cov_xy_m2,
            self.cov_x_yaw_m_rad,
            self.cov_xy_m2,
            self.cov_yy_m2,
            self.cov_y_yaw_m_rad,
            self.cov_x_yaw_m_rad,
            self.cov_y_yaw_m_rad,
            self.cov_yaw_yaw_rad2,
        );
        let is_small = covariance.iter().all(|entry| entry.abs() <= FARTHEST_M * FARTHEST_M);
        let roundoff = 1e-12 * covariance.diagonal().amax();
        if !is_small || covariance.symmetric_eigenvalues().min() < -roundoff {
            return Err("a positive semidefinite covariance in m2 and rad2".into());
        }
        Ok(BaseNoise(covariance))
    }
}

/// Prior position of the first contact, in Base.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ContactPriorLine {
    contact_x_m: f64,
    contact_y_m: f64,
    sd_m: f64,
}

impl ContactPriorLine {
    /// The message with a prior.
    pub fn new(prior: &ContactPrior) -> Self {
        Self { contact_x_m: prior.contact.x(), contact_y_m: prior.contact.y(), sd_m: prior.sd_m }
    }

    /// The prior, unless a number is out of range: then the expected form.
    ///
    /// # Errors
    /// The expected form.
    pub fn contact_prior(&self) -> Result<ContactPrior, String> {
        let Self { contact_x_m, contact_y_m, sd_m } = *self;
        if !(contact_x_m.abs() <= FARTHEST_M && contact_y_m.abs() <= FARTHEST_M && sd_m > 0.0 && sd_m <= FARTHEST_M) {
            return Err(format!("a contact within {FARTHEST_M} m of the base, and a positive sd_m up to that"));
        }
        Ok(ContactPrior { contact: Point::new(contact_x_m, contact_y_m), sd_m })
    }
}

/// Answer to a row; `null`, or a status without a contact, stands for no estimate. Keys beside contact, covariance and
/// innovation are remarks of `whisker live`, which writes the same messages that an evaluation reads.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct AnswerLine {
    /// Name of the whisker, if there are several.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub name: Option<String>,
    /// Time of the reading.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub t_s: Option<f64>,
    /// Fate of the reading.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub status: Option<String>,
    /// Pose of the base at the time of the reading: position, x.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub base_x_m: Option<f64>,
    /// Position, y.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub base_y_m: Option<f64>,
    /// Yaw.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub base_yaw_rad: Option<f64>,
    /// Side of the whisker on which the object lies.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub face: Option<Face>,
    /// Contact on the centre line in Base, x.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub contact_x_m: Option<f64>,
    /// Contact on the centre line in Base, y.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub contact_y_m: Option<f64>,
    /// Variance of the contact along x, in Base.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub cov_xx_m2: Option<f64>,
    /// Covariance of the contact between x and y, in Base.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub cov_xy_m2: Option<f64>,
    /// Variance of the contact along y, in Base.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub cov_yy_m2: Option<f64>,
    /// Innovation: reading minus predicted reading.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub innovation_n_m: Option<f64>,
    /// Variance of the innovation.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub innovation_variance_n2_m2: Option<f64>,
    /// Whether the contact lies in the calibrated domain.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub calibrated: Option<bool>,
    /// Whether the contact may lie at the tip.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub at_tip: Option<bool>,
    /// Radius of the object at the contact.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub radius_m: Option<f64>,
    /// Its standard deviation.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub radius_sd_m: Option<f64>,
    /// Coefficient of friction between whisker and object.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub friction: Option<f64>,
    /// Its standard deviation.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub friction_sd: Option<f64>,
    /// Velocity of the object relative to the world, in Base, x (m/s), if it moves.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub object_vx_m_s: Option<f64>,
    /// Its standard deviation.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub object_vx_sd_m_s: Option<f64>,
    /// Velocity of the object relative to the world, in Base, y (m/s), if it moves.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub object_vy_m_s: Option<f64>,
    /// Its standard deviation.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub object_vy_sd_m_s: Option<f64>,
    /// Relative error of the sensor's gain, if the sensor deviates from its calibration.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub gain: Option<f64>,
    /// Its standard deviation.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub gain_sd: Option<f64>,
    /// Yaw of the calibrated Base in the actual one, if the sensor deviates.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub mount_rad: Option<f64>,
    /// Its standard deviation.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub mount_sd_rad: Option<f64>,
    /// Position of the calibrated Base in the actual one, x, if the sensor deviates.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub mount_x_m: Option<f64>,
    /// Its standard deviation.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub mount_x_sd_m: Option<f64>,
    /// Position of the calibrated Base in the actual one, y, if the sensor deviates.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub mount_y_m: Option<f64>,
    /// Its standard deviation.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub mount_y_sd_m: Option<f64>,
    /// Whether the readings contradict the models of the estimator.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub model_doubtful: Option<bool>,
    /// Whether a second contact has taken load.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub second_contact: Option<bool>,
}

impl AnswerLine {
    /// Answer with an estimate. Without one, all keys are missing.
    pub fn new(estimate: Option<&Estimate>) -> Self {
        let Some(estimate) = estimate else { return Self::default() };
        let covariance = estimate.covariance_m2;
        let velocity = |axis: usize| estimate.velocity.map(|velocity| velocity.velocity_m_s[axis]);
        let velocity_sd = |axis: usize| estimate.velocity.map(|velocity| velocity.sds_m_s()[axis]);
        let deviates = estimate.installation;
        Self {
            face: Some(estimate.face),
            contact_x_m: Some(estimate.contact.x()),
            contact_y_m: Some(estimate.contact.y()),
            cov_xx_m2: covariance.map(|p| p[(0, 0)]),
            cov_xy_m2: covariance.map(|p| p[(0, 1)]),
            cov_yy_m2: covariance.map(|p| p[(1, 1)]),
            innovation_n_m: estimate.innovation.map(|innovation| innovation.residual.x),
            innovation_variance_n2_m2: estimate.innovation.map(|innovation| innovation.covariance.x),
            calibrated: Some(estimate.calibrated),
            at_tip: Some(estimate.at_tip),
            radius_m: estimate.radius.map(|radius| radius.radius_m),
            radius_sd_m: estimate.radius.map(|radius| radius.sd_m),
            friction: estimate.friction.map(|friction| friction.coefficient),
            friction_sd: estimate.friction.map(|friction| friction.sd),
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
            // Methods that average no models never set them.
            model_doubtful: estimate.models.map(|_| estimate.model_doubtful),
            second_contact: estimate.models.map(|_| estimate.second_contact),
            ..Self::default()
        }
    }
}

/// Expected form of an answer.
const EXPECTED: &str = "null or {\"contact_x_m\": number, \"contact_y_m\": number} and optionally \
                        cov_xx_m2, cov_xy_m2 and cov_yy_m2, or innovation_n_m and innovation_variance_n2_m2";

/// Parses a program's answer to a row with a contact on `face`. `None` if the answer is `null`.
///
/// # Errors
/// Found and expected text if the line is not a valid answer.
pub fn estimate(line: &str, face: Face, knowledge: &Knowledge) -> Result<Option<Estimate>, String> {
    answer(line, EXPECTED, |answer: AnswerLine| answer.estimate(face, knowledge))
}

/// Parses a line with an answer, and converts it by `convert`, whose error is the expected form. `None` if the answer is `null`.
///
/// # Errors
/// Found and expected text.
fn answer<Answer: DeserializeOwned, One>(
    line: &str,
    expected: &str,
    convert: impl Fn(Answer) -> Result<Option<One>, String>,
) -> Result<Option<One>, String> {
    let line = line.trim();
    let found = || {
        let quoted: String = line.chars().take(QUOTED).collect();
        let rest = if quoted.len() < line.len() { "..." } else { "" };
        format!("found `{}{rest}`", one_line(&quoted))
    };
    // serde would accept a list as the field values in declaration order.
    if line.starts_with('[') {
        return Err(format!("{}, expected {expected}", found()));
    }
    let answer: Option<Answer> = serde_json::from_str(line)
        .map_err(|error| format!("{}, expected {expected} ({})", found(), shown(&error.to_string())))?;
    let Some(answer) = answer else { return Ok(None) };
    convert(answer).map_err(|expected| format!("{}, expected {expected}", found()))
}

impl AnswerLine {
    /// Estimate with its flags, or the expected form.
    fn estimate(&self, face: Face, knowledge: &Knowledge) -> Result<Option<Estimate>, String> {
        let contact_m = match (self.contact_x_m, self.contact_y_m) {
            (Some(x_m), Some(y_m)) => Vector2::new(x_m, y_m),
            (None, None) if self.status.is_some() => return Ok(None),
            (None, _) => return Err(format!("{EXPECTED} (missing field `contact_x_m`)")),
            (_, None) => return Err(format!("{EXPECTED} (missing field `contact_y_m`)")),
        };
        let covariance_m2 = match (self.cov_xx_m2, self.cov_xy_m2, self.cov_yy_m2) {
            (None, None, None) => None,
            (Some(xx), Some(xy), Some(yy)) => Some(Matrix2::new(xx, xy, xy, yy)),
            _ => return Err("all of cov_xx_m2, cov_xy_m2 and cov_yy_m2, or none".into()),
        };
        let innovation = match (self.innovation_n_m, self.innovation_variance_n2_m2) {
            (None, None) => None,
            (Some(residual), Some(variance)) => Some((residual, variance)),
            _ => return Err("both innovation_n_m and innovation_variance_n2_m2, or none".into()),
        };
        let stated = StatedEstimate { contact_m, covariance_m2, innovation };
        stated.checked(face, knowledge).map(Some).map_err(|bad| bad.to_string())
    }
}

/// An estimate that a program or Python code states, in Base, before its values are checked.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StatedEstimate {
    /// Contact (m), 2x1.
    pub contact_m: Vector2<f64>,
    /// Its covariance (m2), 2x2.
    pub covariance_m2: Option<Matrix2<f64>>,
    /// Reading minus predicted reading (N m), and its variance (N2 m2).
    pub innovation: Option<(f64, f64)>,
}

/// A stated value that cannot be used.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{expected} ({of})")]
pub struct BadValue {
    /// Name of the quantity.
    pub of: &'static str,
    /// Expected value.
    pub expected: String,
}

impl BadValue {
    fn new(of: &'static str, expected: impl Into<String>) -> Self {
        Self { of, expected: expected.into() }
    }
}

impl StatedEstimate {
    /// Estimate of a contact on a face, with its flags.
    ///
    /// # Errors
    /// The first value that cannot be used.
    pub fn checked(&self, face: Face, knowledge: &Knowledge) -> Result<Estimate, BadValue> {
        check_contact(self.contact_m.as_slice())?;
        let covariance_m2 = self.covariance_m2.map(checked_covariance).transpose()?;
        let innovation = self.innovation.map(|(residual, variance)| {
            let nis = residual * residual / variance;
            let is_usable = variance > 0.0 && nis.is_finite();
            let expected = "a positive number to which innovation_n_m has a finite ratio";
            is_usable
                .then(|| Innovation { residual: Vector1::new(residual), covariance: Matrix1::new(variance), nis })
                .ok_or_else(|| BadValue::new("innovation_variance_n2_m2", expected))
        });
        let contact = Point::new(self.contact_m.x, self.contact_m.y);
        let calibrated = knowledge.face(face).is_some_and(|face| face.domain.contains(face.along_and_away(contact)));
        let estimate =
            Estimate { covariance_m2, innovation: innovation.transpose()?, calibrated, ..Estimate::at(contact, face) };
        Ok(Estimate { at_tip: knowledge.may_be_tip(&estimate), ..estimate })
    }
}

/// Checks the coordinates of a contact (m).
fn check_contact(coordinates_m: &[f64]) -> Result<(), BadValue> {
    let is_near =
        coordinates_m.iter().map(|coordinate_m| coordinate_m * coordinate_m).sum::<f64>().sqrt() <= FARTHEST_M;
    is_near
        .then_some(())
        .ok_or_else(|| BadValue::new("contact", format!("a point within {FARTHEST_M} m of the base, in Base")))
}

/// A covariance, symmetric to the last bit.
fn checked_covariance<const N: usize>(stated_m2: SMatrix<f64, N, N>) -> Result<SMatrix<f64, N, N>, BadValue> {
    let is_symmetric = (stated_m2 - stated_m2.transpose()).amax() <= SYMMETRIC * stated_m2.diagonal().amax();
    let symmetric_m2 = 0.5 * (stated_m2 + stated_m2.transpose());
    let is_small = stated_m2.amax() <= FARTHEST_M * FARTHEST_M;
    let is_usable = is_symmetric && is_small && symmetric_m2.cholesky().is_some();
    is_usable.then_some(symmetric_m2).ok_or_else(|| {
        BadValue::new(
            "covariance_m2",
            format!(
                "a positive definite matrix, {N} x {N}, in Base (m2), with entries of at most {:e}",
                FARTHEST_M * FARTHEST_M
            ),
        )
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn verif_a_covariance_may_be_asymmetric_by_rounding_alone() {
        let skewed = |by: f64| checked_covariance(Matrix2::new(1.0, 0.5 + by, 0.5, 1.0));
        assert_eq!(skewed(0.5e-9).unwrap()[(0, 1)], 0.5 + 0.25e-9);
        assert_eq!(skewed(1.5e-9).unwrap_err().of, "covariance_m2");
    }
}
