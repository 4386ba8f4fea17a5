//! The outline while the samples come in.

use std::sync::Arc;

use super::Config;
use super::object::{Effort, Object};
use super::readings::{Reading, keep};
use crate::estimators::extended::Extended;
use crate::estimators::gaussian::{self, Follower};
use crate::estimators::motion::{Motion, Round};
use crate::estimators::side::Side;
use crate::estimators::{Estimate, Knowledge, OutlinePoint, Sample, Touch, Tracker};
use crate::frames::{Base, Pose, Start};

/// Samples of a touch before an outline is thought of, and after which one is, however unsure the place.
const LEAST_SAMPLES: usize = 25;
const MOST_SAMPLES: usize = 250;

/// Range of the radius with which a curve begins.
const FIRST_RADIUS_M: (f64, f64) = (1e-3, 50e-3);

/// Samples from one search to the next: at least so many, and this share of all so far, so that the time per sample does not grow.
const LEAST_PAUSE: usize = 10;
const PAUSE_SHARE: usize = 10;

/// A pause after which a surprise brings the next search forward; shorter than the other.
const LEAST_SURPRISED_PAUSE: usize = 5;
const SURPRISED_PAUSE_SHARE: usize = 100;

/// Normalised innovation squared that is a surprise.
const SURPRISE: f64 = 9.0;

/// Every so manieth search goes far.
const FAR_EVERY: usize = 4;

/// A touch of which it is not known yet what is touched.
#[derive(Default)]
struct Onset {
    readings: Vec<Reading>,
    samples: usize,
    /// By how much the known object foretold the readings better than a new one, in the logarithm of the likelihood.
    known_ahead: f64,
}

/// When to search anew.
#[derive(Default)]
struct Pace {
    samples: usize,
    last: usize,
    searches: usize,
    is_surprised: bool,
}

impl Pace {
    /// What to do after one more sample, which may have been a surprise.
    fn next(&mut self, is_surprise: bool) -> Option<Effort> {
        self.samples += 1;
        self.is_surprised |= is_surprise;
        let pause = self.samples - self.last;
        let is_due = pause >= LEAST_PAUSE.max(self.samples / PAUSE_SHARE)
            || self.is_surprised && pause >= LEAST_SURPRISED_PAUSE + self.samples / SURPRISED_PAUSE_SHARE;
        is_due.then(|| {
            self.searches += 1;
            let is_far = std::mem::take(&mut self.is_surprised) || self.searches.is_multiple_of(FAR_EVERY);
            self.last = self.samples;
            if is_far { Effort::Far } else { Effort::Near }
        })
    }
}

/// Follows contacts over the outline of one object, from touch to touch.
///
/// A touch begins with a bank of filters, until the place along the whisker is known well enough to begin a curve there. After a lift-off the
/// known object and the bank both foretell the first readings, and the evidence tells whether it is the same object.
pub(super) struct Tracer {
    config: Config,
    knowledge: Arc<Knowledge>,
    pub(super) base: Pose<Base, Start>,
    /// The filters of this touch, and the side of the whisker.
    front: Follower<Extended, Round, 4>,
    onset: Option<Onset>,
    object: Option<Object>,
    pace: Pace,
}

impl Tracer {
    pub(super) fn new(config: Config, touch: &Touch<'_>, knowledge: &Arc<Knowledge>) -> Self {
        Self {
            config,
            knowledge: knowledge.clone(),
            base: touch.before,
            front: front(touch, knowledge),
            onset: Some(Onset::default()),
            object: None,
            pace: Pace::default(),
        }
    }

