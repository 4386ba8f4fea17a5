//! Runs a method over a recording, touch by touch.

use std::collections::VecDeque;
use std::sync::Arc;

use super::{CarriedOutline, Estimate, Knowledge, Method, Sample, Touch, Tracker, Undetected};
use crate::ReadingGate;
use crate::events::{ContactDetector, Signals, TouchConfig};
use crate::frames::{Base, Pose, Start};
use crate::sensor::Face;

/// Largest distance of a stated contact from the root in lengths of the whisker. Beyond one it is an error; the margin
/// leaves the error of an estimate near the tip visible.
const MOST_REACH: f64 = 1.5;

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

    /// An admitted sample with the motion and duration of the gated ones before it. It turns by the shorter way, since measured
    /// yaws may be wrapped.
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

    /// See [`ContactDetector::keep_rest_reading`].
    pub fn keep_rest_reading(&mut self, earlier: &Self) {
        self.detector.keep_rest_reading(&earlier.detector);
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

#[cfg(test)]
mod tests {
    use std::sync::Mutex;

    use nalgebra::Matrix2;

    use super::*;
    use crate::estimators::side::Side;
    use crate::estimators::testing;
    use crate::frames::Point;

    /// A method whose contact moves away from the root by a fixed distance per sample.
    struct Receding {
        step_m: f64,
    }

    struct Recedes {
        side: Side,
        at_m: f64,
        step_m: f64,
    }

    impl Method for Receding {
        fn begin(&self, touch: &Touch<'_>) -> Box<dyn Tracker> {
            Box::new(Recedes { side: Side::new(touch.face, &testing::knowledge()), at_m: 0.0, step_m: self.step_m })
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

    struct Expects(Side);

    impl Method for Expecting {
        fn begin(&self, touch: &Touch<'_>) -> Box<dyn Tracker> {
            Box::new(Expects(Side::new(touch.face, &testing::knowledge())))
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
