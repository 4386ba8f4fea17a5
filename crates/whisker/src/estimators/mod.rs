//! Estimators of the contact point.
//!
//! The input of an estimator is a sequence of [`Sample`]s: the motion of the base between two instants, and the
//! sensor's reading. An [`Estimator`] takes samples in the order of time and returns an [`Estimate`] while the whisker
//! touches. Contact detection is common to all ([`crate::events`]); estimators differ in the [`Method`], which begins a
//! [`Tracker`] at each touch.
//!
//! To add an estimator: one file with a `Method`, and one row in [`ESTIMATORS`].

mod base_noise;
mod batch;
mod block;
mod doubt;
mod drifting;
mod euler_bernoulli;
mod extended;
mod gaussian;
mod imm;
mod inertia;
mod installed;
mod iterated;
mod model_averaging;
mod motion;
mod outline;
mod paper;
mod particle;
mod pushed;
mod quantities;
mod registry;
mod rubbing;
mod runner;
mod second;
mod shares;
mod side;
mod smoother;
mod start;
mod systematic;
#[cfg(test)]
pub(crate) mod testing;
mod touched;
mod unscented;

pub use crate::settings::{Settings, SettingsError, parse, with_defaults, within};
pub use base_noise::BaseNoise;
pub use quantities::{FrictionCoefficient, Installation, Radius, Uncertain, Velocity};
pub use registry::{Build, ESTIMATORS, EstimatorRow, MethodClass, estimator};
pub use runner::{Estimator, Runner};
pub(crate) use shares::MOST_MODELS;
pub use shares::ModelShares;

use std::sync::Arc;

use filters::{Innovation, product};
use nalgebra::{Matrix2, Vector2};

use crate::events::Sensing;
use crate::frames::{Base, Point, Pose, Root, Start};
use crate::rest::direction;
use crate::sensor::{CalibratedFace, Face};
use crate::{ReadingGate, RestShape, Whisker};

/// One sample: the motion since the last instant, and the reading.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sample {
    /// Pose of the base's frame at the last instant in its present frame.
    pub motion: Pose<Base, Base>,
    /// Time since the last instant (s): positive, or 0 at the first sample. Filters with friction take a later 0 as a step back.
    pub dt_s: f64,
    /// Present reading of the sensor: bending moment about z at the root (N m). Beyond the [`ReadingGate`] it counts as missing.
    pub reading_n_m: f64,
}

/// Estimate of the contact at one instant.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Estimate {
    /// Contact point on the centre line.
    pub contact: Point<Base>,
    /// Side of the whisker on which the object lies.
    pub face: Face,
    /// Posterior covariance of the contact in Base (m2), 2x2. `None` for methods without one.
    pub covariance_m2: Option<Matrix2<f64>>,
    /// Whether the contact lies within the region in which the sensor model was calibrated.
    pub calibrated: bool,
    /// Whether the contact may lie at the tip, where the reading has another meaning.
    pub at_tip: bool,
    /// Innovation of the last update. `None` for methods without one.
    pub innovation: Option<Innovation<1>>,
    /// Radius of the object at the contact, without the wire's. `None` if the method does not estimate it.
    pub radius: Option<Radius>,
    /// Coefficient of friction between whisker and object. `None` if the method does not estimate it or the readings do not
    /// determine it.
    pub friction: Option<FrictionCoefficient>,
    /// Velocity of the object in the world. `None` if the method does not estimate it, or considers a motion too improbable.
    pub velocity: Option<Velocity>,
    /// Deviation of the sensor from its calibration. `None` if the method does not estimate it, or considers a deviation too
    /// improbable.
    pub installation: Option<Installation>,
    /// Probabilities of the competing models of the method. `None` if it has one model only.
    pub models: Option<ModelShares>,
    /// Whether the readings contradict the models of the method, so that its covariance may be too small, or the object moves.
    /// Always `false` for methods that average no models.
    pub model_doubtful: bool,
    /// Whether the readings, or the shape of the whisker, show that a second contact has taken load within the last instants.
    /// Always `false` for methods that average no models.
    pub second_contact: bool,
}

