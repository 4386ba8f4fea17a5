//! Readings from the counts of a magnetometer, by the calibration of the sensor.
//!
//! ```text
//! counts, those of the reference and of the neighbours at the same time -> common-mode compensation -> zeroing
//!     -> cross-talk compensation -> characteristic -> reading
//! ```
//!
//! The steps are those of the calibration (`testbed::front_end`). Samples of the other sensors are interpolated. The zeroing is
//! repeated if the counts change during it by more than those of a free whisker. If the clock of a sensor is set back to before the
//! end of the zeroing, as by a recording in a loop, the conversion begins anew with the zeroing. After a smaller step back, or a
//! wrong time stamp, the zeros are kept, since the whisker may be in contact. [`BendingCounts`] converts the counts of a sensor
//! with two channels, in space.

mod bending;
mod zeroing;

use std::collections::VecDeque;

use nalgebra::Vector1;
use trace::{CrossTalk, SensorFile};

use crate::clock::{Clock, Order};
use crate::samples::{Sampled, Samples};
use crate::timing::Timing;

use zeroing::Zeroing;

pub use bending::BendingCounts;

/// Duration of the zeroing if none is stated (s).
pub const ZEROING_S: f64 = 1.0;

/// Shortest and longest zeroing (s).
pub const ZEROINGS_S: [f64; 2] = [0.01, 60.0];

/// Largest change of the reading of a free whisker during the zeroing, in standard deviations of the noise: about three times the
/// range of a thousand readings of a normal distribution.
const STEADY_SDS: f64 = 20.0;

/// Change of the reading during the zeroing that is always accepted, relative to the largest calibrated reading. It equals the
/// share above which contact is detected whatever the offset of the sensor is ([`whisker::events`]).
const STEADY_SHARE: f64 = 0.03;

/// Whether the reading of a free whisker may change by this (N m).
fn is_steady(change_n_m: f64, noise_sd_n_m: f64, largest_n_m: f64) -> bool {
    change_n_m <= (STEADY_SDS * noise_sd_n_m).max(STEADY_SHARE * largest_n_m)
}

/// Smallest and largest number of values of a counter that wraps.
pub const MODULI: [f64; 2] = [2.0, 4_294_967_296.0];

/// Largest number of counts that wait for those of the other sensors.
const MOST_WAITING: usize = 1 << 12;

/// Sensor of the stream of a whisker.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stream {
    /// Its own.
    Own,
    /// The reference.
    Reference,
    /// A neighbour on the board, by index.
    Neighbour(usize),
}

/// Conversion of the counts of the sensors of a whisker into its readings.
pub trait Conversion {
    /// Reading of the whisker (N m).
    type Reading;

    /// Takes counts that arrive at `now_s`. Counts that are not finite are left out.
    fn take(&mut self, stream: Stream, t_s: f64, counts: [f64; 3], now_s: f64);

    /// The next counts that wait no longer at `now_s`, in order of time.
    fn next(&mut self, now_s: f64) -> Option<Converted<Self::Reading>>;

    /// Time from which on [`Self::next`] waits no longer.
    fn deadline_s(&self) -> Option<f64>;

    /// Number of counts left out, since they are not finite or those of another sensor are missing.
    fn incomplete(&self) -> u64;

    /// Number of counts left out, since they arrived after later ones had been converted.
    fn late(&self) -> u64;

    /// Number of times that the zeroing was repeated, since the counts had changed. Repetitions after a clock was set back do not
    /// count.
    fn zeroings_repeated(&self) -> u64;
}

/// Counts that have been converted, or left out.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Converted<R = f64> {
    /// Time of the counts.
    pub t_s: f64,
    /// Their arrival.
    pub arrived_s: f64,
    /// Their reading, or the reason why they have none.
    pub reading: Reading<R>,
}

