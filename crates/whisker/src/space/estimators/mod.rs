//! Estimators of the contact in space.
//!
//! The input is a sequence of [`Sample`]s: the motion of the base between two instants and both bending moments. An
//! [`Estimator`] detects contact in either moment ([`crate::events`]) and follows it from touch to release. The kinds of
//! methods are:
//!
//! - a filter (`follower.rs`): a bank of Gaussian hypotheses ([`filters::Bank`]) along the whisker,
//! - a particle filter (`particle.rs`),
//! - the unscented Kalman filter of Lin et al. 2024 (`paper.rs`),
//! - a fit (`fit/`) of an object to all readings,
//! - an average (`model_averaging.rs`) over fits, weighted by their evidence; in hindsight, from all readings of a touch.
//!
//! Filters, particle filters and fits share the models of the contact's motion (`motion/`): a fixed point, a straight edge or rod
//! of unknown direction, a cone, a sphere, or a surface of two principal curvatures.
//!
//! To add an estimator: one row in [`SPATIAL_ESTIMATORS`]; a new model of motion is one file beside `motion/line.rs` and a variant
//! of `MotionSettings`.

mod fit;
mod follower;
mod model_averaging;
mod motion;
mod mounted;
mod paper;
mod particle;
mod ringing;
mod side;
mod start;
mod stay;

use std::sync::Arc;

use filters::Innovation;
use nalgebra::{Matrix3, Vector2, Vector3};
use serde_json::Value;

use super::frames::{Point, Pose};
use super::sensor::CalibratedSpace;
use crate::ReadingGate;
pub use crate::estimators::{MethodClass, ModelShares, Radius};
use crate::events::{ContactDetector, Sensing, TouchConfig};
use crate::frames::Base;
use crate::settings::{SettingsError, parse};
use follower::Tracker;
use motion::MotionSettings;

/// One sample: the motion since the last instant, and the readings.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sample {
    /// Pose of the base's frame at the last instant in its present frame.
    pub motion: Pose<Base, Base>,
    /// Time since the last instant.
    pub dt_s: f64,
    /// Bending moments about y and z of Base (N m), 2x1.
    pub reading_n_m: Vector2<f64>,
}

/// Estimate of the contact at one instant.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Estimate {
    /// Contact point on the centre line.
    pub contact: Point<Base>,
    /// Posterior covariance of the contact in Base (m2), 3x3.
    pub covariance_m2: Matrix3<f64>,
    /// Unit normal of the touched surface in Base, out of the object.
    pub normal: Vector3<f64>,
    /// Posterior covariance of the normal (rad2), 3x3, singular along the normal itself. Zero if an external program does not state
    /// it.
    pub normal_covariance: Matrix3<f64>,
    /// Direction of the edge or rod. `None` if the method does not estimate it.
    pub direction: Option<Direction>,
    /// Radius of a sphere, or of a rod across its axis, without that of the wire. `None` if the method does not estimate it.
    pub radius: Option<Radius>,
    /// Whether the contact lies within the calibrated domain.
    pub calibrated: bool,
    /// Innovation of the last update. `None` at the touch.
    pub innovation: Option<Innovation<2>>,
    /// Probabilities of the competing models of the method. `None` if it has one model only.
    pub models: Option<ModelShares>,
    /// Whether the readings contradict the models of the method, so that its covariance may be too small. `None` if the method
    /// does not judge them, as a filter of one model.
    pub model_doubtful: Option<bool>,
}

/// Estimated direction of an edge.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Direction {
    /// Unit vector along the edge in Base, of either sign.
    pub along: Vector3<f64>,
    /// Standard deviation of its angle in the tangent plane of the contact.
    pub sd_rad: f64,
}

/// Prior information available to an estimator.
#[derive(Clone, Debug)]
pub struct Knowledge {
    /// Calibrated sensor model.
    pub calibrated: Arc<CalibratedSpace>,
    /// Standard deviation of the measurement noise of each moment.
    pub noise_sd_n_m: f64,
    /// Sampling rate of the readings (Hz), for the filters of the contact detection.
    pub rate_hz: f64,
}

impl Knowledge {
    /// Parameters of the contact detection.
    fn sensing(&self) -> Sensing {
        let CalibratedSpace { whisker, largest_reading_n_m, .. } = &*self.calibrated;
        Sensing::new(&whisker.whisker, self.rate_hz, self.noise_sd_n_m, *largest_reading_n_m)
    }
}

/// Detects contact in either moment, and leaves out readings beyond the [`ReadingGate`].
pub struct TouchDetector {
    /// Detectors of both moments.
    detectors: [ContactDetector; 2],
    gate: ReadingGate,
    /// Motion and duration of the gated samples since the last admitted one.
    missed: Option<(Pose<Base, Base>, f64)>,
}

