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
mod odds;
mod outline;
mod paper;
mod particle;
mod pushed;
mod quantities;
mod regained;
mod rubbing;
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
pub(crate) use shares::MOST_MODELS;
pub use shares::ModelShares;

use std::collections::VecDeque;
use std::sync::Arc;

use filters::{Innovation, product};
use nalgebra::{Matrix2, Vector2};
use serde::{Deserialize, Serialize};
use serde_json::Value;

use crate::events::{ContactDetector, Sensing, Signals, TouchConfig};
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
    /// Whether the readings contradict the models of the method, so that its covariance may be too small, or the object moves. Always
    /// `false` for methods that average no models.
    pub model_doubtful: bool,
    /// Whether the readings, or the shape of the whisker, show that a second contact has taken load within the last instants. Always
    /// `false` for methods that average no models.
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

/// Largest distance of a stated contact from the root in lengths of the whisker. Beyond one it is an error; the margin
/// leaves the error of an estimate near the tip visible.
const MOST_REACH: f64 = 1.5;

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

    /// Estimate of a contact with the object of the last touch while none is detected, if the readings show that the whisker touches it
    /// again. Takes every sample since the release. Default: none.
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

    /// Name of the method as which it follows the contact until it knows more, so that it may take the onset of this touch in blocks
    /// if that method takes single samples. Default: `None`.
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

/// Samples of the free whisker that are kept for the next touch.
const HISTORY: usize = 50;

/// Runs a method over a recording whose contacts are known: waits for a touch, tracks the contact until its release.
/// Readings beyond the [`ReadingGate`] count as missing and give no estimate.
pub struct Runner {
    method: Box<dyn Method>,
    knowledge: Arc<Knowledge>,
    gate: ReadingGate,
    /// Motion and duration of the gated samples since the last admitted one.
    missed: Option<(Pose<Base, Base>, f64)>,
    /// Number of gated samples.
    gated: u64,
    /// Samples of the present touch, and the places of the gated ones among them.
    touch_samples: usize,
    gated_in_touch: Vec<usize>,
    tracker: Option<Box<dyn Tracker>>,
    /// The tracker of the last touch, while the whisker is free.
    released: Option<Box<dyn Tracker>>,
    /// The last samples of the free whisker.
    history: VecDeque<Sample>,
    /// Time since the last touch.
    free_s: f64,
    /// Present pose of the base.
    base: Pose<Base, Start>,
    seed: u64,
    touches: u64,
}

impl Runner {
    /// A runner of `method`.
    pub fn new(method: Box<dyn Method>, knowledge: Arc<Knowledge>, seed: u64) -> Self {
        Self {
            gate: knowledge.gate(),
            method,
            knowledge,
            missed: None,
            gated: 0,
            touch_samples: 0,
            gated_in_touch: Vec::new(),
            tracker: None,
            released: None,
            history: VecDeque::with_capacity(HISTORY),
            free_s: 0.0,
            base: Pose::new(0.0, 0.0, 0.0),
            seed,
            touches: 0,
        }
    }

    /// Takes the next sample in the order of time and, while the whisker touches, the side on which the object lies.
    /// `None` while the whisker is free, while the method has no estimate yet, at a gated reading, or on a face without
    /// calibration. While no contact is detected, there is an estimate if the method knows the object of the last touch and the
    /// readings show that the whisker touches it again ([`Tracker::expect_touch`]).
    pub fn step(&mut self, sample: &Sample, touched: Option<Face>) -> Option<Estimate> {
        if !self.gate.admits(sample.reading_n_m) {
            self.miss(sample);
            return None;
        }
        let sample = &self.with_missed(sample);
        let Some(face) = touched else {
            self.release();
            self.remember(sample);
            return self.expect_touch(sample);
        };
        self.follow(sample, face)
    }

    /// Steps through a whole recording. Estimates of a method that smooths are replaced by the smoothed ones.
    pub fn run(&mut self, samples: &[Sample], touched: &[Option<Face>]) -> Vec<Option<Estimate>> {
        let mut estimates = Vec::with_capacity(samples.len());
        for (sample, touched) in samples.iter().zip(touched) {
            self.push(sample, *touched, &mut estimates);
        }
        self.end(&mut estimates);
        estimates
    }

