//! The outline as an estimator whose estimates depend on the samples so far.

use std::sync::Arc;

use filters::Gaussian;
use nalgebra::{Vector1, Vector2};

use super::Config;
use super::object::{FirstArc, Object};
use super::readings::{Reading, Readings};
use super::search::{Effort, Haste};
use crate::estimators::doubt::Doubt;
use crate::estimators::extended::Extended;
use crate::estimators::gaussian::{self, Follower};
use crate::estimators::inertia::Inertia;
use crate::estimators::motion::{Motion, Round};
use crate::estimators::side::Side;
use crate::estimators::{Ahead, Estimate, Knowledge, OutlinePoint, Sample, Touch, Tracker, Undetected};
use crate::frames::{Base, Pose, Start};
use crate::regained::Regained;
use crate::sensor::AlongAway;

/// Smallest number of samples of a touch before an outline begins, and the number after which it begins for any
/// variance.
const LEAST_SAMPLES: usize = 25;
const MOST_SAMPLES: usize = 250;

/// Range of the initial radius of a curve.
const FIRST_RADIUS_M: (f64, f64) = (1e-3, 50e-3);

/// Samples between two searches: at least this many, and this share of all samples so far, so that the time per sample
/// does not grow.
const LEAST_PAUSE: usize = 10;
const PAUSE_SHARE: usize = 10;

/// Shorter pauses, after which an outlier triggers the next search.
const LEAST_OUTLIER_PAUSE: usize = 5;
const OUTLIER_PAUSE_SHARE: usize = 100;

/// Standard deviation below which a contact that may be at the tip does not refute the object.
const SETTLED_SD_M: f64 = 3e-3;

/// Distance from the calibrated domain from which a reading is left out.
const FARTHEST_M: f64 = 0.5e-3;

/// Normalised innovation squared of an outlier.
const OUTLIER_NIS: f64 = 9.0;

/// Number of searches of which one is distant.
const FAR_EVERY: usize = 4;

/// The onset of a touch, until the object is identified.
#[derive(Default)]
struct Onset {
    readings: Readings,
    samples: usize,
    /// Log-likelihood of the readings under the known object less that under a new one.
    known_ahead: f64,
}

/// Schedule of the searches.
#[derive(Default)]
struct Pace {
    samples: usize,
    last: usize,
    searches: usize,
    has_outlier: bool,
}

impl Pace {
    /// The search after `count` more samples, which may be outliers. `None` if none is due or the last one goes on.
    fn next(&mut self, count: usize, is_outlier: bool, is_searching: bool) -> Option<(Effort, Haste)> {
        self.samples += count;
        self.has_outlier |= is_outlier;
        let pause = self.samples - self.last;
        let is_due = pause >= LEAST_PAUSE.max(self.samples / PAUSE_SHARE)
            || self.has_outlier && pause >= LEAST_OUTLIER_PAUSE + self.samples / OUTLIER_PAUSE_SHARE;
        (is_due && !is_searching).then(|| {
            self.searches += 1;
            let has_outlier = std::mem::take(&mut self.has_outlier);
            let is_far = has_outlier || self.searches.is_multiple_of(FAR_EVERY);
            self.last = self.samples;
            // The next search is due after about twice as many steps.
            let haste = if has_outlier { Haste::Urgent } else { Haste::Calm { steps: pause / 2 } };
            (if is_far { Effort::Far } else { Effort::Near }, haste)
        })
    }
}

