//! External programs on trials in space: version 2 of the protocol, specified in `docs/your-estimator.md`.

use std::f64::consts::TAU;
use std::sync::Arc;

use nalgebra::{Matrix3, Rotation3, UnitQuaternion, Vector3};
use serde::{Deserialize, Serialize};
use testbed::space::replay::SpatialReplay;
use trace::{FARTHEST_M, StatedSuspension};
use whisker::Whisker;
use whisker::events::TouchConfig;
use whisker::frames::{Base, Start};
use whisker::space::estimators::{Direction, Estimate, Knowledge, Radius, Sample, TouchDetector};
use whisker::space::frames::{Point, Pose};
use whisker::space::sensor::{Around, CalibratedSpace, SpatialDomain};

use super::program::{Conversation, Program};
use super::protocol::{RestLine, SEED_MASK, answer, evenly};

/// Version of the protocol for trials in space, sent in the first line.
pub const SPATIAL_PROTOCOL: u32 = 2;

/// Number of nodes of the sensor model's table along the whisker, about it, and away from it.
const NODES: [usize; 3] = [25, 16, 7];

/// Largest relative difference of a stated unit vector's length from 1.
const UNIT: f64 = 1e-3;

/// One trial in space from the view of a program.
#[derive(Clone, Copy, Debug)]
pub struct SpatialTask<'a> {
    /// Prior information available to the estimator.
    pub knowledge: &'a Arc<Knowledge>,
    /// Samples in order of time.
    pub samples: &'a [Sample],
    /// Name of the trace. A program's random seed is derived from it and the trial's seed.
    pub trace: &'a str,
    /// Seed of the trial.
    pub seed: u64,
}

/// First line: prior information available to the estimator.
#[derive(Serialize)]
struct Prior<'a> {
    protocol: u32,
    seed: u64,
    rate_hz: f64,
    noise_sd_n_m: f64,
    whisker: &'a Whisker,
    suspension: StatedSuspension,
    poisson_ratio: f64,
    rest: RestLine,
    largest_reading_n_m: f64,
    domain: &'a SpatialDomain,
    shape: [usize; 3],
    table: SensorTable,
}

/// Sensor model on a grid over the calibrated domain; the nodes of one arc length are contiguous, and among them those of one
/// direction.
#[derive(Default, Serialize)]
struct SensorTable {
    arc_m: Vec<f64>,
    left_m: Vec<f64>,
    up_m: Vec<f64>,
    x_m: Vec<f64>,
    y_m: Vec<f64>,
    z_m: Vec<f64>,
    moment_y_n_m: Vec<f64>,
    moment_z_n_m: Vec<f64>,
    moment_y_by_x_n: Vec<f64>,
    moment_y_by_y_n: Vec<f64>,
    moment_y_by_z_n: Vec<f64>,
    moment_z_by_x_n: Vec<f64>,
    moment_z_by_y_n: Vec<f64>,
    moment_z_by_z_n: Vec<f64>,
    normal_x: Vec<f64>,
    normal_y: Vec<f64>,
    normal_z: Vec<f64>,
    model_cov_yy_n2_m2: Vec<f64>,
    model_cov_yz_n2_m2: Vec<f64>,
    model_cov_zz_n2_m2: Vec<f64>,
}

impl<'a> Prior<'a> {
    fn new(knowledge: &'a Knowledge, seed: u64) -> Self {
        let calibrated = &*knowledge.calibrated;
        Self {
            protocol: SPATIAL_PROTOCOL,
            seed: seed & SEED_MASK,
            rate_hz: knowledge.rate_hz,
            noise_sd_n_m: knowledge.noise_sd_n_m,
            whisker: &calibrated.whisker.whisker,
            suspension: calibrated.whisker.suspension.into(),
            poisson_ratio: calibrated.whisker.poisson_ratio,
            rest: RestLine::new(calibrated.axis.rest()),
            largest_reading_n_m: calibrated.largest_reading_n_m,
            domain: &calibrated.domain,
            shape: NODES,
            table: SensorTable::new(calibrated),
        }
    }
}