    /// Takes the next sample of a recording and appends its estimate. If the method smooths, the estimates of a touch
    /// are revised when it ends: they must be kept while the whisker touches ([`Self::is_following`]).
    pub fn push(&mut self, sample: &Sample, touched: Option<Face>, estimates: &mut Vec<Option<Estimate>>) {
        if touched.is_none() {
            self.look_back(estimates);
        }
        estimates.push(self.step(sample, touched));
    }

    /// Ends the recording and revises the estimates of a touch that has not ended.
    pub fn end(&mut self, estimates: &mut [Option<Estimate>]) {
        self.look_back(estimates);
    }

    /// Whether a contact is being tracked.
    pub fn is_following(&self) -> bool {
        self.tracker.is_some()
    }

    /// Outline of the object that is touched, or was touched last; see [`Tracker::outline`].
    pub fn outline(&self) -> Option<CarriedOutline> {
        let tracker = self.tracker.as_ref().or(self.released.as_ref())?;
        Some(CarriedOutline { points: tracker.outline()?, leads: tracker.outline_leads() })
    }

    /// Number of gated readings so far.
    pub fn gated(&self) -> u64 {
        self.gated
    }

    /// Gates a sample: its motion and its duration pass to the next admitted one.
    fn miss(&mut self, sample: &Sample) {
        let so_far = self.missed.take();
        self.missed = Some(so_far.map_or((sample.motion, sample.dt_s), |(motion, duration_s)| {
            (motion.then(&sample.motion), duration_s + sample.dt_s)
        }));
        self.gated += 1;
        if self.is_following() {
            self.gated_in_touch.push(self.touch_samples);
            self.touch_samples += 1;
        }
    }

    /// An admitted sample with the motion and duration of the gated ones before it. It turns by the shorter way, since measured yaws
    /// may be wrapped.
    fn with_missed(&mut self, sample: &Sample) -> Sample {
        let (motion, dt_s) = self.missed.take().map_or((sample.motion, sample.dt_s), |(motion, duration_s)| {
            (motion.then(&sample.motion), duration_s + sample.dt_s)
        });
        Sample { motion: motion.with_wrapped_yaw(), dt_s, ..*sample }
    }

    /// Ends the present touch, if there is one.
    fn release(&mut self) {
        if let Some(tracker) = self.tracker.take() {
            self.released = Some(tracker);
        }
    }

    /// Keeps a sample of the free whisker.
    fn remember(&mut self, sample: &Sample) {
        if self.history.len() == HISTORY {
            self.history.pop_front();
        }
        self.history.push_back(*sample);
        self.free_s += sample.dt_s;
        self.base = sample.motion.inverse().then(&self.base);
    }

    /// Estimate of a contact that is not detected, with the object of the last touch.
    fn expect_touch(&mut self, sample: &Sample) -> Option<Estimate> {
        let undetected =
            Undetected { base: self.base, free_s: self.free_s, dt_s: sample.dt_s, reading_n_m: sample.reading_n_m };
        let mut estimate = self.released.as_mut()?.expect_touch(&undetected);
        self.place(&mut estimate);
        estimate
    }

    /// Adds a constant to the readings of the free whisker that are kept.
    fn shift_history(&mut self, by_n_m: f64) {
        if by_n_m != 0.0 {
            self.history.iter_mut().for_each(|sample| sample.reading_n_m += by_n_m);
        }
    }

    /// Takes a sample of a touch.
    fn follow(&mut self, sample: &Sample, face: Face) -> Option<Estimate> {
        let before = self.base;
        self.base = sample.motion.inverse().then(&before);
        if self.tracker.is_none() {
            let Some(face) = self.knowledge.face(face) else {
                // The motions of the history no longer lead to the next touch.
                self.history.clear();
                self.free_s += sample.dt_s;
                return None;
            };
            let contact_prior = self.knowledge.contact_prior.filter(|_| self.touches == 0);
            let seed = self.seed.wrapping_add(self.touches);
            let free_s = std::mem::take(&mut self.free_s);
            let touch = Touch { face, history: self.history.make_contiguous(), free_s, before, contact_prior, seed };
            let resumed = self.released.take().and_then(|mut last| last.resume(&touch).then_some(last));
            self.tracker = Some(resumed.unwrap_or_else(|| self.method.begin(&touch)));
            self.history.clear();
            self.touches += 1;
            self.touch_samples = 0;
            self.gated_in_touch.clear();
        }
        self.touch_samples += 1;
        let mut estimate = self.tracker.as_mut()?.step(sample);
        self.place(&mut estimate);
        estimate
    }