/// Tracks contacts over the outline of one object, from touch to touch.
///
/// A touch begins with a bank of filters, until the position along the whisker is known well enough to begin a curve
/// there. After a lift-off both the known object and the bank predict the first readings, and their likelihoods decide
/// whether it is the same object.
pub(super) struct Tracer {
    config: Config,
    knowledge: Arc<Knowledge>,
    pub(super) base: Pose<Base, Start>,
    /// Filters of this touch, and the side of the whisker.
    front: Follower<Extended, Round, 4>,
    onset: Option<Onset>,
    object: Option<Object>,
    pace: Pace,
    doubt: Doubt,
    inertia: Inertia,
    /// Whether readings have contradicted a convex outline of the present object.
    is_refuted: bool,
    /// Belief of the filters at the last sample, if it was one of the onset.
    at_onset: Option<Gaussian<4>>,
    /// Whether the whisker touches the object again after a release.
    regained: Regained,
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
            doubt: Doubt::default(),
            inertia: Inertia::new(&knowledge.whisker),
            is_refuted: false,
            at_onset: None,
            regained: Regained::default(),
        }
    }

    /// Takes a sample of the onset.
    fn begin(&mut self, sample: &Sample, count: f64, mut onset: Onset) -> Option<Estimate> {
        onset.samples += count as usize;
        let near_m = self.object.as_ref().map_or(0.0, Object::near_m);
        onset.readings.keep(Reading::new(self.base, sample.reading_n_m, near_m).of_mean(count));
        let advance = self.front.advance_mean(sample, count);
        self.at_onset = advance.as_ref().map(|advance| advance.filtered);
        let side = &self.front.side;
        let Some(object) = &mut self.object else {
            self.onset = Some(onset);
            let advance = advance?;
            if self.front.is_at_tip(&advance.filtered) {
                return None;
            }
            let estimate = side.estimate(self.front.motion.radius(), &advance.filtered, advance.innovation);
            let sd_m = advance.filtered.covariance[(0, 0)].sqrt();
            let Some(onset) = self.onset.take_if(|onset| {
                onset.samples >= LEAST_SAMPLES && sd_m < self.config.start_sd_m || onset.samples >= MOST_SAMPLES
            }) else {
                return Some(estimate);
            };
            let (at, radius_m) = (AlongAway::of_state(&advance.filtered.mean), advance.filtered.mean[2]);
            let point = self.base.apply(side.face.contact_at(at));
            let tangent_rad = self.base.yaw_rad() + side.tangent_rad(at).0;
            let radius_m = radius_m.clamp(FIRST_RADIUS_M.0, FIRST_RADIUS_M.1);
            let arc = FirstArc { point, tangent_rad, radius_m };
            self.object = Some(Object::new(self.config, side, arc, onset.readings));
            self.pace = Pace { samples: onset.samples, last: onset.samples, ..Pace::default() };
            return Some(estimate);
        };
        // An object out of reach predicts a whisker that stays free.
        let expected = object.expect(side, &self.base, sample.reading_n_m, count);
        let known = expected.as_ref().and_then(|expected| expected.innovation);
        let new = advance.as_ref().and_then(|advance| advance.innovation);
        if let Some(new) = new {
            onset.known_ahead += known.map_or(-f64::INFINITY, |known| known.log_likelihood()) - new.log_likelihood();
        }
        let known = expected.filter(|_| onset.known_ahead >= 0.0);
        let estimate = match (&known, &advance) {
            (Some(expected), _) => Some(object.estimate(side, &self.base, expected)),
            (None, Some(advance)) if !self.front.is_at_tip(&advance.filtered) => {
                Some(side.estimate(self.front.motion.radius(), &advance.filtered, advance.innovation))
            }
            (None, _) => None,
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
                onset.readings.means().iter().for_each(|reading| object.keep(*reading));
                object.begin_search(Effort::Far, Haste::Urgent);
            }
            known => {
                if known.take().is_some() {
                    self.is_refuted = false;
                }
                self.onset = Some(onset);
            }
        }
    }

    /// The side and the object of a touch at its end. `None` if the object was not identified before. A brief touch
    /// that does not fit does not discard the known object: it may have been that of another.
    pub(super) fn concluded(&mut self) -> Option<(&Side, &mut Object)> {
        if let Some(onset) = self.onset.take_if(|onset| onset.known_ahead >= 0.0) {
            self.settle(onset);
        }
        if self.onset.is_some() {
            return None;
        }
        Some((&self.front.side, self.object.as_mut()?))
    }

    /// Takes a sample of the known object.
    fn go_on(&mut self, sample: &Sample, count: f64) -> Option<Estimate> {
        let side = &self.front.side;
        let object = self.object.as_mut()?;
        let expected = object.expect(side, &self.base, sample.reading_n_m, count);
        let estimate = expected.as_ref().map(|expected| object.estimate(side, &self.base, expected));
        // The reading of a contact at the tip has another meaning.
        if expected.as_ref().is_some_and(|expected| side.is_tip(expected.at())) {
            return None;
        }
        let inertia_n_m = match &expected {
            Some(expected) if side.base_noise.is_none() => self.inertia.moment_n_m(side, expected.at()),
            _ => 0.0,
        };
        let nis = expected
            .as_ref()
            .and_then(|expected| expected.innovation)
            .map_or(f64::INFINITY, |innovation| innovation.nis);
        let is_outlier = nis > OUTLIER_NIS;
        if expected.as_ref().is_none_or(|expected| side.distance_outside_m(expected.at()) < FARTHEST_M) {
            let reading = Reading::new(self.base, sample.reading_n_m - inertia_n_m, object.near_m()).of_mean(count);
            object.keep(reading.outlier(is_outlier));
        }
        if is_outlier {
            object.hurry();
        }
        if let Some((effort, haste)) = self.pace.next(count as usize, is_outlier, object.is_searching()) {
            object.begin_search(effort, haste);
        }
        let sd_m = estimate.as_ref().and_then(|estimate| estimate.covariance_m2).map_or(0.0, |p| p.trace().sqrt());
        if sd_m < SETTLED_SD_M && estimate.as_ref().is_some_and(|estimate| self.knowledge.may_be_tip(estimate)) {
            return estimate;
        }
        let bounded = nis.min(self.config.gate_sds.powi(2));
        if self.config.search.is_on() && self.doubt.next(&self.config.search, sample.dt_s, bounded) {
            self.give_up();
        }
        estimate
    }

    /// Discards the known object, which the readings refute.
    fn give_up(&mut self) {
        let face = self.front.side.face.clone();
        let touch = Touch { face: &face, history: &[], free_s: 0.0, before: self.base, contact_prior: None, seed: 0 };
        self.front = front(&touch, &self.knowledge);
        self.is_refuted = true;
        self.object = None;
        self.onset = Some(Onset::default());
        self.pace = Pace::default();
    }
}

