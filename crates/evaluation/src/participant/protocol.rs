//! Messages to an external program: JSON lines, specified in `docs/your-estimator.md`. Its answers are defined in
//! [`testbed::protocol`].

use serde::Serialize;
use testbed::protocol::{BaseNoiseLine, ContactPriorLine, PROTOCOL};
use whisker::estimators::{Estimate, Knowledge, Sample};
use whisker::frames::{Base, Pose, Start};
use whisker::sensor::{AlongAway, CalibratedFace, Domain, Face};
use whisker::{RestShape, Whisker};

/// Number of nodes of the sensor model's table along the whisker and away from it.
const NODES: [usize; 2] = [61, 31];

/// Number of points of the undeflected whisker, including both ends.
const REST_POINTS: usize = 101;

/// Mask for seeds: the largest integer that is exactly representable as a double-precision number.
pub(super) const SEED_MASK: u64 = (1 << 53) - 1;

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

impl<'a> Prior<'a> {
    pub(super) fn new(knowledge: &'a Knowledge, seed: u64) -> Self {
        Self {
            protocol: PROTOCOL,
            seed: seed & SEED_MASK,
            rate_hz: knowledge.rate_hz,
            noise_sd_n_m: knowledge.noise_sd_n_m,
            base_noise: BaseNoiseLine::new(&knowledge.base_noise),
            whisker: &knowledge.whisker,
            rest: RestLine::new(&knowledge.rest),
            faces: knowledge.faces.iter().map(|face| FaceTable::new(knowledge, face)).collect(),
            contact_prior: knowledge.contact_prior.as_ref().map(ContactPriorLine::new),
        }
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