impl TouchDetector {
    /// The detector of a recording, before its first sample.
    pub fn new(config: TouchConfig, knowledge: &Knowledge) -> Self {
        let sensing = knowledge.sensing();
        Self {
            detectors: std::array::from_fn(|_| ContactDetector::new(config, &sensing)),
            gate: ReadingGate::new(knowledge.calibrated.largest_reading_n_m),
            missed: None,
        }
    }

    /// Takes the next sample in the order of time. Returns the sample and whether the whisker touches, `None` if its reading is
    /// gated. The rest reading is subtracted; motion and duration include those of the gated samples before it.
    pub fn step(&mut self, sample: &Sample) -> Option<(Sample, bool)> {
        let missed = self.missed.take();
        let (motion, dt_s) = missed.map_or((sample.motion, sample.dt_s), |(motion, duration_s)| {
            (motion.then(&sample.motion), duration_s + sample.dt_s)
        });
        if !self.gate.admits_both(&sample.reading_n_m) {
            self.missed = Some((motion, dt_s));
            return None;
        }
        let mut sample = Sample { motion, dt_s, reading_n_m: sample.reading_n_m };
        // The whisker may touch in one direction alone.
        let exceeds = |(detector, moment_n_m): (&ContactDetector, &f64)| detector.exceeds_rest(*moment_n_m);
        if self.detectors.iter().zip(sample.reading_n_m.iter()).any(exceeds) {
            self.detectors.iter_mut().for_each(ContactDetector::give_up_rest);
        }
        let mut touches = false;
        for (detector, moment_n_m) in self.detectors.iter_mut().zip(sample.reading_n_m.iter_mut()) {
            touches |= detector.step(*moment_n_m, dt_s).is_some();
            *moment_n_m -= detector.rest_reading_n_m();
        }
        Some((sample, touches))
    }

    /// Whether the whisker touched at the last sample.
    fn touches(&self) -> bool {
        self.detectors.iter().any(|detector| detector.signals().touched.is_some())
    }
}

/// Detects the contacts of a recording and estimates them, sample by sample.
pub struct Estimator {
    method: Box<dyn Method>,
    knowledge: Arc<Knowledge>,
    touch: TouchDetector,
    tracker: Option<Box<dyn Tracker>>,
    /// Whether the method revises the estimates of a touch when it has ended.
    looks_back: bool,
    /// For each sample since the touch, whether the method took it: not if its reading was gated. Empty while the whisker is free,
    /// and for causal methods.
    taken: Vec<bool>,
    /// Estimates of the taken samples of a touch that has ended.
    revised: Option<Vec<Option<Estimate>>>,
}

impl Estimator {
    /// Takes the next sample in the order of time. `None` while the whisker is free, and at a reading beyond the
    /// [`ReadingGate`], which counts as missing. While no contact is detected, a contact with a known object is stated if the
    /// reading shows it. Nothing is revised; see [`Estimator::push`].
    pub fn step(&mut self, sample: &Sample) -> Option<Estimate> {
        let estimate = self.advance(sample);
        self.revised = None;
        self.taken.clear();
        estimate
    }

    /// Takes the next sample.
    fn advance(&mut self, sample: &Sample) -> Option<Estimate> {
        let knowledge = self.knowledge.clone();
        match &knowledge.calibrated.mounting {
            Some(mounting) => {
                let estimate = self.step_as_calibrated(&mounted::corrected(mounting, sample))?;
                Some(mounted::stated(mounting, &estimate))
            }
            None => self.step_as_calibrated(sample),
        }
    }

    /// Appends the estimate of the next sample in the order of time. At the end of a touch, a hindsight method replaces the last
    /// estimates, those of the touch, wherever it has one; the innovations of the causal estimates are kept. All samples of a touch
    /// are passed to this function, and their estimates stay in `estimates` while [`Self::is_following`].
    pub fn push(&mut self, sample: &Sample, estimates: &mut Vec<Option<Estimate>>) {
        let estimate = self.advance(sample);
        self.revise(estimates);
        estimates.push(estimate);
    }

    /// Ends the recording. A hindsight method replaces the last estimates, those of the present touch, wherever it has one.
    pub fn end(&mut self, estimates: &mut [Option<Estimate>]) {
        self.revised = self.tracker.as_mut().and_then(|tracker| tracker.hindsight());
        self.revise(estimates);
        self.taken.clear();
    }

    /// Estimates of all samples of a recording; see [`Estimator::push`].
    pub fn run(&mut self, samples: &[Sample]) -> Vec<Option<Estimate>> {
        let mut estimates = Vec::with_capacity(samples.len());
        samples.iter().for_each(|sample| self.push(sample, &mut estimates));
        self.end(&mut estimates);
        estimates
    }