impl Estimate {
    /// An estimate that states a contact on a face and nothing else, outside the calibrated domain.
    pub fn at(contact: Point<Base>, face: Face) -> Self {
        Self {
            contact,
            face,
            covariance_m2: None,
            calibrated: false,
            at_tip: false,
            innovation: None,
            radius: None,
            friction: None,
            velocity: None,
            installation: None,
            models: None,
            model_doubtful: false,
            second_contact: false,
        }
    }
}

/// Prior information available to an estimator.
#[derive(Clone, Debug)]
pub struct Knowledge {
    /// The whisker.
    pub whisker: Whisker,
    /// Undeflected shape of the whisker.
    pub rest: RestShape,
    /// Calibrated sensor model of each face, at least one.
    pub faces: Vec<Arc<CalibratedFace>>,
    /// Standard deviation of the sensor's measurement noise.
    pub noise_sd_n_m: f64,
    /// Noise of the base's measured pose.
    pub base_noise: BaseNoise,
    /// Sampling rate of the readings (Hz), for the filters of the contact detection.
    pub rate_hz: f64,
    /// Prior of the first contact. Without it the first touch may lie anywhere along the undeflected whisker.
    pub contact_prior: Option<ContactPrior>,
}

/// Prior of the first contact.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ContactPrior {
    /// Mean of the contact at the touch.
    pub contact: Point<Base>,
    /// Standard deviation in every direction.
    pub sd_m: f64,
}

/// Factor of the arc length by which a deflected whisker reaches beyond the foot of its contact; see
/// [`Knowledge::may_be_tip`].
const BENT_STRETCH: f64 = 0.55;

impl Knowledge {
    /// Parameters of the contact detection.
    pub fn sensing(&self) -> Sensing {
        Sensing::new(&self.whisker, self.rate_hz, self.noise_sd_n_m, self.largest_reading_n_m())
    }

    /// Gate of the readings.
    pub fn gate(&self) -> ReadingGate {
        ReadingGate::new(self.largest_reading_n_m())
    }

    /// Largest calibrated reading of all faces.
    fn largest_reading_n_m(&self) -> f64 {
        self.faces.iter().map(|face| face.largest_reading_n_m).fold(0.0, f64::max)
    }

    /// The calibration of a face. `None` if that face was not calibrated.
    pub fn face(&self, face: Face) -> Option<&Arc<CalibratedFace>> {
        self.faces.iter().find(|calibrated| calibrated.face == face)
    }

    /// Tangent angle of the deflected whisker at an estimated contact, in Base: that of the sensor model if it includes
    /// mechanics.
    ///
    /// Otherwise the root is turned by reading over stiffness. In the clamped wire's frame a straight cantilever whose
    /// loaded point lies at the polar angle theta has the tangent angle 1.5 theta there (within 1.6 % up to 60 degrees,
    /// Solomon and Hartmann 2010); for a pre-curved wire theta is measured from the undeflected point at the same
    /// distance from the root. \[inferred\]
    pub fn tangent_rad(&self, estimate: &Estimate, reading_n_m: f64) -> f64 {
        let known = self.face(estimate.face).and_then(|face| face.model.tangent_rad(estimate.contact));
        known.unwrap_or_else(|| {
            let root_rad = reading_n_m / self.whisker.root_stiffness_n_m_rad;
            let clamp: Pose<Root, Base> = Pose::new(0.0, 0.0, root_rad);
            let seen = clamp.inverse().apply(estimate.contact);
            let arc_m = self.rest.arc_at_radius(seen.vector().norm());
            let undeflected = self.rest.point(arc_m);
            let (from, to) = (undeflected.vector(), seen.vector());
            let theta_rad = from.perp(&to).atan2(from.dot(&to));
            root_rad + self.rest.tangent_rad(arc_m) + 1.5 * theta_rad
        })
    }

