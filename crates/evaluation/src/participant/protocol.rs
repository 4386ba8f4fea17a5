//! Messages between the testbed and an external program: JSON lines, specified in `docs/your-estimator.md`.

use filters::Innovation;
use nalgebra::{Matrix1, Matrix2, Matrix3, Vector1};
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use strict_json::{one_line, shown};
use trace::FARTHEST_M;
use whisker::estimators::{BaseNoise, ContactPrior, Estimate, Knowledge, Sample};
use whisker::frames::{Base, Point, Pose, Start};
use whisker::sensor::{AlongAway, CalibratedFace, Domain, Face};
use whisker::{RestShape, Whisker};

/// Version of the protocol, sent in the first line.
pub const PROTOCOL: u32 = 1;

/// Number of nodes of the sensor model's table along the whisker and away from it.
const NODES: [usize; 2] = [61, 31];

/// Number of points of the undeflected whisker, including both ends.
const REST_POINTS: usize = 101;

/// Mask for seeds: the largest integer that is exactly representable as a double-precision number.
pub(super) const SEED_MASK: u64 = (1 << 53) - 1;

/// Maximum number of characters of an invalid answer that are quoted.
const QUOTED: usize = 120;

/// First line: prior information available to the estimator.
#[derive(Serialize)]
pub(super) struct Prior<'a> {
    protocol: u32,
    seed: u64,
    rate_hz: f64,
    noise_sd_n_m: f64,
    base_noise: BaseNoiseLine,
    whisker: &'a Whisker,
    rest: RestLine,
    faces: Vec<FaceTable<'a>>,
    /// The key is part of the protocol.
    #[serde(rename = "told")]
    contact_prior: Option<ContactPriorLine>,
}

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

/// Undeflected whisker from root to tip, in Base.
#[derive(Default, Serialize)]
pub(super) struct RestLine {
    arc_m: Vec<f64>,
    x_m: Vec<f64>,
    y_m: Vec<f64>,
    tangent_rad: Vec<f64>,
}

/// Calibration of one face.
#[derive(Serialize)]
struct FaceTable<'a> {
    face: Face,
    largest_reading_n_m: f64,
    domain: &'a Domain,
    shape: [usize; 2],
    table: SensorTable,
}

