//! Estimator of one whisker on a stream.

use std::sync::Arc;

use nalgebra::Vector2;
use trace::SpatialPose;
use whisker::estimators::{Estimate, Estimator, Knowledge, OutlinePoint};
use whisker::frames::{Base, Pose, World};
use whisker::space;

use crate::clock::Jump;
use crate::counters::Counters;
use crate::event::{Event, MOST_RATE_RAD_S, MOST_SPEED_M_S, Stream};
use crate::frozen::{Freezing, FrozenRun};
use crate::kind::{Kind, Planar, Spatial, Way};
use crate::matching::{Admitted, Arrived, Matching};
use crate::motion::{Motion, Place};
use crate::poses::{Poses, SpatialPoses};
use crate::samples::Lack;
use crate::timing::Timing;

/// Shortest interval in which the speed of the base is tested (s).
const INTERVAL_S: f64 = 0.02;

/// Number of intervals with an implausible speed that are an event: a single wrong pose ends two.
const FAST_INTERVALS: u64 = 3;

/// Builds the estimator at the start and after a jump of a clock.
pub type Build = Box<dyn Fn() -> anyhow::Result<Estimator> + Send>;

/// The same in space.
pub type SpatialBuild = Box<dyn Fn() -> anyhow::Result<space::estimators::Estimator> + Send>;

/// Fate of a reading.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Status {
    /// It was given to the estimator.
    Used,
    /// It was given to the estimator, which left it out: it exceeds the largest plausible reading.
    Gated,
    /// It equals the readings before, although the touched whisker moves: the sensor or its driver has stopped. It was left out.
    Frozen,
    /// It has no pose: none arrived in time, or there is too long a gap between the poses.
    Stale,
    /// Its pose lies outside the plane of the estimator.
    OffPlane,
    /// It arrived after a later reading had been used; or it is not in order, or its clock or that of the poses has jumped, and it
    /// lies farther behind the newest pose than the smallest jump of a clock.
    Late,
    /// Its time had arrived before.
    Repeated,
    /// It, or its time, is not finite.
    NotFinite,
    /// The clock jumped and the estimator restarted while it waited for its pose.
    Dropped,
}

impl Status {
    /// Name as used in files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Used => "used",
            Self::Gated => "gated",
            Self::Frozen => "frozen",
            Self::Stale => "stale",
            Self::OffPlane => "off plane",
            Self::Late => "late",
            Self::Repeated => "repeated",
            Self::NotFinite => "not finite",
            Self::Dropped => "dropped",
        }
    }
}

/// Answer to a reading.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Answer<R = f64, P = Pose<Base, World>, E = Estimate> {
    /// Time of the reading.
    pub t_s: f64,
    /// Arrival of the reading.
    pub arrived_s: f64,
    /// The reading.
    pub reading_n_m: R,
    /// Its fate.
    pub status: Status,
    /// Pose of the base at its time. `None` unless it was used or gated.
    pub base: Option<P>,
    /// Estimate of the contact. `None` while the whisker is free or the method has no estimate.
    pub estimate: Option<E>,
}

/// Answer to both readings of an instant in space.
pub type SpatialAnswer = Answer<Vector2<f64>, SpatialPose, space::estimators::Estimate>;

/// Answers and events in the order in which they came about.
#[derive(Clone, Debug)]
pub struct Output<R = f64, P = Pose<Base, World>, E = Estimate> {
    /// One answer to each reading.
    pub answers: Vec<Answer<R, P, E>>,
    /// Events.
    pub events: Vec<Event>,
}

impl<R, P, E> Default for Output<R, P, E> {
    fn default() -> Self {
        Self { answers: Vec::new(), events: Vec::new() }
    }
}

/// Output of an estimator in space.
pub type SpatialOutput = Output<Vector2<f64>, SpatialPose, space::estimators::Estimate>;

/// Answer of a kind of estimator.
pub type AnswerOf<K> = Answer<<K as Kind>::Reading, <K as Kind>::Base, <K as Kind>::Estimate>;
/// Output of a kind of estimator.
pub type OutputOf<K> = Output<<K as Kind>::Reading, <K as Kind>::Base, <K as Kind>::Estimate>;

