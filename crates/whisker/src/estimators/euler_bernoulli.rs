//! The baseline: slip along the whisker inferred from Euler-Bernoulli beam theory (Solomon and Hartmann 2010,
//! "Extracting object contours with the sweep of a robotic whisker using torque information").
//!
//! A small push past the touch gives the distance of the contact from the base. From then on, each change of moment
//! that the base's motion over a resting contact does not explain is attributed to slip along the whisker. In the
//! publication the whisker is clamped, straight and only rotates; here the base may move in any way, the root is
//! compliant, and the whisker may be pre-curved:
//! - the root takes its share of the deflection;
//! - deflection is measured from the undeflected wire;
//! - the touch is evaluated for curved beams on the compliant root, over many samples instead of one;
//! - slip is bounded by the base's motion.
//!
//! Errors across the whisker persist: the method corrects along it only.
//!
//! Notation: `r` distance of the contact from the clamp, `theta` polar angle of the deflection (positive away from the
//! object), `M` moment (positive likewise), `EI` bending stiffness.

use std::sync::Arc;

use nalgebra::Vector2;
use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::{Estimate, Knowledge, Method, Sample, Touch, Tracker};
use crate::frames::{Base, Point, Pose};
use crate::rest::direction;
use crate::sensor::{AlongAway, CalibratedFace};
use crate::settings::{Settings, SettingsError, parse, within};

/// Candidate distances along the whisker at the touch.
const CANDIDATES: usize = 240;

/// Panels of the Simpson rule for the compliance at the touch.
const PANELS: usize = 32;

/// Settings.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub(super) struct Config {
    /// Push past the touch at which the contact's distance is estimated, as an angle about the root (rad). Smaller
    /// deflections determine slip too poorly to be used later, either.
    pub onset_rad: f64,
    /// Largest slip per sample, as a share of the contact's displacement in Base that the base's motion causes. Without
    /// a bound the estimate drifts to an end of the whisker: on a root this soft the moment hardly depends on the
    /// position along the whisker, so a small error across it is attributed to a large slip.
    pub most_slip: f64,
}

impl Default for Config {
    fn default() -> Self {
        Self { onset_rad: 3f64.to_radians(), most_slip: 0.3 }
    }
}

impl Settings for Config {
    fn validate(&self) -> Result<(), SettingsError> {
        within("onset_rad", self.onset_rad, 1e-4..=1.0)?;
        within("most_slip", self.most_slip, 0.0..=10.0)
    }
}

/// Number of samples of an onset at which every second one is dropped.
const MOST_ONSET: usize = 1 << 12;

/// Source of moment and slope.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Source {
    Cantilever,
    CalibratedMap,
}

struct EulerBernoulli {
    config: Config,
    source: Source,
    knowledge: Arc<Knowledge>,
}

pub(super) fn build_analytic(config: &Value, knowledge: &Arc<Knowledge>) -> Result<Box<dyn Method>, SettingsError> {
    build(config, knowledge, Source::Cantilever)
}

pub(super) fn build_calibrated(config: &Value, knowledge: &Arc<Knowledge>) -> Result<Box<dyn Method>, SettingsError> {
    build(config, knowledge, Source::CalibratedMap)
}

fn build(config: &Value, knowledge: &Arc<Knowledge>, source: Source) -> Result<Box<dyn Method>, SettingsError> {
    Ok(Box::new(EulerBernoulli { config: parse(config)?, source, knowledge: knowledge.clone() }))
}

impl Method for EulerBernoulli {
    fn begin(&self, touch: &Touch<'_>) -> Box<dyn Tracker> {
        Box::new(Baseline {
            config: self.config,
            source: self.source,
            knowledge: self.knowledge.clone(),
            face: touch.face.clone(),
            state: State::Onset { since_touch: Pose::new(0.0, 0.0, 0.0), history: Vec::with_capacity(MOST_ONSET) },
        })
    }

    fn is_of_fixed_size(&self) -> bool {
        true
    }
}

enum State {
    /// Collects the base's motion since the touch and the readings.
    Onset { since_touch: Pose<Base, Base>, history: Vec<(Pose<Base, Base>, f64)> },
    /// Follows the contact.
    Following { contact: Point<Base> },
}