/// The reading of counts, or the reason why they have none.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Reading<R = f64> {
    /// The reading (N m).
    Of(R),
    /// They are those of the free whisker, from which the zero is determined.
    Zeroing,
    /// Those of another sensor at their time are missing.
    Incomplete,
    /// They arrived after later ones had been converted.
    Late,
}

/// A sensor with its zero.
#[derive(Clone, Debug)]
pub struct Sensor {
    file: SensorFile,
    axis: usize,
    samples: Samples<f64>,
    zeroing: Zeroing<1>,
}

impl Sensor {
    /// The sensor of a calibration, read on this axis (0 to 2). `modulo` is the number of values of a counter that wraps, if it
    /// does.
    pub fn new(file: SensorFile, axis: usize, modulo: Option<f64>) -> Self {
        Self { file, axis, samples: Samples::default(), zeroing: Zeroing::new(modulo) }
    }

    /// Counts of its axis, continued across wraps of the counter.
    fn unwrapped(&mut self, counts: [f64; 3]) -> f64 {
        self.zeroing.unwrapped(Vector1::new(counts[self.axis])).x
    }

    /// Mean of the compensated counts at rest. `None` while it is determined.
    fn zero(&self) -> Option<f64> {
        self.zeroing.zero().map(|zero| zero.x)
    }

    /// Drops the kept counts, and the zero if `zeroes`. With the zero, the counts continue across wraps of the counter.
    fn restart(&mut self, zeroes: bool) {
        if zeroes {
            self.zeroing.restart();
            self.samples = Samples::default();
        } else {
            self.samples.clear();
        }
    }

    /// Counts without the common mode.
    fn compensated(&self, counts: f64, reference: [f64; 2]) -> f64 {
        counts - self.file.common_mode[0] * reference[0] - self.file.common_mode[1] * reference[1]
    }

    /// Takes compensated counts at rest.
    fn rest(&mut self, compensated: f64) {
        self.zeroing.rest(Vector1::new(compensated));
    }

    /// Whether the readings have not changed during the zeroing by more than those of a free whisker.
    fn is_steady(&self) -> bool {
        let SensorFile { characteristic, noise_sd_n_m, .. } = &self.file;
        let largest_n_m = characteristic.range_n_m.into_iter().map(f64::abs).fold(0.0, f64::max);
        self.zeroing.range().is_none_or(|[low, high]| {
            let middle = 0.5 * (low.x + high.x);
            let [low_n_m, high_n_m] = [low.x, high.x].map(|counts| characteristic.moment_n_m(counts - middle));
            is_steady((high_n_m - low_n_m).abs(), *noise_sd_n_m, largest_n_m)
        })
    }
}

/// Conversion of the counts of a whisker into readings.
#[derive(Clone, Debug)]
pub struct Counts {
    own: Sensor,
    reference: Option<Samples<[f64; 2]>>,
    neighbours: Vec<(CrossTalk, Sensor)>,
    zeroing_s: f64,
    /// Times of the first and of the latest converted counts.
    first_s: Option<f64>,
    latest_s: Option<f64>,
    timing: Timing,
    /// Smallest step back of a clock that counts as a jump (s).
    jump_s: f64,
    /// Time, counts and arrival, in order of time.
    waiting: VecDeque<(f64, f64, f64)>,
    incomplete: u64,
    late: u64,
    zeroings_repeated: u64,
}

impl Counts {
    /// Conversion of the counts of a whisker's own sensor. `has_reference` states whether the counts of the reference sensor are
    /// taken too; `neighbours` are the sensors whose magnets the own one measures. In the first `zeroing_s` the whisker is free.
    pub fn new(
        own: Sensor,
        has_reference: bool,
        neighbours: Vec<(CrossTalk, Sensor)>,
        zeroing_s: f64,
        timing: Timing,
        rate_hz: f64,
    ) -> Self {
        Self {
            own,
            reference: has_reference.then(Samples::default),
            neighbours,
            zeroing_s,
            first_s: None,
            latest_s: None,
            timing,
            jump_s: timing.smallest_jump_s(rate_hz),
            waiting: VecDeque::new(),
            incomplete: 0,
            late: 0,
            zeroings_repeated: 0,
        }
    }