/// The bank of filters with which a touch begins.
fn front(touch: &Touch<'_>, knowledge: &Knowledge) -> Follower<Extended, Round, 4> {
    let config = gaussian::Config { return_rate: 0.0, ..gaussian::Config::round() };
    Follower::new(config, Round::of_any_scale().beyond_pin(touch.face), touch, knowledge)
}

impl Tracker for Tracer {
    fn step(&mut self, sample: &Sample) -> Option<Estimate> {
        self.step_mean(sample, 1.0)
    }

    fn work(&mut self) {
        if let Some(object) = &mut self.object {
            object.advance(&self.front.side);
        }
    }

    fn look_ahead(&self, sample: &Sample) -> Ahead {
        if let Some(belief) = &self.at_onset {
            return self.front.look_ahead_from(belief, sample);
        }
        let Some(object) = &self.object else { return Ahead::default() };
        let (side, base) = (&self.front.side, sample.motion.inverse().then(&self.base));
        let Some(expected) = object.expect(side, &base, sample.reading_n_m, 1.0) else { return Ahead::default() };
        let slip_m = object
            .contact(side, &self.base)
            .map_or_else(Vector2::zeros, |before| expected.point().vector() - sample.motion.apply(before).vector());
        Ahead { slip_m, nis: expected.innovation.map(|innovation| innovation.nis) }
    }

    fn step_mean(&mut self, sample: &Sample, count: f64) -> Option<Estimate> {
        self.base = sample.motion.inverse().then(&self.base);
        self.inertia.advance(sample);
        self.work();
        self.at_onset = None;
        match self.onset.take() {
            Some(onset) => self.begin(sample, count, onset),
            None => self.go_on(sample, count),
        }
    }

    fn expect_touch(&mut self, undetected: &Undetected) -> Option<Estimate> {
        let (side, base) = (&self.front.side, undetected.base);
        let Some(object) = self.object.as_mut() else { return self.front.expect_touch(undetected) };
        let expected = object.expect(side, &base, undetected.reading_n_m, 1.0);
        let on_side = expected.filter(|expected| side.is_beside(expected.at()));
        let innovation = on_side.as_ref().and_then(|expected| expected.innovation);
        let unknown = side.unknown(self.knowledge.noise_sd_n_m.powi(2));
        let reading = Vector1::new(undetected.reading_n_m);
        let is_regained = self.regained.next(undetected.dt_s, &reading, innovation.as_ref(), &unknown);
        let estimate = on_side.filter(|_| is_regained).map(|expected| object.estimate(side, &base, &expected))?;
        Some(Estimate { innovation: None, ..estimate })
    }

    /// Readings that have contradicted a convex outline do so after a release too, even if no outline was fitted since.
    fn resume(&mut self, touch: &Touch<'_>) -> bool {
        if touch.face.face != self.front.side.face.face {
            return false;
        }
        self.concluded();
        self.base = touch.before;
        self.front = front(touch, &self.knowledge);
        self.onset = Some(Onset::default());
        self.doubt = Doubt::default();
        self.regained = Regained::default();
        self.inertia = Inertia::new(&self.front.side.whisker);
        true
    }

    fn follows_as(&self) -> Option<&'static str> {
        self.object.is_none().then_some("round")
    }

    fn refutes_convexity(&self) -> bool {
        self.is_refuted
    }

    fn outline(&self) -> Option<Vec<OutlinePoint>> {
        let whisker = &self.knowledge.whisker;
        let wire_radius_m = 0.25 * (whisker.root_diameter_m + whisker.tip_diameter_m);
        Some(self.object.as_ref()?.outline(wire_radius_m))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn verif_a_search_is_urgent_after_an_outlier_even_one_during_the_search_before() {
        let mut pace = Pace::default();
        let calm: Vec<_> = (0..LEAST_PAUSE).map(|_| pace.next(1, false, false)).collect();
        assert!(calm[..LEAST_PAUSE - 1].iter().all(Option::is_none));
        assert_eq!(calm[LEAST_PAUSE - 1], Some((Effort::Near, Haste::Calm { steps: LEAST_PAUSE / 2 })));
        // As long as that search goes on, none begins.
        assert_eq!(pace.next(1, true, true), None);
        assert!((0..100).all(|_| pace.next(1, false, true).is_none()));
        assert_eq!(pace.next(1, false, false), Some((Effort::Far, Haste::Urgent)));
        assert_eq!(pace.next(1, false, false), None);
    }
}