impl SensorTable {
    fn new(calibrated: &CalibratedSpace) -> Self {
        let mut table = Self::default();
        let (low_m, high_m) = calibrated.domain.arc_range_m();
        for arc_m in evenly(low_m, high_m, NODES[0]) {
            for turn in 0..NODES[1] {
                let (up, left) = (TAU * turn as f64 / NODES[1] as f64).sin_cos();
                let most_m = calibrated.domain.most_away_m(Around::new(arc_m, left, up));
                for away_m in evenly(0.0, most_m, NODES[2]) {
                    table.push(calibrated, Around::new(arc_m, away_m * left, away_m * up));
                }
            }
        }
        table
    }

    fn push(&mut self, calibrated: &CalibratedSpace, at: Around) {
        let contact = calibrated.pose().inverse().apply(at.contact(&calibrated.axis));
        let expected = calibrated.extrapolate(contact);
        let error = calibrated.model_covariance_n2_m2(at);
        self.arc_m.push(at.along_m);
        self.left_m.push(at.left_m);
        self.up_m.push(at.up_m);
        let places = [&mut self.x_m, &mut self.y_m, &mut self.z_m];
        extend(places, contact.vector().iter());
        extend([&mut self.moment_y_n_m, &mut self.moment_z_n_m], expected.reading_n_m.iter());
        let of_y = [&mut self.moment_y_by_x_n, &mut self.moment_y_by_y_n, &mut self.moment_y_by_z_n];
        extend(of_y, expected.gradient_n.row(0).iter());
        let of_z = [&mut self.moment_z_by_x_n, &mut self.moment_z_by_y_n, &mut self.moment_z_by_z_n];
        extend(of_z, expected.gradient_n.row(1).iter());
        extend([&mut self.normal_x, &mut self.normal_y, &mut self.normal_z], calibrated.normal(at).iter());
        self.model_cov_yy_n2_m2.push(error.m11);
        self.model_cov_yz_n2_m2.push(error.m12);
        self.model_cov_zz_n2_m2.push(error.m22);
    }
}

/// Appends one value to each column.
fn extend<'a, const COUNT: usize>(columns: [&mut Vec<f64>; COUNT], values: impl Iterator<Item = &'a f64>) {
    columns.into_iter().zip(values).for_each(|(column, value)| column.push(*value));
}

/// Any later line: the sample at one instant.
#[derive(Serialize)]
struct Row {
    t_s: f64,
    dt_s: f64,
    base_x_m: f64,
    base_y_m: f64,
    base_z_m: f64,
    base_qw: f64,
    base_qx: f64,
    base_qy: f64,
    base_qz: f64,
    last_x_m: f64,
    last_y_m: f64,
    last_z_m: f64,
    last_qw: f64,
    last_qx: f64,
    last_qy: f64,
    last_qz: f64,
    moment_y_n_m: f64,
    moment_z_n_m: f64,
    touched: bool,
}

impl Row {
    /// `base` is the current pose of the base, `touched` the answer of the common contact detector.
    fn new(t_s: f64, base: &Pose<Base, Start>, sample: &Sample, touched: bool) -> Self {
        let (base_m, base_turn) = (base.origin().vector(), quaternion(base));
        let (last_m, last_turn) = (sample.motion.origin().vector(), quaternion(&sample.motion));
        Self {
            t_s,
            dt_s: sample.dt_s,
            base_x_m: base_m.x,
            base_y_m: base_m.y,
            base_z_m: base_m.z,
            base_qw: base_turn.w,
            base_qx: base_turn.i,
            base_qy: base_turn.j,
            base_qz: base_turn.k,
            last_x_m: last_m.x,
            last_y_m: last_m.y,
            last_z_m: last_m.z,
            last_qw: last_turn.w,
            last_qx: last_turn.i,
            last_qy: last_turn.j,
            last_qz: last_turn.k,
            moment_y_n_m: sample.reading_n_m.x,
            moment_z_n_m: sample.reading_n_m.y,
            touched,
        }
    }
}

/// Rotation of a pose as a unit quaternion with a scalar part of at least 0.
fn quaternion<From, To>(pose: &Pose<From, To>) -> UnitQuaternion<f64> {
    let turn = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(pose.rotation()));
    if turn.w < 0.0 { UnitQuaternion::new_unchecked(-turn.into_inner()) } else { turn }
}