/// Estimator of one whisker whose readings and poses arrive independently.
///
/// Times of messages (`t_s`) and of their arrival (`now_s`) are on clocks of their own; only differences are compared. A
/// reading and its pose are given to the estimator in the order of the readings' times, as by [`testbed::replay`]: if none is
/// late, the estimates equal those of a replay to the bit. A reading that is left out is bridged by the motion and the duration
/// of the next one.
///
/// Poses are those of the messages, or those of another [`Motion`]. The estimator is one of the plane, or one of space
/// ([`LiveEstimator::in_space`]).
pub struct LiveEstimator<M = Poses, K: Kind = Planar> {
    build: Box<dyn Fn() -> anyhow::Result<K> + Send>,
    estimator: K,
    matching: Matching<M, K::Reading>,
    /// Pose of the base at the first sample of the estimator.
    start: Option<K::Base>,
    /// Answers that may be revised, each with whether the whisker touched, and the estimates of those with a pose.
    held: Vec<(AnswerOf<K>, bool)>,
    estimates: Vec<Option<K::Estimate>>,
    counters: Counters,
    /// Status of the last reading, if it had no pose.
    blocked: Option<Status>,
    freezing: Freezing,
    /// Middle of the undeflected whisker on the x axis of Base (m).
    middle_m: f64,
    is_frozen: bool,
    /// Time and pose at which the interval began whose speed is tested next.
    interval: Option<(f64, K::Base)>,
    /// Number of intervals since the start in which the base moved implausibly fast.
    fast: u64,
}

impl LiveEstimator {
    /// An estimator with these settings. `looks_back` states whether its method is of the class `hindsight`, whose answers are held
    /// until the contact ends.
    ///
    /// # Errors
    /// If the timing is invalid, or the estimator cannot be built.
    pub fn new(build: Build, knowledge: &Arc<Knowledge>, looks_back: bool, timing: Timing) -> anyhow::Result<Self> {
        Self::with_motion(build, knowledge, looks_back, timing, Poses::default())
    }
}

impl<M: Motion<Base = Pose<Base, World>>> LiveEstimator<M> {
    /// As [`LiveEstimator::new`], with the poses of this motion.
    ///
    /// # Errors
    /// As [`LiveEstimator::new`].
    pub fn with_motion(
        build: Build,
        knowledge: &Arc<Knowledge>,
        looks_back: bool,
        timing: Timing,
        motion: M,
    ) -> anyhow::Result<Self> {
        let gate = knowledge.gate();
        let build = move || Ok(Planar::new(build()?, gate, looks_back));
        let largest_n_m = knowledge.faces.iter().map(|face| face.largest_reading_n_m).fold(0.0, f64::max);
        let freezing = Freezing::new(largest_n_m, knowledge.noise_sd_n_m);
        let middle_m = 0.5 * knowledge.rest.length_m();
        Self::of(Box::new(build), knowledge.rate_hz, timing, motion, (freezing, middle_m))
    }

    /// Outline of the object that is touched, or was touched last; see [`Estimator::outline`].
    pub fn outline(&self) -> Option<Vec<OutlinePoint>> {
        self.estimator.outline()
    }
}

impl LiveEstimator<SpatialPoses, Spatial> {
    /// An estimator in space with these settings.
    ///
    /// # Errors
    /// As [`LiveEstimator::new`].
    pub fn in_space(
        build: SpatialBuild,
        knowledge: &Arc<space::estimators::Knowledge>,
        timing: Timing,
    ) -> anyhow::Result<Self> {
        Self::in_space_with_motion(build, knowledge, timing, SpatialPoses::default())
    }
}

impl<M: Motion<Base = SpatialPose>> LiveEstimator<M, Spatial> {
    /// As [`LiveEstimator::in_space`], with the poses of this motion.
    ///
    /// # Errors
    /// As [`LiveEstimator::new`].
    pub fn in_space_with_motion(
        build: SpatialBuild,
        knowledge: &Arc<space::estimators::Knowledge>,
        timing: Timing,
        motion: M,
    ) -> anyhow::Result<Self> {
        let (rate_hz, of_build) = (knowledge.rate_hz, knowledge.clone());
        let build = move || Ok(Spatial::new(build()?, &of_build));
        let calibrated = &knowledge.calibrated;
        let freezing = Freezing::new(calibrated.largest_reading_n_m, knowledge.noise_sd_n_m);
        let middle_m = 0.5 * calibrated.whisker.whisker.length_m;
        Self::of(Box::new(build), rate_hz, timing, motion, (freezing, middle_m))
    }
}

impl<K: Kind, M: Motion<Base = K::Base>> LiveEstimator<M, K> {
    fn of(
        build: Box<dyn Fn() -> anyhow::Result<K> + Send>,
        rate_hz: f64,
        timing: Timing,
        motion: M,
        (freezing, middle_m): (Freezing, f64),
    ) -> anyhow::Result<Self> {
        timing.validate()?;
        Ok(Self {
            estimator: build()?,
            build,
            matching: Matching::new(timing, rate_hz, motion),
            start: None,
            held: Vec::new(),
            estimates: Vec::new(),
            counters: Counters::default(),
            blocked: None,
            freezing,
            middle_m,
            is_frozen: false,
            interval: None,
            fast: 0,
        })
    }