    /// Restarts after a clock was set back to `t_s`. If this lies before the end of the zeroing, the zeroing is repeated. Counts
    /// that wait are left out.
    fn restart(&mut self, t_s: f64) {
        let zeroes = self.first_s.is_none_or(|first_s| t_s - first_s < self.zeroing_s);
        if zeroes {
            self.first_s = None;
        }
        self.own.restart(zeroes);
        self.reference.iter_mut().for_each(Samples::clear);
        self.neighbours.iter_mut().for_each(|(_, sensor)| sensor.restart(zeroes));
        self.latest_s = None;
        self.incomplete += self.waiting.len() as u64;
        self.waiting.clear();
    }

    /// Clock of a stream. `None` if the conversion does not require it.
    fn clock(&mut self, stream: Stream) -> Option<&mut Clock> {
        match stream {
            Stream::Own => Some(&mut self.own.samples.clock),
            Stream::Reference => self.reference.as_mut().map(|samples| &mut samples.clock),
            Stream::Neighbour(index) => self.neighbours.get_mut(index).map(|(_, sensor)| &mut sensor.samples.clock),
        }
    }

    /// Counts of the reference and of the neighbours.
    fn others(&self, t_s: f64) -> Sampled<([f64; 2], Vec<f64>)> {
        let gap_s = self.timing.gap_s;
        let line = |a: &f64, b: &f64, share: f64| a + (b - a) * share;
        let reference = self.reference.as_ref().map_or(Sampled::At([0.0; 2]), |samples| {
            samples.at(t_s, gap_s, |a, b, share| [line(&a[0], &b[0], share), line(&a[1], &b[1], share)])
        });
        let mut neighbours = Vec::with_capacity(self.neighbours.len());
        let mut is_pending = reference == Sampled::Pending;
        for (_, sensor) in &self.neighbours {
            match sensor.samples.at(t_s, gap_s, line) {
                Sampled::At(counts) => neighbours.push(counts),
                Sampled::Pending => is_pending = true,
                Sampled::Unknown(lack) => return Sampled::Unknown(lack),
            }
        }
        match reference {
            Sampled::Unknown(lack) => Sampled::Unknown(lack),
            Sampled::At(reference) if !is_pending => Sampled::At((reference, neighbours)),
            _ => Sampled::Pending,
        }
    }

    /// Reading from complete counts. `None` during the zeroing.
    fn reading_n_m(&mut self, t_s: f64, counts: f64, reference: [f64; 2], neighbours: &[f64]) -> Option<f64> {
        // Earlier counts may arrive during this time.
        let required_s = t_s - self.timing.reorder_s;
        self.reference.iter_mut().for_each(|samples| samples.settle(required_s));
        let compensated = self.own.compensated(counts, reference);
        let is_last = t_s - *self.first_s.get_or_insert(t_s) >= self.zeroing_s;
        let mut talk = 0.0;
        let zero = self.own.zero();
        for ((cross_talk, sensor), counts) in self.neighbours.iter_mut().zip(neighbours) {
            sensor.samples.settle(required_s);
            let compensated = sensor.compensated(*counts, reference);
            match sensor.zero() {
                None => sensor.rest(compensated),
                Some(zero) => talk += cross_talk.counts(sensor.file.characteristic.moment_n_m(compensated - zero)),
            }
        }
        let Some(zero) = zero else {
            self.own.rest(compensated);
            if is_last {
                self.end_zeroing();
            }
            return None;
        };
        Some(self.own.file.characteristic.moment_n_m(compensated - zero - talk))
    }