    /// Whether an estimated contact may lie at the tip: whether three standard deviations beyond its arc length reach
    /// the whisker's length.
    ///
    /// A contact displaced by `d` at the foot `s` lies at the arc length `s + c d^2 / s` of the bent whisker, to second
    /// order, with c from 0.5 for a straight wire that only turns at its root to 0.6 for a clamped one; their mean
    /// (`BENT_STRETCH`) is used.
    pub fn may_be_tip(&self, estimate: &Estimate) -> bool {
        const SDS: f64 = 3.0;
        let foot = self.rest.foot(estimate.contact);
        let tangent = self.rest.tangent(foot.arc_m);
        let sd_m = estimate.covariance_m2.map_or(0.0, |p| tangent.dot(&product(&p, &tangent)).max(0.0).sqrt());
        let arc_m = foot.arc_m + BENT_STRETCH * foot.left_m * foot.left_m / foot.arc_m.max(f64::MIN_POSITIVE);
        arc_m + SDS * sd_m >= self.rest.length_m()
    }

    /// Point of the object's surface that belongs to an estimate: the contact shifted by the wire's radius towards the
    /// object.
    pub fn surface(&self, estimate: &Estimate, reading_n_m: f64) -> Point<Base> {
        self.surface_beside(estimate, direction(self.tangent_rad(estimate, reading_n_m)))
    }

    /// As [`Self::surface`], with the known tangent of the deflected whisker at the contact, a unit vector.
    pub fn surface_beside(&self, estimate: &Estimate, tangent: Vector2<f64>) -> Point<Base> {
        let left = Vector2::new(-tangent.y, tangent.x);
        let radius_m = 0.5 * self.whisker.diameter_m(self.rest.foot(estimate.contact).arc_m);
        estimate.contact.shifted(left * (-estimate.face.away_sign() * radius_m))
    }
}

/// Prediction of a sample from the last estimate.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Ahead {
    /// Displacement (m, in Base after the motion) by which the contact slides over the object.
    pub slip_m: Vector2<f64>,
    /// Normalised innovation squared of the reading. `None` if no reading is predicted.
    pub nis: Option<f64>,
}

/// Tracks one contact from touch to release.
pub trait Tracker: Send {
    /// Takes one sample; the first is that of the touch. `None` until the method has an estimate.
    fn step(&mut self, sample: &Sample) -> Option<Estimate>;

    /// Takes the mean of `count` successive samples: motion and time from the last mean to this one, and the mean reading, whose
    /// noise has averaged out. Default: takes it as one sample.
    fn step_mean(&mut self, sample: &Sample, _count: f64) -> Option<Estimate> {
        self.step(sample)
    }

    /// Predicts a further sample from the last estimate, without taking it. Default: the contact rests, and no reading is
    /// predicted.
    fn look_ahead(&self, _sample: &Sample) -> Ahead {
        Ahead::default()
    }

    /// Number of hypotheses of the tracker. The time of a step is about proportional to it. Default: one.
    fn hypotheses(&self) -> usize {
        1
    }

    /// Continues work that needs no sample, such as a search in progress. Default: none.
    fn work(&mut self) {}

    /// Smoothed estimates of every sample since the touch, in their order. Called once, at the release or at the end of
    /// the recording. `None` for methods that do not smooth.
    fn hindsight(&mut self) -> Option<Vec<Option<Estimate>>> {
        None
    }

    /// Resumes tracking at the next touch after a release, with the estimate of the object. Returns whether it does;
    /// if not, a new tracker is begun.
    fn resume(&mut self, _touch: &Touch<'_>) -> bool {
        false
    }

    /// Estimate of a contact with the object of the last touch while none is detected, if the readings show that the whisker
    /// touches it again. Takes every sample since the release. Default: none.
    fn expect_touch(&mut self, _undetected: &Undetected) -> Option<Estimate> {
        None
    }