    /// Takes a reading that arrives at `now_s`.
    ///
    /// # Errors
    /// If the estimator cannot be built again after a jump of a clock.
    pub fn reading(
        &mut self,
        t_s: f64,
        reading_n_m: K::Reading,
        now_s: f64,
        out: &mut OutputOf<K>,
    ) -> anyhow::Result<()> {
        self.counters.readings += 1;
        let arrived = Arrived { t_s, reading_n_m, at_s: now_s };
        if !(t_s.is_finite() && K::is_finite(&reading_n_m)) {
            self.counters.not_finite += 1;
            out.events.push(Event::NotFinite { stream: Stream::Readings, t_s });
            out.answers.push(answer(&arrived, Status::NotFinite));
            return Ok(());
        }
        let admitted = match self.matching.reading(arrived, &mut self.counters) {
            Ok(admitted) => admitted,
            Err(jump) => {
                self.restart(Stream::Readings, jump, out)?;
                self.matching.reading(arrived, &mut self.counters).expect("the first reading of a clock")
            }
        };
        match admitted {
            Admitted::Kept => self.poll(now_s, out),
            Admitted::Late => out.answers.push(answer(&arrived, Status::Late)),
            Admitted::Repeated => out.answers.push(answer(&arrived, Status::Repeated)),
        }
        Ok(())
    }

    /// Takes a measurement of the motion, such as a pose of the base, that arrives at `now_s`. World may be any frame at rest.
    ///
    /// # Errors
    /// If the estimator cannot be built again after a jump of a clock.
    pub fn pose(&mut self, t_s: f64, measured: M::Measured, now_s: f64, out: &mut OutputOf<K>) -> anyhow::Result<()>
    where
        M::Measured: Clone,
    {
        if !(t_s.is_finite() && self.matching.motion().is_finite(&measured)) {
            self.counters.poses += 1;
            self.counters.not_finite += 1;
            out.events.push(Event::NotFinite { stream: Stream::Poses, t_s });
            return Ok(());
        }
        if let Err(jump) = self.matching.moved(t_s, measured.clone(), now_s, &mut self.counters) {
            self.restart(Stream::Poses, jump, out)?;
            self.matching.moved(t_s, measured, now_s, &mut self.counters).expect("the first pose of a clock");
        }
        self.poll(now_s, out);
        Ok(())
    }

    /// Answers the readings that need not wait any longer at `now_s`.
    pub fn poll(&mut self, now_s: f64, out: &mut OutputOf<K>) {
        while let Some((arrived, place)) = self.matching.settled(now_s, &mut self.counters) {
            self.step(&arrived, place, out);
        }
    }

    /// Time of arrival at which [`Self::poll`] is due. `None` while no reading waits.
    pub fn deadline_s(&self) -> Option<f64> {
        self.matching.deadline_s()
    }

    /// Answers all readings at the end of the streams.
    pub fn finish(&mut self, out: &mut OutputOf<K>) {
        while let Some((arrived, place)) = self.matching.last(&mut self.counters) {
            self.step(&arrived, place, out);
        }
        self.estimator.end(&mut self.estimates);
        self.release(out);
    }

    /// Motion of the base, with the measurements that are still required.
    pub fn motion(&self) -> &M {
        self.matching.motion()
    }

    /// Counts so far.
    pub fn counters(&self) -> &Counters {
        &self.counters
    }

    /// Pose of the base at the first sample of the estimator, in the plane the frame of the outline. `None` before it.
    pub fn start(&self) -> Option<K::Base> {
        self.start
    }

    fn step(&mut self, arrived: &Arrived<K::Reading>, place: Place<K::Base>, out: &mut OutputOf<K>) {
        let Arrived { t_s, reading_n_m, .. } = *arrived;
        let base = match place {
            Place::At(base) => base,
            Place::OffPlane(deviation) => {
                self.counters.off_plane += 1;
                let event = Event::OffPlane { t_s, deviation };
                return self.block(arrived, Status::OffPlane, event, out);
            }
            Place::Pending => return self.stale(arrived, None, out),
            Place::Unknown(lack) => return self.stale(arrived, Some(lack), out),
        };
        if self.blocked.take().is_some() {
            out.events.push(Event::Recovered { t_s });
        }
        self.check_speed(t_s, &base, out);
        let is_gated = !self.estimator.admits(&reading_n_m);
        if !is_gated && self.is_frozen(t_s, &reading_n_m, &base, out) {
            self.counters.frozen += 1;
            self.held.push((answer(arrived, Status::Frozen), false));
            return self.release_unless_held(out);
        }
        self.start.get_or_insert(base);
        self.counters.matched += 1;
        self.counters.gated += u64::from(is_gated);
        self.estimator.push(t_s, &base, reading_n_m, &mut self.estimates);
        let touches = self.estimator.touches();
        self.counters.touching += u64::from(touches);
        let status = if is_gated { Status::Gated } else { Status::Used };
        self.held.push((Answer { base: Some(base), ..answer(arrived, status) }, touches));
        self.release_unless_held(out);
    }