    /// Sets whether the estimated contact may lie at the tip, and discards an estimate beyond the whisker's reach, as a
    /// diverged filter has. In place, since estimates are large.
    fn place(&self, estimate: &mut Option<Estimate>) {
        let farthest_m = MOST_REACH * self.knowledge.rest.length_m();
        match estimate {
            Some(found) if found.contact.vector().norm() <= farthest_m => {
                found.at_tip = self.knowledge.may_be_tip(found);
            }
            _ => *estimate = None,
        }
    }

    /// Ends the present touch, if there is one, and revises its estimates, which are the last.
    fn look_back(&mut self, estimates: &mut [Option<Estimate>]) {
        let revised = self.tracker.as_mut().and_then(|tracker| tracker.hindsight());
        self.release();
        let Some(revised) = revised else { return };
        let first = estimates.len() - self.touch_samples;
        let admitted = (0..self.touch_samples).filter(|place| self.gated_in_touch.binary_search(place).is_err());
        for (place, revised) in admitted.zip(revised) {
            let estimate = &mut estimates[first + place];
            *estimate = revised;
            self.place(estimate);
        }
    }
}

/// Detects the contacts of a recording and runs a method over it.
pub struct Estimator {
    detector: ContactDetector,
    runner: Runner,
}

impl Estimator {
    /// An estimator with these settings of the contact detection.
    pub fn new(runner: Runner, touch: TouchConfig) -> Self {
        Self { detector: ContactDetector::new(touch, &runner.knowledge.sensing()), runner }
    }

    /// See [`Runner::step`].
    pub fn step(&mut self, sample: &Sample) -> Option<Estimate> {
        let (sample, touched) = self.sense(sample);
        self.runner.step(&sample, touched)
    }

    /// The sample with the rest reading subtracted, and the face in contact.
    fn sense(&mut self, sample: &Sample) -> (Sample, Option<Face>) {
        let before_n_m = self.detector.rest_reading_n_m();
        let touched = self.detector.step(sample.reading_n_m, sample.dt_s);
        let rest_n_m = self.detector.rest_reading_n_m();
        self.runner.shift_history(before_n_m - rest_n_m);
        (Sample { reading_n_m: sample.reading_n_m - rest_n_m, ..*sample }, touched)
    }

    /// See [`Runner::run`].
    pub fn run(&mut self, samples: &[Sample]) -> Vec<Option<Estimate>> {
        let mut estimates = Vec::with_capacity(samples.len());
        for sample in samples {
            self.push(sample, &mut estimates);
        }
        self.end(&mut estimates);
        estimates
    }

    /// See [`Runner::push`].
    pub fn push(&mut self, sample: &Sample, estimates: &mut Vec<Option<Estimate>>) {
        let (sample, touched) = self.sense(sample);
        self.runner.push(&sample, touched, estimates);
    }

    /// See [`Runner::end`].
    pub fn end(&mut self, estimates: &mut [Option<Estimate>]) {
        self.runner.end(estimates);
    }

    /// See [`Runner::is_following`].
    pub fn is_following(&self) -> bool {
        self.runner.is_following()
    }

    /// See [`Runner::gated`].
    pub fn gated(&self) -> u64 {
        self.runner.gated()
    }

    /// See [`ContactDetector::signals`].
    pub fn signals(&self) -> Signals {
        self.detector.signals()
    }

    /// See [`Runner::outline`].
    pub fn outline(&self) -> Option<CarriedOutline> {
        self.runner.outline()
    }
}

/// Class of an estimation method: the samples that an estimate may depend on, and its part in a comparison.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum MethodClass {
    /// Gives an estimate at each sample from the samples so far.
    Recursive,
    /// Recursive, configured as in the publication that it comes from.
    Published,
    /// Gives its estimates when a contact has ended, from all its samples.
    Hindsight,
    /// Recursive, the reference that filters are compared with.
    Baseline,
}

/// A row of the registry of estimators.
pub struct EstimatorRow {
    /// Name.
    pub name: &'static str,
    /// One-line description.
    pub about: &'static str,
    /// Class of the method.
    pub class: MethodClass,
    /// Label of the sensor model that the method requires. `None` if it uses that selected by the calibration.
    pub sensor_model: Option<&'static str>,
    /// Default settings.
    pub defaults: fn() -> Value,
    /// Builds the method from its settings and the prior information.
    pub build: Build,
}