    /// Whether the readings have contradicted the convex outline that the tracker fitted to the present object, as they do if the
    /// object is not convex, moves, or is touched through a sensor with a wrong calibration.
    fn refutes_convexity(&self) -> bool {
        false
    }

    /// Whether the tracker assumes an object that moves.
    fn assumes_motion(&self) -> bool {
        false
    }

    /// Whether the tracker assumes a contact with friction.
    fn assumes_friction(&self) -> bool {
        false
    }

    /// Name of the method as which it follows the contact until it knows more, so that it may take the onset of this touch in
    /// blocks if that method takes single samples. Default: `None`.
    fn follows_as(&self) -> Option<&'static str> {
        None
    }

    /// Takes note whether the contact may jump from one place of the object to another. Default: no effect.
    fn expect_jumps(&mut self, _expected: bool) {}

    /// Takes note that the contact may have returned to this place of an earlier contact, at the last sample. Without effect unless
    /// jumps are expected. Default: no effect.
    fn expect_return(&mut self, _place: Point<Base>) {}

    /// Second moments (m2, in Base) of the error that systematic errors of readings and poses cause in the last estimate, and which
    /// its covariance does not contain. `None` for methods without such errors.
    fn systematic_m2(&self) -> Option<Matrix2<f64>> {
        None
    }

    /// Outline of the object as far as it was touched, ordered by the whisker's tangent turning to the left. `None` for
    /// methods that estimate contacts only.
    fn outline(&self) -> Option<Vec<OutlinePoint>> {
        None
    }

    /// Whether the estimates are contacts on [`Self::outline`]; see [`CarriedOutline::leads`].
    fn outline_leads(&self) -> bool {
        true
    }
}

/// Outline that an estimator carries.
#[derive(Clone, Debug, PartialEq)]
pub struct CarriedOutline {
    /// Its points, ordered by the whisker's tangent turning to the left.
    pub points: Vec<OutlinePoint>,
    /// Whether the estimates are contacts on this outline. If not, it is that of a less probable model, and an outline through
    /// the estimated contacts takes precedence if they are certain enough.
    pub leads: bool,
}

/// A point of an object's outline, in Start.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OutlinePoint {
    /// The point of the object's surface.
    pub surface: Point<Start>,
    /// Outward normal there, a unit vector.
    pub normal: Vector2<f64>,
    /// Covariance of the point (m2), as far as it leads out of the outline: along a straight stretch it is nearly zero.
    pub covariance_m2: Matrix2<f64>,
}

/// The beginning of a touch.
#[derive(Clone, Copy, Debug)]
pub struct Touch<'a> {
    /// The face that is touched.
    pub face: &'a Arc<CalibratedFace>,
    /// Samples before that of the touch, in the order of time: the whisker was free, or its contact was not detected
    /// yet.
    pub history: &'a [Sample],
    /// Time since the last sample of the touch before, or since the start (s), also of samples that the history no longer holds.
    pub free_s: f64,
    /// Pose of the base at the last sample before that of the touch.
    pub before: Pose<Base, Start>,
    /// Prior of this contact.
    pub contact_prior: Option<ContactPrior>,
    /// Seed for methods that draw random numbers.
    pub seed: u64,
}

/// A sample after a release while no contact is detected.
#[derive(Clone, Copy, Debug)]
pub struct Undetected {
    /// Pose of the base.
    pub base: Pose<Base, Start>,
    /// Time since the last sample of the last touch (s).
    pub free_s: f64,
    /// Time since the last sample (s).
    pub dt_s: f64,
    /// Bending moment at the root (N m).
    pub reading_n_m: f64,
}

/// An estimation method.
pub trait Method: Send + Sync {
    /// Begins to track a contact; the first sample that the tracker takes is that of the touch.
    fn begin(&self, touch: &Touch<'_>) -> Box<dyn Tracker>;

    /// Whether its trackers have a constant size from their second step on, so that no step allocates memory.
    fn is_of_fixed_size(&self) -> bool {
        false
    }
}