struct Baseline {
    config: Config,
    source: Source,
    knowledge: Arc<Knowledge>,
    face: Arc<CalibratedFace>,
    state: State,
}

/// Prediction for a contact that rested in the world.
struct Expectation {
    /// Moment (N m), positive if the object pushes.
    moment_n_m: f64,
    /// Slope of the moment along the whisker towards the root (N).
    slope_n: f64,
    /// Unit vector along the whisker towards the root.
    towards_root: Vector2<f64>,
    /// Deflection as a polar angle about the clamp.
    theta_rad: f64,
}

/// Step of the finite difference for the cantilever's slope.
const SLOPE_STEP_M: f64 = 1e-5;

/// A cantilever on the compliant root, bent so that it passes through a contact.
struct Cantilever {
    /// Moment (N m), positive if the object pushes.
    moment_n_m: f64,
    /// Polar angle of the contact about the root against the undeflected wire, positive away from the object.
    theta_rad: f64,
    /// Tangent angle at the contact, in Base.
    tangent_rad: f64,
}

/// The clamped wire obeys `M r / EI = 3.0063 t - 0.0341 t^2 - 0.6683 t^3` (fitted to the exact cantilever; Solomon and
/// Hartmann 2010 give a similar law), and its tangent at the contact is 1.5 t. The root takes `M / k` of the whole
/// angle `theta`, so `t = theta - M / k`.
fn cantilever(knowledge: &Knowledge, contact: Point<Base>, sign: f64) -> Cantilever {
    let radius_m = contact.vector().norm();
    let arc_m = knowledge.rest.arc_at_radius(radius_m);
    let undeflected = knowledge.rest.point(arc_m);
    let theta_rad = sign * (contact.y().atan2(contact.x()) - undeflected.y().atan2(undeflected.x()));
    let stiffness = knowledge.whisker.bending_stiffness_n_m2(0.5 * arc_m) / radius_m;
    let root = knowledge.whisker.root_stiffness_n_m_rad;
    let wire = |t: f64| stiffness * ((-0.6683 * t - 0.0341) * t + 3.0063) * t;
    let slope = |t: f64| stiffness * ((-3.0 * 0.6683 * t - 2.0 * 0.0341) * t + 3.0063);
    // Newton's method on `wire(t) = k (theta - t)`, which is nearly linear.
    let mut t = theta_rad * root / (root + slope(0.0));
    for _ in 0..4 {
        t -= (wire(t) - root * (theta_rad - t)) / (slope(t) + root);
    }
    Cantilever {
        moment_n_m: wire(t),
        theta_rad,
        tangent_rad: knowledge.rest.tangent_rad(arc_m) + sign * (theta_rad + 0.5 * t),
    }
}

/// Moment per unit of small normal deflection of a contact at `arc_m`, of the wire in series with the root: unit load,
/// curved beam, `1 / compliance = M / (integral of lever^2 / EI + lever(0)^2 / k)`. A straight clamped wire gives `3 EI
/// / r^2`.
fn onset_stiffness_n(knowledge: &Knowledge, arc_m: f64) -> f64 {
    let normal = direction(knowledge.rest.tangent_rad(arc_m) + std::f64::consts::FRAC_PI_2);
    let contact = knowledge.rest.point(arc_m).vector();
    let lever = |s: f64| {
        let arm = contact - knowledge.rest.point(s).vector();
        arm.x * normal.y - arm.y * normal.x
    };
    let bending = |s: f64| lever(s).powi(2) / knowledge.whisker.bending_stiffness_n_m2(s);
    let step = arc_m / PANELS as f64;
    let wire: f64 = (0..PANELS)
        .map(|panel| {
            let s = panel as f64 * step;
            (bending(s) + 4.0 * bending(s + 0.5 * step) + bending(s + step)) * step / 6.0
        })
        .sum();
    let root = lever(0.0);
    root / (wire + root * root / knowledge.whisker.root_stiffness_n_m_rad)
}