    /// Ends the zeroing, or repeats it if a whisker was not free.
    fn end_zeroing(&mut self) {
        let is_steady = self.own.is_steady() && self.neighbours.iter().all(|(_, sensor)| sensor.is_steady());
        if !is_steady {
            self.first_s = None;
            self.zeroings_repeated += 1;
        }
        for sensor in self.neighbours.iter_mut().map(|(_, sensor)| sensor).chain([&mut self.own]) {
            if is_steady {
                sensor.zeroing.end();
            } else {
                sensor.zeroing.repeat();
            }
        }
    }
}

impl Conversion for Counts {
    type Reading = f64;

    fn take(&mut self, stream: Stream, t_s: f64, counts: [f64; 3], now_s: f64) {
        if !(t_s.is_finite() && counts.iter().all(|value| value.is_finite())) {
            self.incomplete += 1;
            return;
        }
        let jump_s = self.jump_s;
        let Some(clock) = self.clock(stream) else { return };
        if let Order::Jumped(jump) = clock.check(t_s, now_s, jump_s)
            && jump.to_s < jump.from_s
        {
            self.restart(t_s);
        }
        match stream {
            Stream::Own => {
                let counts = self.own.unwrapped(counts);
                let place = self.waiting.partition_point(|(of_waiting_s, ..)| *of_waiting_s <= t_s);
                self.waiting.insert(place, (t_s, counts, now_s));
            }
            Stream::Reference => {
                self.reference.iter_mut().for_each(|samples| {
                    samples.insert(t_s, [counts[0], counts[1]]);
                });
            }
            Stream::Neighbour(index) => {
                if let Some((_, sensor)) = self.neighbours.get_mut(index) {
                    let counts = sensor.unwrapped(counts);
                    sensor.samples.insert(t_s, counts);
                }
            }
        }
    }

    fn next(&mut self, now_s: f64) -> Option<Converted> {
        let (t_s, counts, arrived_s) = *self.waiting.front()?;
        let waits = now_s < arrived_s + self.timing.wait_s && self.waiting.len() <= MOST_WAITING;
        let others = self.others(t_s);
        if matches!(others, Sampled::Pending) && waits {
            return None;
        }
        self.waiting.pop_front();
        let reading = if let Sampled::At((reference, neighbours)) = others {
            self.latest_s = Some(self.latest_s.map_or(t_s, |latest_s| latest_s.max(t_s)));
            self.reading_n_m(t_s, counts, reference, &neighbours).map_or(Reading::Zeroing, Reading::Of)
        } else if self.latest_s.is_some_and(|latest_s| t_s < latest_s) {
            self.late += 1;
            Reading::Late
        } else {
            self.incomplete += 1;
            Reading::Incomplete
        };
        Some(Converted { t_s, arrived_s, reading })
    }

    fn deadline_s(&self) -> Option<f64> {
        self.waiting.front().map(|(_, _, at_s)| at_s + self.timing.wait_s)
    }

    fn incomplete(&self) -> u64 {
        self.incomplete
    }

    fn late(&self) -> u64 {
        self.late
    }

    fn zeroings_repeated(&self) -> u64 {
        self.zeroings_repeated
    }
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    const RATE_HZ: f64 = 250.0;
    const MODULO: f64 = 65536.0;
    const REST: f64 = 65_500.0;
    /// Difference to the counts at rest, across a wrap of the counter, of a moment of -1 mN m.
    const PRESSED: f64 = 2000.0;

    /// Conversion of a sensor whose counter wraps, after the zeroing in the first second.
    fn zeroed() -> Counts {
        let file = json!({
            "name": "s", "array": "a", "common_mode": [0.0, 0.0], "cross_talk": [],
            "characteristic": {"coefficients": [-2e6], "range_n_m": [-2e-3, 2e-3]},
            "noise_sd_n_m": 1e-7, "offset_sd_n_m": 0.0, "gain_sd": 0.0,
        });
        let file = serde_json::from_value(file).expect("a sensor");
        let own = Sensor::new(file, 1, Some(MODULO));
        let mut counts = Counts::new(own, false, Vec::new(), 1.0, Timing::default(), RATE_HZ);
        assert!(converted(&mut counts, 0.0, 0.0, 1.0, REST).is_empty());
        counts
    }