    /// See [`ContactDetector::keep_rest_reading`], of both moments.
    pub fn keep_rest_reading(&mut self, earlier: &Self) {
        for (detector, earlier) in self.touch.detectors.iter_mut().zip(&earlier.touch.detectors) {
            detector.keep_rest_reading(earlier);
        }
    }

    /// Whether a contact was detected at the last sample.
    pub fn touches(&self) -> bool {
        self.touch.touches()
    }

    /// Whether a touch is in progress whose estimates will be revised. Always false for causal methods.
    pub fn is_following(&self) -> bool {
        !self.taken.is_empty()
    }

    /// Replaces the estimates of a touch that has ended.
    fn revise(&mut self, estimates: &mut [Option<Estimate>]) {
        let Some(revised) = self.revised.take() else { return };
        let taken = std::mem::take(&mut self.taken);
        let mounting = self.knowledge.calibrated.mounting.as_ref();
        let of_taken = estimates.iter_mut().rev().zip(taken.into_iter().rev()).filter(|(_, is_taken)| *is_taken);
        for ((estimate, _), revised) in of_taken.zip(revised.into_iter().rev()) {
            let stated = |revised: Estimate| {
                let revised = mounting.map_or(revised, |mounting| mounted::stated(mounting, &revised));
                // That of a reading which the estimate did not include.
                Estimate { innovation: estimate.and_then(|so_far| so_far.innovation), ..revised }
            };
            *estimate = revised.map(stated).or(*estimate);
        }
    }

    /// Takes the next sample of a sensor that is mounted as in its calibration.
    fn step_as_calibrated(&mut self, sample: &Sample) -> Option<Estimate> {
        let Some((sample, touches)) = self.touch.step(sample) else {
            if self.is_following() {
                self.taken.push(false);
            }
            return None;
        };
        if !touches {
            if let Some(tracker) = &mut self.tracker {
                self.revised = tracker.hindsight();
                tracker.release(&sample);
            }
            if self.revised.is_none() {
                self.taken.clear();
            }
            return self.tracker.as_mut()?.expect_touch(&sample);
        }
        if self.looks_back {
            self.taken.push(true);
        }
        if self.tracker.is_none() {
            self.tracker = Some(self.method.begin(&self.knowledge));
        }
        self.tracker.as_mut()?.step(&sample)
    }
}

/// A method of estimation with its settings.
trait Method: Send + Sync {
    /// Begins to track the contacts of a recording, at the first touch.
    fn begin(&self, knowledge: &Arc<Knowledge>) -> Box<dyn Tracker>;
}

impl Method for follower::Config {
    fn begin(&self, knowledge: &Arc<Knowledge>) -> Box<dyn Tracker> {
        self.motion.begin(self, knowledge)
    }
}

impl Method for particle::Config {
    fn begin(&self, knowledge: &Arc<Knowledge>) -> Box<dyn Tracker> {
        self.motion.begin(self, knowledge)
    }
}

impl Method for paper::Config {
    fn begin(&self, knowledge: &Arc<Knowledge>) -> Box<dyn Tracker> {
        Box::new(paper::PaperUkf::new(self, knowledge))
    }
}

impl Method for fit::Config {
    fn begin(&self, knowledge: &Arc<Knowledge>) -> Box<dyn Tracker> {
        self.motion.fit(self, knowledge)
    }
}

/// Kind of a method, which has default settings and makes the method with given ones.
#[derive(Clone, Copy)]
enum Kind {
    /// Filter.
    Filter(fn() -> MotionSettings),
    /// Particle filter.
    Particles(fn() -> MotionSettings),
    /// Unscented Kalman filter of Lin et al. 2024.
    Paper,
    /// Fit to all readings of a touch.
    Fit(fn() -> MotionSettings),
    /// Average of other methods.
    Average,
    /// The same in hindsight, from all readings of a touch.
    Hindsight,
}

impl Kind {
    fn defaults(self) -> Value {
        let defaults = match self {
            Self::Filter(motion) => serde_json::to_value(follower::Config::new(motion())),
            Self::Particles(motion) => serde_json::to_value(particle::Config::new(motion())),
            Self::Paper => serde_json::to_value(paper::Config::default()),
            Self::Fit(motion) => serde_json::to_value(fit::Config::new(motion())),
            Self::Average | Self::Hindsight => serde_json::to_value(model_averaging::Config::default()),
        };
        defaults.expect("settings serialise")
    }

    fn method(self, config: &Value) -> Result<Box<dyn Method>, SettingsError> {
        Ok(match self {
            Self::Filter(_) => Box::new(parse::<follower::Config>(config)?),
            Self::Particles(_) => Box::new(parse::<particle::Config>(config)?),
            Self::Paper => Box::new(parse::<paper::Config>(config)?),
            Self::Fit(_) => Box::new(parse::<fit::Config>(config)?),
            Self::Average => Box::new(model_averaging::ModelAveraging::new(parse(config)?, false)?),
            Self::Hindsight => Box::new(model_averaging::ModelAveraging::new(parse(config)?, true)?),
        })
    }
}