/// Builds a method from its settings and the prior information.
pub type Build = fn(&Value, &Arc<Knowledge>) -> Result<Box<dyn Method>, SettingsError>;

/// The registry of estimators. Static, as those of sensor models and detectors: users of a constant would each compile the methods again.
pub static ESTIMATORS: &[EstimatorRow] = &[
    EstimatorRow {
        name: "recommended",
        about: "Bayesian average of `ukf` (thin object), `round` and `sliding` (constant radius), `outline` (any \
            convex outline), `rubbing` (friction), `drifting` (moving object) and `installed` (inexact calibration); or \
            `pushed`, once it is evident that the object is pushed along",
        class: MethodClass::Recursive,
        sensor_model: None,
        defaults: defaults::<model_averaging::Config>,
        build: model_averaging::build_recursive,
    },
    EstimatorRow {
        name: "sliding",
        about: "`ekf` for round objects of any size, with estimated radius; converges more slowly on a pin",
        class: MethodClass::Recursive,
        sensor_model: None,
        defaults: || to_json(&gaussian::Config::<extended::Extended>::sliding()),
        build: gaussian::build::<extended::Extended>,
    },
    EstimatorRow {
        name: "round",
        about: "`ekf` for an object of constant radius, from a thin object to a plane",
        class: MethodClass::Recursive,
        sensor_model: None,
        defaults: || to_json(&gaussian::Config::<extended::Extended>::round()),
        build: gaussian::build::<extended::Extended>,
    },
    EstimatorRow {
        name: "installed",
        about: "`round` for a sensor whose gain and mounting may differ from the calibrated ones",
        class: MethodClass::Recursive,
        sensor_model: None,
        defaults: defaults::<installed::Config>,
        build: installed::build,
    },
    EstimatorRow {
        name: "rubbing",
        about: "`round` for a contact with Coulomb friction, with estimated coefficient",
        class: MethodClass::Recursive,
        sensor_model: None,
        defaults: defaults::<rubbing::Config>,
        build: rubbing::build,
    },
    EstimatorRow {
        name: "drifting",
        about: "`round` for an object that moves uniformly, by millimetres per second",
        class: MethodClass::Recursive,
        sensor_model: None,
        defaults: defaults::<drifting::Config>,
        build: drifting::build,
    },
    EstimatorRow {
        name: "pushed",
        about: "`round` for an object that stands freely on a table and is pushed along; the contact does not jump",
        class: MethodClass::Recursive,
        sensor_model: None,
        defaults: defaults::<pushed::Config>,
        build: pushed::build,
    },
    EstimatorRow {
        name: "ekf",
        about: "extended Kalman filter for the contact with a thin object, from several hypotheses",
        class: MethodClass::Recursive,
        sensor_model: None,
        defaults: defaults::<gaussian::Config<extended::Extended>>,
        build: gaussian::build::<extended::Extended>,
    },
    EstimatorRow {
        name: "iekf",
        about: "iterated extended Kalman filter (Bell and Cathey 1993)",
        class: MethodClass::Recursive,
        sensor_model: None,
        defaults: defaults::<gaussian::Config<iterated::Iterated>>,
        build: gaussian::build::<iterated::Iterated>,
    },
    EstimatorRow {
        name: "ukf",
        about: "unscented Kalman filter (Julier and Uhlmann 2004)",
        class: MethodClass::Recursive,
        sensor_model: None,
        defaults: defaults::<gaussian::Config<unscented::Unscented>>,
        build: gaussian::build::<unscented::Unscented>,
    },
    EstimatorRow {
        name: "particle",
        about: "particle filter whose proposal depends on the reading",
        class: MethodClass::Recursive,
        sensor_model: None,
        defaults: defaults::<particle::Config>,
        build: particle::build,
    },
    EstimatorRow {
        name: "imm",
        about: "interacting multiple models: static, sliding or lost (Blom and Bar-Shalom 1988)",
        class: MethodClass::Recursive,
        sensor_model: None,
        defaults: defaults::<imm::Config>,
        build: imm::build,
    },
    EstimatorRow {
        name: "smoother",
        about: "fixed-interval smoother after the iterated filter (Rauch, Tung and Striebel 1965)",
        class: MethodClass::Hindsight,
        sensor_model: None,
        defaults: defaults::<smoother::Config>,
        build: smoother::build,
    },
    EstimatorRow {
        name: "batch",
        about: "most probable trajectory given the whole contact, by Gauss-Newton (Bell 1994)",
        class: MethodClass::Hindsight,
        sensor_model: None,
        defaults: defaults::<batch::Config>,
        build: batch::build,
    },
    EstimatorRow {
        name: "smoother-sliding",
        about: "`smoother` for round objects of any size",
        class: MethodClass::Hindsight,
        sensor_model: None,
        defaults: || to_json(&smoother::Config::sliding()),
        build: smoother::build,
    },
    EstimatorRow {
        name: "batch-sliding",
        about: "`batch` for round objects of any size",
        class: MethodClass::Hindsight,
        sensor_model: None,
        defaults: || to_json(&batch::Config::sliding()),
        build: batch::build,
    },
    EstimatorRow {
        name: "batch-recommended",
        about: "Bayesian average of `batch` (thin objects), `batch-sliding` (round ones) and `outline-batch` (others)",
        class: MethodClass::Hindsight,
        sensor_model: None,
        defaults: || to_json(&model_averaging::Config::hindsight()),
        build: model_averaging::build_hindsight,
    },
    EstimatorRow {
        name: "outline",
        about: "the object's convex outline as the state, kept from one stroke to the next",
        class: MethodClass::Recursive,
        sensor_model: None,
        defaults: defaults::<outline::Config>,
        build: outline::build_recursive,
    },
    EstimatorRow {
        name: "outline-batch",
        about: "the object's convex outline given the whole contact, by robust Gauss-Newton",
        class: MethodClass::Hindsight,
        sensor_model: None,
        defaults: defaults::<outline::Config>,
        build: outline::build_hindsight,
    },
    EstimatorRow {
        name: "euler-bernoulli",
        about: "slip along an analytic cantilever on the compliant root (Solomon and Hartmann 2010)",
        class: MethodClass::Baseline,
        sensor_model: None,
        defaults: defaults::<euler_bernoulli::Config>,
        build: euler_bernoulli::build_analytic,
    },
    EstimatorRow {
        name: "euler-bernoulli-calibrated",
        about: "`euler-bernoulli` with moment and slope from the calibrated map (as in Lin et al. 2022)",
        class: MethodClass::Baseline,
        sensor_model: None,
        defaults: defaults::<euler_bernoulli::Config>,
        build: euler_bernoulli::build_calibrated,
    },
    EstimatorRow {
        name: "paper-ekf",
        about: "extended Kalman filter as published (Lin et al. 2022)",
        class: MethodClass::Published,
        sensor_model: Some(paper::SENSOR_MODEL),
        defaults: defaults::<paper::Config<extended::Extended>>,
        build: paper::build::<extended::Extended>,
    },
    EstimatorRow {
        name: "paper-ukf",
        about: "unscented Kalman filter as published (Lin et al. 2022)",
        class: MethodClass::Published,
        sensor_model: Some(paper::SENSOR_MODEL),
        defaults: defaults::<paper::Config<unscented::Unscented>>,
        build: paper::build::<unscented::Unscented>,
    },
    EstimatorRow {
        name: "paper-particle",
        about: "particle filter as published (Lin et al. 2022)",
        class: MethodClass::Published,
        sensor_model: Some(paper::SENSOR_MODEL),
        defaults: defaults::<paper::ParticleConfig>,
        build: paper::build_particle,
    },
];