/// Answer to a row in space, or to both readings of an instant of a live stream. A program must state a contact with its covariance;
/// `null` stands for no estimate.
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
        let contact_m = Vector3::new(x_m, y_m, z_m);
        if contact_m.amax() > FARTHEST_M {
            return Err(format!("a contact within {FARTHEST_M} m of the base, in the base's frame"));
        }
        let covariance_m2 = Matrix3::new(xx, xy, xz, xy, yy, yz, xz, yz, zz);
        if covariance_m2.amax() > FARTHEST_M * FARTHEST_M || covariance_m2.cholesky().is_none() {
            return Err("a positive definite covariance in m2, in the base's frame".into());
        }
        let calibrated = &*knowledge.calibrated;
        let contact = Point::from_vector(contact_m);
        let at = calibrated.around(contact);
        let stated = unit("normal", [self.normal_x, self.normal_y, self.normal_z])?;
        let along = unit("direction", [self.direction_x, self.direction_y, self.direction_z])?;
        let direction =
            both(along, self.direction_sd_rad, "direction_x, direction_y, direction_z and direction_sd_rad")?
                .map(|(along, sd_rad)| Direction { along, sd_rad });
        let radius = both(self.radius_m, self.radius_sd_m, "radius_m and radius_sd_m")?
            .map(|(radius_m, sd_m)| Radius { radius_m, sd_m });
        if direction.is_some_and(|direction| direction.sd_rad <= 0.0) {
            return Err("a positive direction_sd_rad".into());
        }
        if radius.is_some_and(|Radius { radius_m, sd_m }| radius_m < 0.0 || sd_m <= 0.0) {
            return Err("a radius_m of at least 0 and a positive radius_sd_m".into());
        }
        Ok(Some(Estimate {
            contact,
            covariance_m2,
            normal: stated.unwrap_or_else(|| calibrated.normal(at)),
            normal_covariance: Matrix3::zeros(),
            direction,
            radius,
            calibrated: calibrated.domain.contains(at),
            innovation: None,
            models: None,
            model_doubtful: self.model_doubtful,
        }))
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

/// A unit vector, if it is stated; otherwise the expected form.
fn unit(name: &str, entries: [Option<f64>; 3]) -> Result<Option<Vector3<f64>>, String> {
    let vector = match entries {
        [None, None, None] => return Ok(None),
        [Some(x), Some(y), Some(z)] => Vector3::new(x, y, z),
        _ => return Err(format!("all of {name}_x, {name}_y and {name}_z, or none")),
    };
    if (vector.norm() - 1.0).abs() > UNIT {
        return Err(format!("a unit vector as {name}_x, {name}_y and {name}_z, in the base's frame"));
    }
    Ok(Some(vector.normalize()))
}

impl Program {
    /// Runs one trial in space. A failure during the trial is part of the result.
    ///
    /// # Errors
    /// If the program does not start.
    pub(crate) fn replay_in_space(&self, task: &SpatialTask<'_>) -> anyhow::Result<SpatialReplay> {
        let &SpatialTask { knowledge, samples, trace, seed } = task;
        let mut detector = TouchDetector::new(TouchConfig::default(), knowledge);
        let mut touched = false;
        // Poses are relative to the base's first pose, so that they do not reveal the origin of World.
        let mut base: Pose<Base, Start> = Pose::new(Vector3::zeros(), Rotation3::identity());
        let mut t_s = 0.0;
        let rows = samples.iter().map(|sample| {
            base = sample.motion.inverse().then(&base);
            t_s += sample.dt_s;
            let admitted = detector.step(sample);
            touched = admitted.as_ref().map_or(touched, |(_, touches)| *touches);
            // The motion is that since the last row, also after a gated one.
            let reading_n_m = admitted.map_or(sample.reading_n_m, |(admitted, _)| admitted.reading_n_m);
            Row::new(t_s, &base, &Sample { reading_n_m, ..*sample }, touched)
        });
        let parse =
            |_: usize, line: &str| answer(line, EXPECTED, |answer: SpatialAnswerLine| answer.estimate(knowledge));
        let Conversation { estimates, answers_us, failure } =
            self.converse(&Prior::new(knowledge, self.seed(seed, trace)), rows, parse)?;
        let timed = estimates.iter().zip(answers_us).filter(|(estimate, _)| estimate.is_some());
        let steps_us = timed.map(|(_, answer_us)| answer_us).collect();
        Ok(SpatialReplay { estimates, steps_us, failure })
    }
}