impl Baseline {
    /// The contact at the touch, carried along with the base since: the position along the undeflected whisker whose
    /// stiffness explains the growth of the reading. The unknown push before the detection of the touch is fitted with
    /// it.
    fn onset(&self, history: &[(Pose<Base, Base>, f64)]) -> Point<Base> {
        let (low, high) = self.face.domain.arc_range_m();
        let sign = self.face.face.away_sign();
        let mut best = (f64::INFINITY, low, 0.0);
        for candidate in 0..CANDIDATES {
            let arc_m = low + (high - low) * candidate as f64 / (CANDIDATES - 1) as f64;
            let stiffness = onset_stiffness_n(&self.knowledge, arc_m);
            let touched = self.knowledge.rest.point(arc_m);
            let unexplained = |(motion, reading): &(Pose<Base, Base>, f64)| {
                sign * reading - stiffness * self.face.along_and_away(motion.apply(touched)).away_m
            };
            let count = history.len() as f64;
            let before = history.iter().map(unexplained).sum::<f64>() / count;
            let error: f64 = history.iter().map(|instant| (unexplained(instant) - before).powi(2)).sum();
            if error < best.0 {
                best = (error, arc_m, before / stiffness);
            }
        }
        let (_, arc_m, before_m) = best;
        let (motion, _) = history[history.len() - 1];
        motion.apply(self.face.contact_at(AlongAway::new(arc_m, before_m.max(0.0))))
    }

    /// Prediction of the theory, or of the map, for a contact that rested in the world.
    fn expect(&self, contact: Point<Base>) -> Expectation {
        let sign = self.face.face.away_sign();
        let cantilever = |contact| cantilever(&self.knowledge, contact, sign);
        let here = cantilever(contact);
        let towards_root = -direction(here.tangent_rad);
        let (moment_n_m, slope_n) = match self.source {
            Source::Cantilever => {
                let ahead = cantilever(contact.shifted(towards_root * SLOPE_STEP_M));
                (here.moment_n_m, (ahead.moment_n_m - here.moment_n_m) / SLOPE_STEP_M)
            }
            Source::CalibratedMap => {
                let expected = self.face.model.predict(self.face.nearest_calibrated(contact));
                (sign * expected.reading_n_m, sign * expected.gradient_n.dot(&towards_root))
            }
        };
        Expectation { moment_n_m, slope_n, towards_root, theta_rad: here.theta_rad }
    }
}

impl Tracker for Baseline {
    fn step(&mut self, sample: &Sample) -> Option<Estimate> {
        let sign = self.face.face.away_sign();
        let contact = match &mut self.state {
            State::Onset { since_touch, history } => {
                if !history.is_empty() {
                    *since_touch = since_touch.then(&sample.motion);
                }
                let motion = *since_touch;
                history.push((motion, sample.reading_n_m));
                if history.len() == MOST_ONSET {
                    // The last sample is kept.
                    let mut is_kept = true;
                    history.retain(|_| {
                        is_kept = !is_kept;
                        is_kept
                    });
                }
                let (low, high) = self.face.domain.arc_range_m();
                let middle = 0.5 * (low + high);
                let pushed_m = self.face.along_and_away(motion.apply(self.knowledge.rest.point(middle))).away_m;
                if pushed_m < self.config.onset_rad.tan() * middle {
                    return None;
                }
                let history = std::mem::take(history);
                self.onset(&history)
            }
            State::Following { contact } => {
                let last = *contact;
                let rested = sample.motion.apply(last);
                let expected = self.expect(rested);
                if expected.theta_rad > self.config.onset_rad && expected.slope_n > 0.0 {
                    let unexplained = sign * sample.reading_n_m - expected.moment_n_m;
                    let slip_m = unexplained / expected.slope_n;
                    let most_m = self.config.most_slip * rested.distance(&last);
                    rested.shifted(expected.towards_root * slip_m.clamp(-most_m, most_m))
                } else {
                    rested
                }
            }
        };
        // The contact cannot leave the whisker; a slip that would is noise.
        let contact = self.face.nearest_calibrated(contact);
        self.state = State::Following { contact };
        let calibrated = self.face.predict(contact).is_some();
        Some(Estimate { calibrated, ..Estimate::at(contact, self.face.face) })
    }
}
