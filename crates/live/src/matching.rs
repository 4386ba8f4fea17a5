//! Matching of readings and poses by time.

use std::collections::VecDeque;

use crate::clock::{Clock, Jump, Order};
use crate::counters::{Counters, SLOW_STEP_S};
use crate::motion::{Motion, Place};
use crate::timing::Timing;

/// Largest number of waiting readings.
const MOST_WAITING: usize = 1 << 14;

/// Number of settled readings whose times are kept, to tell repeated readings from late ones.
const RECENT: usize = 256;

/// Share of a nominal interval by which readings may follow each other later without one being missing.
const UNEVEN: f64 = 0.5;

/// Reading that has arrived.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Arrived<R> {
    pub(crate) t_s: f64,
    pub(crate) reading_n_m: R,
    pub(crate) at_s: f64,
}

/// Admission of a message.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Admitted {
    /// It is kept.
    Kept,
    /// It is too late.
    Late,
    /// Its time has arrived before.
    Repeated,
}

/// Readings that wait for their poses, and the motion that determines these.
#[derive(Clone, Debug)]
pub(crate) struct Matching<M, R> {
    timing: Timing,
    rate_hz: f64,
    readings: Clock,
    /// In order of time.
    waiting: VecDeque<Arrived<R>>,
    motion: M,
    /// Times of the last settled readings.
    recent: VecDeque<f64>,
    /// Largest time (s) of a reading with a pose behind the newest pose, and the largest that is admitted: after a jump of one of
    /// two clocks, the poses at the times of the readings are those of other instants.
    lag_s: f64,
    most_lag_s: f64,
}

impl<M: Motion, R: Copy> Matching<M, R> {
    pub(crate) fn new(timing: Timing, rate_hz: f64, motion: M) -> Self {
        let (waiting, recent) = (VecDeque::new(), VecDeque::new());
        let (readings, lag_s, most_lag_s) = (Clock::default(), f64::NEG_INFINITY, f64::INFINITY);
        Self { timing, rate_hz, readings, waiting, motion, recent, lag_s, most_lag_s }
    }

    /// Begins anew after a jump of a clock. Returns the readings that waited.
    pub(crate) fn restart(&mut self) -> VecDeque<Arrived<R>> {
        self.motion.restart();
        self.readings = Clock::default();
        self.recent.clear();
        // Without a reading that was used, the delay of the readings is not known.
        if self.lag_s.is_finite() {
            self.most_lag_s = self.lag_s.max(0.0) + self.jump_s();
        }
        std::mem::take(&mut self.waiting)
    }

    /// Adds a reading.
    ///
    /// # Errors
    /// If the clock of the readings has jumped; the reading is not added.
    pub(crate) fn reading(&mut self, arrived: Arrived<R>, counters: &mut Counters) -> Result<Admitted, Jump> {
        let Arrived { t_s, at_s, .. } = arrived;
        let order = self.readings.check(t_s, at_s, self.jump_s());
        if let Order::Jumped(jump) = order {
            return Err(jump);
        }
        let place = self.waiting.partition_point(|waiting| waiting.t_s < t_s);
        let is_waiting = self.waiting.get(place).is_some_and(|waiting| waiting.t_s == t_s);
        let is_past = self.recent.back().is_some_and(|last_s| t_s <= *last_s);
        if is_waiting || (is_past && self.recent.contains(&t_s)) {
            counters.repeated += 1;
            return Ok(Admitted::Repeated);
        }
        let lag_s = self.lag_s(t_s);
        // Its pose would be one of another clock if the clock of the readings was set back. Delayed readings are in order.
        let is_behind_poses = lag_s > self.jump_s() && order != Order::Next;
        if is_past || is_behind_poses || lag_s > self.most_lag_s {
            counters.late += 1;
            return Ok(Admitted::Late);
        }
        counters.overtaken += u64::from(order == Order::Behind);
        self.waiting.insert(place, arrived);
        Ok(Admitted::Kept)
    }