    /// Whether the reading is frozen, with an event at the first one and at the first one after them.
    fn is_frozen(&mut self, t_s: f64, reading_n_m: &K::Reading, base: &K::Base, out: &mut OutputOf<K>) -> bool {
        let run = self.freezing.step(t_s, K::moments_n_m(reading_n_m), K::point_m(base, self.middle_m));
        if self.is_frozen != run.is_some() {
            out.events.push(match run {
                Some(FrozenRun { first_s, count, way_m }) => Event::Frozen { t_s, first_s, count, way_m },
                None => Event::Thawed { t_s },
            });
        }
        self.is_frozen = run.is_some();
        self.is_frozen
    }

    /// Compares the motion of the base with that of a robot: poses in another unit are faster. Over shorter intervals, errors of
    /// poses and stamps would count.
    fn check_speed(&mut self, t_s: f64, base: &K::Base, out: &mut OutputOf<K>) {
        let &mut (first_s, first) = self.interval.get_or_insert((t_s, *base));
        let duration_s = t_s - first_s;
        if duration_s < INTERVAL_S {
            return;
        }
        self.interval = Some((t_s, *base));
        let Way { distance_m, angle_rad } = K::way(&first, base);
        let (speed_m_s, rate_rad_s) = (distance_m / duration_s, angle_rad / duration_s);
        if speed_m_s <= MOST_SPEED_M_S && rate_rad_s <= MOST_RATE_RAD_S {
            return;
        }
        self.counters.fast += 1;
        self.fast += 1;
        if self.fast == FAST_INTERVALS {
            out.events.push(Event::Fast { t_s, speed_m_s, rate_rad_s });
        }
    }

    /// Answers a reading without a pose in time.
    fn stale(&mut self, arrived: &Arrived<K::Reading>, lack: Option<Lack>, out: &mut OutputOf<K>) {
        self.counters.stale += 1;
        self.counters.stale_intervals += u64::from(self.blocked != Some(Status::Stale));
        let event = Event::Stale { t_s: arrived.t_s, newest_pose_s: self.matching.newest_pose_s(), lack };
        self.block(arrived, Status::Stale, event, out);
    }

    /// Answers a reading without a pose; the event is that of the first one.
    fn block(&mut self, arrived: &Arrived<K::Reading>, status: Status, event: Event, out: &mut OutputOf<K>) {
        if self.blocked.replace(status) != Some(status) {
            out.events.push(event);
        }
        self.held.push((answer(arrived, status), false));
        self.release_unless_held(out);
    }

    fn release_unless_held(&mut self, out: &mut OutputOf<K>) {
        if !self.estimator.is_following() {
            self.release(out);
        }
    }

    fn release(&mut self, out: &mut OutputOf<K>) {
        let mut estimates = self.estimates.drain(..);
        for (answer, touches) in self.held.drain(..) {
            // The estimator was given those with a pose.
            let estimate = answer.base.and_then(|_| estimates.next().flatten());
            self.counters.estimates += u64::from(estimate.is_some());
            self.counters.unanswered += u64::from(touches && estimate.is_none());
            out.answers.push(Answer { estimate, ..answer });
        }
    }

    /// Begins anew after a jump of a clock; waiting readings are dropped.
    fn restart(&mut self, stream: Stream, jump: Jump, out: &mut OutputOf<K>) -> anyhow::Result<()> {
        self.counters.jumps += 1;
        let is_thousandfold = self.matching.is_thousandfold(jump);
        self.counters.thousandfold += u64::from(is_thousandfold);
        self.estimator.end(&mut self.estimates);
        self.release(out);
        let dropped = self.matching.restart();
        out.answers.extend(dropped.iter().map(|arrived| answer(arrived, Status::Dropped)));
        let in_milliseconds = is_thousandfold && self.counters.shows_milliseconds();
        out.events.push(Event::Jumped { stream, jump, in_milliseconds });
        let earlier = std::mem::replace(&mut self.estimator, (self.build)()?);
        self.estimator.keep_rest_reading(&earlier);
        self.start = None;
        self.blocked = None;
        self.freezing.restart();
        self.is_frozen = false;
        (self.interval, self.fast) = (None, 0);
        Ok(())
    }
}

/// Answer without an estimate.
fn answer<R: Copy, P, E>(arrived: &Arrived<R>, status: Status) -> Answer<R, P, E> {
    let Arrived { t_s, reading_n_m, at_s } = *arrived;
    Answer { t_s, arrived_s: at_s, reading_n_m, status, base: None, estimate: None }
}
