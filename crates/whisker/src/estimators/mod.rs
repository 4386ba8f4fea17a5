//! Estimators of the contact's place, under test.
//!
//! A robot knows how its base moved between two samples and what the sensor read: a [`Sample`]. An [`Estimator`] takes samples in the
//! order of time and answers with an [`Estimate`] while the whisker touches. Touch and release are found the same way for all
//! ([`crate::touch`]); what differs is the [`Method`], which begins a [`Tracker`] at each touch.
//!
//! To add an estimator: one file with a `Method`, and one row in [`ESTIMATORS`].

mod euler_bernoulli;
mod extended;
mod gaussian;
mod model;
mod particle;
pub(crate) mod settings;
mod unscented;

pub use settings::SettingsError;

use std::sync::Arc;

use filters::Innovation;
use nalgebra::{Matrix2, Vector2};
use serde_json::Value;

use crate::frames::{Base, Point, Pose, Root};
use crate::rest::direction;
use crate::sensor::{CalibratedFace, Face};
use crate::touch::{TouchConfig, TouchDetector};
use crate::{RestShape, Whisker};

/// What the robot learns from one instant to the next.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sample {
    /// The base's frame at the last instant, seen from its frame now.
    pub motion: Pose<Base, Base>,
    /// Time since the last instant.
    pub dt_s: f64,
    /// The sensor's reading now.
    pub reading_n_m: f64,
}

/// Where an estimator believes the contact to be.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Estimate {
    /// Contact on the centre line.
    pub contact: Point<Base>,
    /// Side of the whisker on which the object lies.
    pub face: Face,
    /// Its covariance, in m2, where the method states one.
    pub covariance_m2: Option<Matrix2<f64>>,
    /// Whether the contact lies where the sensor model was calibrated.
    pub calibrated: bool,
    /// What the last update learnt, where the method has such a thing.
    pub innovation: Option<Innovation<1>>,
}

/// What an honest robot knows before it touches anything.
#[derive(Clone, Debug)]
pub struct Knowledge {
    /// The whisker.
    pub whisker: Whisker,
    /// Its undeflected shape.
    pub rest: RestShape,
    /// Calibrated sensor model of each face, at least one.
    pub faces: Vec<Arc<CalibratedFace>>,
    /// Standard deviation of the sensor's measurement noise.
    pub noise_sd_n_m: f64,
}

impl Knowledge {
    /// The calibration of a face, if there is one.
    pub fn face(&self, face: Face) -> Option<&Arc<CalibratedFace>> {
        self.faces.iter().find(|calibrated| calibrated.face == face)
    }

    /// Tangent angle of the deflected whisker at a contact, in Base.
    ///
    /// The root is turned by reading over stiffness. In the clamped wire's frame a straight cantilever whose loaded point
    /// lies at polar angle theta has the tangent 1.5 theta there (within 1.6 % to 60 degrees, Solomon and Hartmann 2010);
    /// for a pre-curved one theta counts from the undeflected point at the same distance from the root. \[inferred\]
    pub fn tangent_rad(&self, contact: Point<Base>, reading_n_m: f64) -> f64 {
        let root_rad = reading_n_m / self.whisker.root_stiffness_n_m_rad;
        let clamp: Pose<Root, Base> = Pose::new(0.0, 0.0, root_rad);
        let seen = clamp.inverse().apply(contact);
        let arc_m = self.rest.arc_at_radius(seen.vector().norm());
        let undeflected = self.rest.point(arc_m);
        let theta_rad = seen.y().atan2(seen.x()) - undeflected.y().atan2(undeflected.x());
        root_rad + self.rest.tangent_rad(arc_m) + 1.5 * theta_rad
    }

    /// The point of the object's surface that belongs to an estimate: the wire's radius towards the object.
    pub fn surface(&self, estimate: &Estimate, reading_n_m: f64) -> Point<Base> {
        let tangent = direction(self.tangent_rad(estimate.contact, reading_n_m));
        let left = Vector2::new(-tangent.y, tangent.x);
        let radius_m = 0.5 * self.whisker.diameter_m(self.rest.foot(estimate.contact).arc_m);
        estimate.contact.shifted(left * (-estimate.face.away_sign() * radius_m))
    }
}