/// The registry's row of this name.
pub fn estimator(name: &str) -> Option<&'static EstimatorRow> {
    ESTIMATORS.iter().find(|row| row.name == name)
}

fn defaults<Config: Default + Serialize>() -> Value {
    to_json(&Config::default())
}

fn to_json(config: &impl Serialize) -> Value {
    serde_json::to_value(config).expect("settings serialise")
}

#[cfg(test)]
mod tests {
    use std::sync::Mutex;

    use nalgebra::Matrix2;

    use super::*;

    /// A method whose contact moves away from the root by a fixed distance per sample.
    struct Receding {
        step_m: f64,
    }

    struct Recedes {
        side: side::Side,
        at_m: f64,
        step_m: f64,
    }

    impl Method for Receding {
        fn begin(&self, touch: &Touch<'_>) -> Box<dyn Tracker> {
            Box::new(Recedes {
                side: side::Side::new(touch.face, &testing::knowledge()),
                at_m: 0.0,
                step_m: self.step_m,
            })
        }
    }

    impl Tracker for Recedes {
        fn step(&mut self, _: &Sample) -> Option<Estimate> {
            self.at_m += self.step_m;
            Some(self.side.estimate_at(Point::new(self.at_m, 0.0), false, Matrix2::identity(), None))
        }
    }

