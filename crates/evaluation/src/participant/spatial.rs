//! External programs on trials in space: version 2 of the protocol, specified in `docs/your-estimator.md`.

use std::f64::consts::TAU;
use std::sync::Arc;

use nalgebra::{Rotation3, UnitQuaternion, Vector3};
use serde::Serialize;
use testbed::protocol::space::{SPATIAL_PROTOCOL, spatial_estimate};
use testbed::space::replay::SpatialReplay;
use trace::StatedSuspension;
use whisker::Whisker;
use whisker::events::TouchConfig;
use whisker::frames::{Base, Start};
use whisker::space::estimators::{Knowledge, Sample, TouchDetector};
use whisker::space::frames::Pose;
use whisker::space::sensor::{Around, CalibratedSpace, SpatialDomain};

use super::program::{Conversation, Program};
use super::protocol::{RestLine, SEED_MASK, evenly};

/// Number of nodes of the sensor model's table along the whisker, about it, and away from it.
const NODES: [usize; 3] = [25, 16, 7];

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
        let first = Prior::new(knowledge, self.seed(seed, trace));
        let parse = |_: usize, line: &str| spatial_estimate(line, knowledge);
        let Conversation { estimates, answers_us, failure } = self.converse(&first, rows, parse)?;
        let timed = estimates.iter().zip(answers_us).filter(|(estimate, _)| estimate.is_some());
        let steps_us = timed.map(|(_, answer_us)| answer_us).collect();
        Ok(SpatialReplay { estimates, steps_us, failure })
    }
}