    /// A sample of which it is not known yet what is touched.
    fn begin(&mut self, sample: &Sample, mut onset: Onset) -> Option<Estimate> {
        onset.samples += 1;
        let near_m = self.object.as_ref().map_or(0.0, Object::near_m);
        keep(&mut onset.readings, Reading::new(self.base, sample.reading_n_m, near_m));
        let advance = self.front.advance(sample);
        let side = &self.front.side;
        let Some(object) = &mut self.object else {
            self.onset = Some(onset);
            let advance = advance?;
            let estimate = side.estimate(self.front.motion.radius(), &advance.filtered, advance.innovation);
            let sd_m = advance.filtered.covariance[(0, 0)].sqrt();
            let Some(onset) = self.onset.take_if(|onset| {
                onset.samples >= LEAST_SAMPLES && sd_m < self.config.start_sd_m || onset.samples >= MOST_SAMPLES
            }) else {
                return Some(estimate);
            };
            let [along_m, away_m, radius_m, _] = advance.filtered.mean.into();
            let point = self.base.apply(side.face.contact_at(along_m, away_m));
            let tangent_rad = self.base.yaw_rad() + side.tangent_rad(along_m, away_m).0;
            let start = (point, tangent_rad, radius_m.clamp(FIRST_RADIUS_M.0, FIRST_RADIUS_M.1));
            self.object = Some(Object::new(self.config, side, start, onset.readings));
            self.pace = Pace { samples: onset.samples, last: onset.samples, ..Pace::default() };
            return Some(estimate);
        };
        // What cannot be touched from here has foretold a whisker that stays free.
        let expected = object.expect(side, &self.base, sample.reading_n_m);
        let known = expected.as_ref().and_then(|expected| expected.innovation);
        let new = advance.as_ref().and_then(|advance| advance.innovation);
        if let Some(new) = new {
            onset.known_ahead += known.map_or(-f64::INFINITY, |known| known.log_likelihood()) - new.log_likelihood();
        }
        let known = expected.filter(|_| onset.known_ahead >= 0.0);
        let estimate = match (&known, &advance) {
            (Some(expected), _) => Some(object.estimate(side, &self.base, expected)),
            (None, Some(advance)) => {
                Some(side.estimate(self.front.motion.radius(), &advance.filtered, advance.innovation))
            }
            (None, None) => None,
        };
        if onset.samples < LEAST_SAMPLES {
            self.onset = Some(onset);
        } else {
            self.settle(onset);
        }
        estimate
    }

    /// Decides which object is touched.
    fn settle(&mut self, onset: Onset) {
        match &mut self.object {
            Some(object) if onset.known_ahead >= 0.0 => {
                onset.readings.into_iter().for_each(|reading| object.keep(reading));
                object.refine(&self.front.side, Effort::Far);
            }
            _ => {
                self.object = None;
                self.onset = Some(onset);
            }
        }
    }

    /// The side and the object that was touched, at the end of a touch; nothing where it was not told before the end. What is known of an object
    /// outlives a brief touch that does not fit it: it may have been another's, or nobody's.
    pub(super) fn concluded(&mut self) -> Option<(&Side, &mut Object)> {
        if let Some(onset) = self.onset.take_if(|onset| onset.known_ahead >= 0.0) {
            self.settle(onset);
        }
        if self.onset.is_some() {
            return None;
        }
        Some((&self.front.side, self.object.as_mut()?))
    }

    /// A sample of the known object.
    fn go_on(&mut self, sample: &Sample) -> Option<Estimate> {
        let side = &self.front.side;
        let object = self.object.as_mut()?;
        let expected = object.expect(side, &self.base, sample.reading_n_m);
        let estimate = expected.as_ref().map(|expected| object.estimate(side, &self.base, expected));
        object.keep(Reading::new(self.base, sample.reading_n_m, object.near_m()));
        let nis = expected.and_then(|expected| expected.innovation).map_or(f64::INFINITY, |innovation| innovation.nis);
        if let Some(effort) = self.pace.next(nis > SURPRISE) {
            object.refine(side, effort);
        }
        estimate
    }
}

/// The bank with which a touch begins.
fn front(touch: &Touch<'_>, knowledge: &Knowledge) -> Follower<Extended, Round, 4> {
    Follower::new(gaussian::Config::sliding(), Round::of_any_size(), touch, knowledge)
}

impl Tracker for Tracer {
    fn step(&mut self, sample: &Sample) -> Option<Estimate> {
        self.base = sample.motion.inverse().then(&self.base);
        match self.onset.take() {
            Some(onset) => self.begin(sample, onset),
            None => self.go_on(sample),
        }
    }

    fn resume(&mut self, touch: &Touch<'_>) -> bool {
        if touch.face.face != self.front.side.face.face || self.object.is_none() {
            return false;
        }
        self.concluded();
        self.base = touch.before;
        self.front = front(touch, &self.knowledge);
        self.onset = Some(Onset::default());
        true
    }

    fn outline(&self) -> Option<Vec<OutlinePoint>> {
        let whisker = &self.knowledge.whisker;
        let wire_radius_m = 0.25 * (whisker.root_diameter_m + whisker.tip_diameter_m);
        Some(self.object.as_ref()?.outline(wire_radius_m))
    }
}