    /// Readings from constant counts of `length_s` from `t_s` on, which arrive from `now_s` on.
    fn converted(counts: &mut Counts, t_s: f64, now_s: f64, length_s: f64, value: f64) -> Vec<f64> {
        let mut readings_n_m = Vec::new();
        for step in 0..=(length_s * RATE_HZ) as u32 {
            let since_s = f64::from(step) / RATE_HZ;
            counts.take(Stream::Own, t_s + since_s, [0.0, value.rem_euclid(MODULO), 0.0], now_s + since_s);
            while let Some(converted) = counts.next(now_s + since_s) {
                if let Reading::Of(reading_n_m) = converted.reading {
                    readings_n_m.push(reading_n_m);
                }
            }
        }
        readings_n_m
    }

    fn assert_pressed(readings_n_m: &[f64], count: usize) {
        assert_eq!(readings_n_m.len(), count);
        assert!(readings_n_m.iter().all(|reading_n_m| (reading_n_m + 1e-3).abs() < 1e-9), "{readings_n_m:?}");
    }

    #[test]
    fn robust_a_wrong_stamp_in_contact_keeps_the_zero() {
        let mut counts = zeroed();
        assert_pressed(&converted(&mut counts, 2.0, 2.0, 1.0, REST + PRESSED), 251);
        // One count is stamped 1000 s ahead.
        assert_pressed(&converted(&mut counts, 1003.004, 3.004, 0.0, REST + PRESSED), 1);
        assert_pressed(&converted(&mut counts, 3.008, 3.008, 2.0, REST + PRESSED), 501);
    }

    #[test]
    fn robust_a_small_step_back_of_the_clock_in_contact_keeps_the_zero() {
        let mut counts = zeroed();
        assert_pressed(&converted(&mut counts, 2.0, 2.0, 1.0, REST + PRESSED), 251);
        assert_pressed(&converted(&mut counts, 2.5, 3.004, 2.0, REST + PRESSED), 501);
    }

    #[test]
    fn robust_the_zeroing_is_repeated_while_the_whisker_is_not_free() {
        let mut counts = zeroed();
        counts.restart(0.0);
        assert!(converted(&mut counts, 0.0, 2.0, 0.5, REST + PRESSED).is_empty());
        assert!(converted(&mut counts, 0.504, 2.504, 0.5, REST).is_empty());
        assert_eq!((counts.own.zero(), counts.zeroings_repeated()), (None, 1));
        let at_rest_n_m = converted(&mut counts, 1.008, 3.008, 1.1, REST);
        assert_eq!((at_rest_n_m.len(), counts.zeroings_repeated()), (26, 1));
        assert!(at_rest_n_m.iter().all(|reading_n_m| reading_n_m.abs() < 1e-9), "{at_rest_n_m:?}");
    }

    #[test]
    fn robust_a_step_back_to_the_zeroing_repeats_it() {
        let mut counts = zeroed();
        assert_pressed(&converted(&mut counts, 2.0, 2.0, 1.0, REST + PRESSED), 251);
        // Four counts precede the detection of the jump.
        let offset = 300.0;
        let at_rest_n_m = converted(&mut counts, 0.0, 3.004, 1.1, REST + offset);
        assert_eq!(at_rest_n_m.len(), 4 + 21);
        assert!(at_rest_n_m[4..].iter().all(|reading_n_m| reading_n_m.abs() < 1e-9), "{at_rest_n_m:?}");
        assert_pressed(&converted(&mut counts, 2.0, 5.004, 1.0, REST + offset + PRESSED), 251);
    }
}