/// A row of the registry of estimators in space.
pub struct SpatialEstimatorRow {
    /// Name.
    pub name: &'static str,
    /// One-line description.
    pub about: &'static str,
    kind: Kind,
}

/// The registry of estimators in space.
pub static SPATIAL_ESTIMATORS: &[SpatialEstimatorRow] = &[
    SpatialEstimatorRow {
        name: "recommended",
        about: "average, weighted by evidence, of fits of rods, cones, spheres, surfaces of two curvatures and, on real sensors, points",
        kind: Kind::Average,
    },
    SpatialEstimatorRow {
        name: "batch-recommended",
        about: "`recommended` in hindsight: when a touch has ended, its estimates are computed from all readings of the touch",
        kind: Kind::Hindsight,
    },
    SpatialEstimatorRow {
        name: "line",
        about: "iterated extended Kalman filter for a thin rod or an edge of unknown direction, along which the contact slides",
        kind: Kind::Filter(MotionSettings::line),
    },
    SpatialEstimatorRow {
        name: "point",
        about: "iterated extended Kalman filter for a contact at rest in the world",
        kind: Kind::Filter(MotionSettings::resting),
    },
    SpatialEstimatorRow {
        name: "cylinder",
        about: "`line` for round rods of any radius and direction",
        kind: Kind::Filter(MotionSettings::cylinder),
    },
    SpatialEstimatorRow {
        name: "sphere",
        about: "iterated extended Kalman filter for a contact that slides over a sphere of unknown radius",
        kind: Kind::Filter(MotionSettings::sphere),
    },
    SpatialEstimatorRow {
        name: "particle",
        about: "particle filter for a thin rod or an edge of unknown direction, along which the contact slides",
        kind: Kind::Particles(MotionSettings::line),
    },
    SpatialEstimatorRow {
        name: "paper-ukf-3d",
        about: "unscented Kalman filter of Lin et al. 2024 for a contact at rest, with constant noise and fading memory",
        kind: Kind::Paper,
    },
    SpatialEstimatorRow {
        name: "point-fit",
        about: "fit of a contact at rest, held by friction, to all readings",
        kind: Kind::Fit(MotionSettings::resting),
    },
    SpatialEstimatorRow {
        name: "line-fit",
        about: "fit of a thin rod or edge to all readings",
        kind: Kind::Fit(MotionSettings::line),
    },
    SpatialEstimatorRow {
        name: "cylinder-fit",
        about: "fit of a round rod of any radius to all readings",
        kind: Kind::Fit(MotionSettings::fitted_cylinder),
    },
    SpatialEstimatorRow {
        name: "cone-fit",
        about: "fit of a cone of any half angle and radius to all readings",
        kind: Kind::Fit(MotionSettings::cone),
    },
    SpatialEstimatorRow {
        name: "sphere-fit",
        about: "fit of a sphere of any radius to all readings",
        kind: Kind::Fit(MotionSettings::sphere),
    },
    SpatialEstimatorRow {
        name: "patch-fit",
        about: "fit of a surface of two principal curvatures to all readings",
        kind: Kind::Fit(MotionSettings::patch),
    },
];

impl SpatialEstimatorRow {
    /// Class of the method.
    pub fn class(&self) -> MethodClass {
        match self.kind {
            Kind::Hindsight => MethodClass::Hindsight,
            Kind::Paper => MethodClass::Published,
            Kind::Filter(_) | Kind::Particles(_) | Kind::Fit(_) | Kind::Average => MethodClass::Recursive,
        }
    }

    /// Default settings.
    pub fn defaults(&self) -> Value {
        self.kind.defaults()
    }

    /// An estimator with these settings.
    ///
    /// # Errors
    /// [`SettingsError`] if the settings are invalid.
    pub fn build(
        &self,
        config: &Value,
        touch: TouchConfig,
        knowledge: &Arc<Knowledge>,
    ) -> Result<Estimator, SettingsError> {
        // Tabulated here, so that no step has to.
        knowledge.calibrated.geometry();
        Ok(Estimator {
            method: self.kind.method(config)?,
            knowledge: knowledge.clone(),
            touch: TouchDetector::new(touch, knowledge),
            tracker: None,
            looks_back: self.class() == MethodClass::Hindsight,
            taken: Vec::new(),
            revised: None,
        })
    }
}

/// The registry's row of this name.
pub fn spatial_estimator(name: &str) -> Option<&'static SpatialEstimatorRow> {
    SPATIAL_ESTIMATORS.iter().find(|row| row.name == name)
}