    /// Adds a measurement of the motion that arrives at `at_s`. Those that have no clock are not counted.
    ///
    /// # Errors
    /// If its clock has jumped; the measurement is not added.
    pub(crate) fn moved(
        &mut self,
        t_s: f64,
        measured: M::Measured,
        at_s: f64,
        counters: &mut Counters,
    ) -> Result<(), Jump> {
        let jump_s = self.jump_s();
        let Some(clock) = self.motion.clock(&measured) else {
            self.motion.insert(t_s, measured);
            return Ok(());
        };
        let order = clock.check(t_s, at_s, jump_s);
        if let Order::Jumped(jump) = order {
            return Err(jump);
        }
        counters.poses += 1;
        if self.motion.is_before_all(t_s, &measured) && !self.recent.is_empty() {
            counters.late += 1;
        } else if !self.motion.insert(t_s, measured) {
            counters.repeated += 1;
        } else {
            counters.overtaken += u64::from(order == Order::Behind);
        }
        Ok(())
    }

    /// The next reading that needs not wait any longer at `now_s`, with the place of the base, which is pending if its pose did not
    /// arrive in time.
    pub(crate) fn settled(&mut self, now_s: f64, counters: &mut Counters) -> Option<(Arrived<R>, Place<M::Base>)> {
        let next = *self.waiting.front()?;
        let is_full = self.waiting.len() > MOST_WAITING;
        if !is_full && self.awaits_earlier(&next) && now_s < next.at_s + self.timing.reorder_s {
            return None;
        }
        let place = match self.motion.at(next.t_s, self.timing.gap_s) {
            Place::Pending if !is_full && now_s < next.at_s + self.timing.wait_s => return None,
            place => place,
        };
        self.settle(&next, matches!(place, Place::At(_)), counters);
        Some((next, place))
    }

    /// The next waiting reading, at the end of the streams: as [`Self::settled`] without a wait.
    pub(crate) fn last(&mut self, counters: &mut Counters) -> Option<(Arrived<R>, Place<M::Base>)> {
        self.settled(f64::INFINITY, counters)
    }

    /// Time from which on [`Self::settled`] settles the next reading at the latest.
    pub(crate) fn deadline_s(&self) -> Option<f64> {
        let next = self.waiting.front()?;
        let earlier_s = if self.awaits_earlier(next) { self.timing.reorder_s } else { 0.0 };
        let pending = matches!(self.motion.at(next.t_s, self.timing.gap_s), Place::Pending);
        let pose_s = if pending { self.timing.wait_s } else { 0.0 };
        Some(next.at_s + earlier_s.max(pose_s))
    }

    /// The motion.
    pub(crate) fn motion(&self) -> &M {
        &self.motion
    }

    /// Time up to which the pose is known.
    pub(crate) fn newest_pose_s(&self) -> Option<f64> {
        self.motion.newest_s()
    }

    /// Whether readings between the last settled one and this one have not arrived.
    fn awaits_earlier(&self, next: &Arrived<R>) -> bool {
        self.recent.back().is_some_and(|last_s| (next.t_s - last_s) * self.rate_hz > 1.0 + UNEVEN)
    }

    /// Time (s) by which a reading lies behind the newest pose. Negative infinity without poses.
    fn lag_s(&self, t_s: f64) -> f64 {
        self.motion.newest_s().map_or(f64::NEG_INFINITY, |newest_s| newest_s - t_s)
    }

    /// Whether a clock has jumped by about a thousand nominal intervals, as it does from message to message if times are in
    /// milliseconds.
    pub(crate) fn is_thousandfold(&self, jump: Jump) -> bool {
        let step = (jump.to_s - jump.from_s) * self.rate_hz;
        (1e3 * (1.0 - UNEVEN)..=1e3 * (1.0 + UNEVEN)).contains(&step)
    }

    /// Largest difference of two clocks.
    fn jump_s(&self) -> f64 {
        self.timing.smallest_jump_s(self.rate_hz)
    }

    fn settle(&mut self, next: &Arrived<R>, is_used: bool, counters: &mut Counters) {
        if let Some(last_s) = self.recent.back() {
            let step_s = next.t_s - last_s;
            let intervals = (step_s * self.rate_hz).round();
            counters.missing += (intervals - 1.0).max(0.0) as u64;
            // A pause of a faster stream has missing readings instead.
            counters.slow += u64::from(intervals <= 1.0 && step_s >= SLOW_STEP_S);
        }
        if self.recent.len() == RECENT {
            self.recent.pop_front();
        }
        self.recent.push_back(next.t_s);
        self.waiting.pop_front();
        if is_used {
            self.lag_s = self.lag_s.max(self.lag_s(next.t_s));
        }
        self.motion.settle(next.t_s, is_used);
    }
}