/// Sensor model on a grid over the calibrated domain; the nodes of one arc length are contiguous.
#[derive(Default, Serialize)]
struct SensorTable {
    arc_m: Vec<f64>,
    away_m: Vec<f64>,
    x_m: Vec<f64>,
    y_m: Vec<f64>,
    reading_n_m: Vec<f64>,
    gradient_x_n: Vec<f64>,
    gradient_y_n: Vec<f64>,
    tangent_rad: Vec<f64>,
    model_sd_n_m: Vec<f64>,
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

impl<'a> Prior<'a> {
    pub(super) fn new(knowledge: &'a Knowledge, seed: u64) -> Self {
        let contact_prior = knowledge.contact_prior.map(|prior| ContactPriorLine {
            contact_x_m: prior.contact.x(),
            contact_y_m: prior.contact.y(),
            sd_m: prior.sd_m,
        });
        Self {
            protocol: PROTOCOL,
            seed: seed & SEED_MASK,
            rate_hz: knowledge.rate_hz,
            noise_sd_n_m: knowledge.noise_sd_n_m,
            base_noise: BaseNoiseLine::new(&knowledge.base_noise),
            whisker: &knowledge.whisker,
            rest: RestLine::new(&knowledge.rest),
            faces: knowledge.faces.iter().map(|face| FaceTable::new(knowledge, face)).collect(),
            contact_prior,
        }
    }
}

impl BaseNoiseLine {
    fn new(BaseNoise(covariance): &BaseNoise) -> Self {
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

impl RestLine {
    pub(super) fn new(rest: &RestShape) -> Self {
        let mut line = Self::default();
        for arc_m in evenly(0.0, rest.length_m(), REST_POINTS) {
            let point = rest.point(arc_m);
            line.arc_m.push(arc_m);
            line.x_m.push(point.x());
            line.y_m.push(point.y());
            line.tangent_rad.push(rest.tangent_rad(arc_m));
        }
        line
    }
}

impl<'a> FaceTable<'a> {
    fn new(knowledge: &Knowledge, face: &'a CalibratedFace) -> Self {
        let mut table = SensorTable::default();
        let (low_m, high_m) = face.domain.arc_range_m();
        for arc_m in evenly(low_m, high_m, NODES[0]) {
            let (lower_m, upper_m) = face.domain.away_range_m(arc_m);
            for away_m in evenly(lower_m, upper_m, NODES[1]) {
                let contact = face.contact_at(AlongAway::new(arc_m, away_m));
                let expected = face.model.predict(contact);
                let here = Estimate::at(contact, face.face);
                table.arc_m.push(arc_m);
                table.away_m.push(away_m);
                table.x_m.push(contact.x());
                table.y_m.push(contact.y());
                table.reading_n_m.push(expected.reading_n_m);
                table.gradient_x_n.push(expected.gradient_n.x);
                table.gradient_y_n.push(expected.gradient_n.y);
                table.tangent_rad.push(knowledge.tangent_rad(&here, expected.reading_n_m));
                table.model_sd_n_m.push(face.model_variance_n2_m2(contact).sqrt());
            }
        }
        let largest_reading_n_m = face.largest_reading_n_m;
        Self { face: face.face, largest_reading_n_m, domain: &face.domain, shape: NODES, table }
    }
}

/// Equally spaced values from `from` to `to`, including both.
pub(super) fn evenly(from: f64, to: f64, count: usize) -> impl Iterator<Item = f64> {
    (0..count).map(move |i| from + (to - from) * i as f64 / (count - 1) as f64)
}

/// Any later line: the sample at one instant.
#[derive(Serialize)]
pub(super) struct Row {
    t_s: f64,
    dt_s: f64,
    base_x_m: f64,
    base_y_m: f64,
    base_yaw_rad: f64,
    last_x_m: f64,
    last_y_m: f64,
    last_yaw_rad: f64,
    reading_n_m: f64,
    touched: Option<Face>,
}

impl Row {
    /// `base` is the current pose of the base, `touched` the face in contact according to the common detector.
    pub(super) fn new(t_s: f64, base: &Pose<Base, Start>, sample: &Sample, touched: Option<Face>) -> Self {
        Self {
            t_s,
            dt_s: sample.dt_s,
            base_x_m: base.origin().x(),
            base_y_m: base.origin().y(),
            base_yaw_rad: base.yaw_rad(),
            last_x_m: sample.motion.origin().x(),
            last_y_m: sample.motion.origin().y(),
            last_yaw_rad: sample.motion.yaw_rad(),
            reading_n_m: sample.reading_n_m,
            touched,
        }
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
            model_doubtful: Some(estimate.model_doubtful),
            second_contact: Some(estimate.second_contact),
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
pub(super) fn answer<Answer: DeserializeOwned, One>(
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
        let (x_m, y_m) = match (self.contact_x_m, self.contact_y_m) {
            (Some(x_m), Some(y_m)) => (x_m, y_m),
            (None, None) if self.status.is_some() => return Ok(None),
            (None, _) => return Err(format!("{EXPECTED} (missing field `contact_x_m`)")),
            (_, None) => return Err(format!("{EXPECTED} (missing field `contact_y_m`)")),
        };
        if !(x_m.abs() <= FARTHEST_M && y_m.abs() <= FARTHEST_M) {
            return Err(format!("a contact within {FARTHEST_M} m of the base, in the base's frame"));
        }
        let contact = Point::new(x_m, y_m);
        let calibrated = knowledge.face(face).is_some_and(|face| face.domain.contains(face.along_and_away(contact)));
        let estimate = Estimate {
            covariance_m2: self.covariance_m2()?,
            innovation: self.innovation()?,
            calibrated,
            ..Estimate::at(contact, face)
        };
        Ok(Some(Estimate { at_tip: knowledge.may_be_tip(&estimate), ..estimate }))
    }

    fn covariance_m2(&self) -> Result<Option<Matrix2<f64>>, String> {
        let covariance = match (self.cov_xx_m2, self.cov_xy_m2, self.cov_yy_m2) {
            (None, None, None) => return Ok(None),
            (Some(xx), Some(xy), Some(yy)) => Matrix2::new(xx, xy, xy, yy),
            _ => return Err("all of cov_xx_m2, cov_xy_m2 and cov_yy_m2, or none".into()),
        };
        let is_small = covariance.iter().all(|entry| entry.abs() <= FARTHEST_M * FARTHEST_M);
        if !is_small || covariance.cholesky().is_none() {
            return Err("a positive definite covariance in m2, in the base's frame".into());
        }
        Ok(Some(covariance))
    }

    fn innovation(&self) -> Result<Option<Innovation<1>>, String> {
        let (residual, variance) = match (self.innovation_n_m, self.innovation_variance_n2_m2) {
            (None, None) => return Ok(None),
            (Some(residual), Some(variance)) => (residual, variance),
            _ => return Err("both innovation_n_m and innovation_variance_n2_m2, or none".into()),
        };
        let nis = residual * residual / variance;
        if !(variance > 0.0 && nis.is_finite()) {
            return Err("a positive innovation_variance_n2_m2 to which innovation_n_m has a finite ratio".into());
        }
        Ok(Some(Innovation { residual: Vector1::new(residual), covariance: Matrix1::new(variance), nis }))
    }
}