    #[test]
    fn robust_contacts_beyond_the_reach_of_the_whisker_are_not_stated() {
        let knowledge = Arc::new(testing::knowledge());
        let length_m = knowledge.rest.length_m();
        let sample = Sample { motion: Pose::new(0.0, 0.0, 0.0), dt_s: 4e-3, reading_n_m: 1e-5 };
        let stated = |step_m: f64| {
            let mut runner = Runner::new(Box::new(Receding { step_m }), knowledge.clone(), 1);
            [0; 5].map(|_| runner.step(&sample, Some(Face::Left)).is_some())
        };
        assert_eq!(stated(0.45 * length_m), [true, true, true, false, false]);
        assert_eq!(stated(f64::NAN), [false; 5]);
    }

    /// A method that records the time before each touch, and keeps its tracker.
    struct Waiting(Arc<Mutex<Vec<f64>>>);

    impl Method for Waiting {
        fn begin(&self, touch: &Touch<'_>) -> Box<dyn Tracker> {
            self.0.lock().unwrap().push(touch.free_s);
            Box::new(Waits(self.0.clone()))
        }
    }

    struct Waits(Arc<Mutex<Vec<f64>>>);

    impl Tracker for Waits {
        fn step(&mut self, _: &Sample) -> Option<Estimate> {
            None
        }

        fn resume(&mut self, touch: &Touch<'_>) -> bool {
            self.0.lock().unwrap().push(touch.free_s);
            true
        }
    }

    #[test]
    fn verif_the_time_before_a_touch_is_that_of_all_samples() {
        let knowledge = Arc::new(testing::knowledge());
        let waited_s = Arc::new(Mutex::new(Vec::new()));
        let mut runner = Runner::new(Box::new(Waiting(waited_s.clone())), knowledge, 1);
        let sample = Sample { motion: Pose::new(0.0, 0.0, 0.0), dt_s: 0.25, reading_n_m: 1e-5 };
        // More than the history holds.
        for free in [10, 20 * HISTORY] {
            (0..free).for_each(|_| assert!(runner.step(&sample, None).is_none()));
            (0..3).for_each(|_| assert!(runner.step(&sample, Some(Face::Left)).is_none()));
        }
        assert_eq!(*waited_s.lock().unwrap(), [2.5, 5.0 * HISTORY as f64]);
    }

    /// A method that expects a touch a second after a release.
    struct Expecting;

    struct Expects(side::Side);

    impl Method for Expecting {
        fn begin(&self, touch: &Touch<'_>) -> Box<dyn Tracker> {
            Box::new(Expects(side::Side::new(touch.face, &testing::knowledge())))
        }
    }

    impl Tracker for Expects {
        fn step(&mut self, _: &Sample) -> Option<Estimate> {
            None
        }

        fn expect_touch(&mut self, undetected: &Undetected) -> Option<Estimate> {
            let Undetected { base, free_s, .. } = undetected;
            let at = Point::new(0.05, base.origin().y());
            (*free_s >= 1.0).then(|| self.0.estimate_at(at, true, Matrix2::identity() * 1e-8, None))
        }
    }

    #[test]
    fn verif_a_contact_that_is_not_detected_may_be_expected_after_a_release() {
        let mut runner = Runner::new(Box::new(Expecting), Arc::new(testing::knowledge()), 1);
        let sample = Sample { motion: Pose::new(0.0, -1e-4, 0.0), dt_s: 0.25, reading_n_m: 1e-5 };
        let mut step = |touched| runner.step(&sample, touched).map(|estimate| estimate.contact.y());
        // Before the first touch no object is known.
        assert!((0..10).all(|_| step(None).is_none()) && step(Some(Face::Left)).is_none());
        let stated = [(); 5].map(|()| step(None));
        assert!(stated[..3].iter().all(Option::is_none));
        // After 15 samples, each of which moves the base by 0.1 mm.
        assert!((stated[3].unwrap() - 15e-4).abs() < 1e-12 && stated[4].is_some(), "{stated:?}");
        assert!(step(Some(Face::Left)).is_none() && step(None).is_none());
    }
}