/// Follows one contact from touch to release.
pub trait Tracker: Send {
    /// Takes one sample; the first is that of the touch. No estimate means that the method does not know yet.
    fn step(&mut self, sample: &Sample) -> Option<Estimate>;
}

/// A way to follow contacts.
pub trait Method: Send + Sync {
    /// Begins at a touch on `face`. `seed` is for methods that draw random numbers.
    fn begin(&self, face: &Arc<CalibratedFace>, seed: u64) -> Box<dyn Tracker>;
}

/// Runs a method over a recording: waits for the touch, follows the contact, lets go.
pub struct Estimator {
    method: Box<dyn Method>,
    knowledge: Arc<Knowledge>,
    detector: TouchDetector,
    tracker: Option<Box<dyn Tracker>>,
    seed: u64,
    touches: u64,
}

impl Estimator {
    /// An estimator that follows contacts by `method`.
    pub fn new(method: Box<dyn Method>, knowledge: Arc<Knowledge>, touch: TouchConfig, seed: u64) -> Self {
        let largest = knowledge.faces.iter().map(|face| face.largest_reading_n_m).fold(0.0, f64::max);
        let detector = TouchDetector::new(touch, knowledge.noise_sd_n_m, largest);
        Self { method, knowledge, detector, tracker: None, seed, touches: 0 }
    }

    /// Takes the next sample in the order of time. Nothing while free, or while the method does not know yet, or on a face that was
    /// not calibrated.
    pub fn step(&mut self, sample: &Sample) -> Option<Estimate> {
        if !self.detector.step(sample.reading_n_m, sample.dt_s) {
            self.tracker = None;
            return None;
        }
        if self.tracker.is_none() {
            let face = self.knowledge.face(Face::of_reading(sample.reading_n_m))?;
            self.tracker = Some(self.method.begin(face, self.seed.wrapping_add(self.touches)));
            self.touches += 1;
        }
        self.tracker.as_mut()?.step(sample)
    }
}

/// A row of the registry of estimators.
pub struct EstimatorRow {
    /// Name.
    pub name: &'static str,
    /// One line about it.
    pub about: &'static str,
    /// Whether it is a baseline, there to be beaten.
    pub is_baseline: bool,
    /// Default settings.
    pub defaults: fn() -> Value,
    /// Makes the method from its settings and what the robot knows.
    pub build: Build,
}

/// Makes a method from its settings and what the robot knows.
pub type Build = fn(&Value, &Arc<Knowledge>) -> Result<Box<dyn Method>, SettingsError>;

/// The registry of estimators.
pub const ESTIMATORS: &[EstimatorRow] = &[
    EstimatorRow {
        name: "ekf",
        about: "extended Kalman filter with fading memory (Lin et al. 2022)",
        is_baseline: false,
        defaults: defaults::<extended::Ekf>,
        build: gaussian::build::<extended::Ekf>,
    },
    EstimatorRow {
        name: "ukf",
        about: "unscented Kalman filter with fading memory (Lin et al. 2022)",
        is_baseline: false,
        defaults: defaults::<unscented::Ukf>,
        build: gaussian::build::<unscented::Ukf>,
    },
    EstimatorRow {
        name: "particle",
        about: "particle filter with fading memory (Lin et al. 2022)",
        is_baseline: false,
        defaults: defaults::<particle::Config>,
        build: particle::build,
    },
    EstimatorRow {
        name: "euler-bernoulli",
        about: "slip along an analytic cantilever (Solomon and Hartmann 2010), on the compliant root",
        is_baseline: true,
        defaults: defaults::<euler_bernoulli::Config>,
        build: euler_bernoulli::build_analytic,
    },
    EstimatorRow {
        name: "euler-bernoulli-calibrated",
        about: "the same with moment and its slope from the calibrated map (as in Lin et al. 2022)",
        is_baseline: true,
        defaults: defaults::<euler_bernoulli::Config>,
        build: euler_bernoulli::build_calibrated,
    },
];

/// The registry's row of this name.
pub fn estimator(name: &str) -> Option<&'static EstimatorRow> {
    ESTIMATORS.iter().find(|row| row.name == name)
}

fn defaults<Config: Default + serde::Serialize>() -> Value {
    serde_json::to_value(Config::default()).expect("settings serialise")
}
