//! Both bending moments from the counts of a magnetometer with two channels, in space.

use std::collections::VecDeque;

use nalgebra::Vector2;
use trace::BendingSensor;

use super::zeroing::Zeroing;
use super::{Conversion, Converted, Reading, Stream, is_steady};
use crate::clock::{Clock, Order};
use crate::timing::Timing;

/// Conversion of the counts of a whisker in space into both bending moments.
///
/// In the first `zeroing_s` the whisker is free: the mean of its counts is the zero. The zeroing is repeated if the counts have
/// changed by more than a free whisker's, or if the clock is set back to before its end, as by [`super::Counts`].
#[derive(Clone, Debug)]
pub struct BendingCounts {
    sensor: BendingSensor,
    /// Largest moment of the calibration (N m).
    largest_n_m: f64,
    /// Axes of the magnetometer that are its channels.
    axes: [usize; 2],
    zeroing: Zeroing<2>,
    zeroing_s: f64,
    /// Smallest step back of the clock that counts as a jump (s).
    jump_s: f64,
    clock: Clock,
    /// Time of the first counts of the zeroing.
    first_s: Option<f64>,
    converted: VecDeque<Converted<Vector2<f64>>>,
    /// Number of counts that are not finite.
    not_finite: u64,
    zeroings_repeated: u64,
}

impl BendingCounts {
    /// Conversion of the counts of a sensor, with `largest_n_m` the largest moment of its calibration (N m), read on these axes (0
    /// to 2). `modulo` is the number of values of a counter that wraps, if it does; `zeroing_s` the duration of the zeroing (s),
    /// `rate_hz` the rate of the counts (Hz).
    pub fn new(
        sensor: BendingSensor,
        largest_n_m: f64,
        axes: [usize; 2],
        modulo: Option<f64>,
        zeroing_s: f64,
        timing: Timing,
        rate_hz: f64,
    ) -> Self {
        Self {
            sensor,
            largest_n_m,
            axes,
            zeroing: Zeroing::new(modulo),
            zeroing_s,
            jump_s: timing.smallest_jump_s(rate_hz),
            clock: Clock::default(),
            first_s: None,
            converted: VecDeque::new(),
            not_finite: 0,
            zeroings_repeated: 0,
        }
    }

    /// Moments about y and z of Base (N m), 2x1, of the counts of both channels at the time `t_s`, which arrive at `now_s`. `None`
    /// during the zeroing.
    pub fn moments_n_m(&mut self, t_s: f64, counts: Vector2<f64>, now_s: f64) -> Option<Vector2<f64>> {
        if let Order::Jumped(jump) = self.clock.check(t_s, now_s, self.jump_s)
            && jump.to_s < jump.from_s
        {
            // The clock begins anew, so that a further step back is found too.
            self.clock = Clock::default();
            self.clock.check(t_s, now_s, self.jump_s);
            if self.first_s.is_none_or(|first_s| t_s - first_s < self.zeroing_s) {
                self.first_s = None;
                self.zeroing.restart();
            }
        }
        let counts = self.zeroing.unwrapped(counts);
        if let Some(zero) = self.zeroing.zero() {
            return Some(self.sensor.counts_per_n_m.moment_n_m(counts - zero));
        }
        let is_last = t_s - *self.first_s.get_or_insert(t_s) >= self.zeroing_s;
        self.zeroing.rest(counts);
        if is_last {
            if self.is_steady() {
                self.zeroing.end();
            } else {
                self.zeroing.repeat();
                self.first_s = None;
                self.zeroings_repeated += 1;
            }
        }
        None
    }

    /// Whether the moments have not changed during the zeroing by more than those of a free whisker.
    fn is_steady(&self) -> bool {
        let BendingSensor { counts_per_n_m, noise_sd_n_m } = &self.sensor;
        self.zeroing.range().is_none_or(|[low, high]| {
            // The channels may have changed in the same direction or in opposite ones.
            let [x, y] = (high - low).into();
            let changes_n_m = [y, -y].map(|y| counts_per_n_m.moment_n_m(Vector2::new(x, y)).norm());
            is_steady(changes_n_m[0].max(changes_n_m[1]), *noise_sd_n_m, self.largest_n_m)
        })
    }
}

impl Conversion for BendingCounts {
    type Reading = Vector2<f64>;

    fn take(&mut self, stream: Stream, t_s: f64, counts: [f64; 3], now_s: f64) {
        if stream != Stream::Own {
            return;
        }
        if !(t_s.is_finite() && counts.iter().all(|value| value.is_finite())) {
            self.not_finite += 1;
            return;
        }
        let counts = Vector2::from(self.axes.map(|axis| counts[axis]));
        let reading = self.moments_n_m(t_s, counts, now_s).map_or(Reading::Zeroing, Reading::Of);
        self.converted.push_back(Converted { t_s, arrived_s: now_s, reading });
    }

    fn next(&mut self, _now_s: f64) -> Option<Converted<Vector2<f64>>> {
        self.converted.pop_front()
    }

    fn deadline_s(&self) -> Option<f64> {
        None
    }

    fn incomplete(&self) -> u64 {
        self.not_finite
    }

    fn late(&self) -> u64 {
        0
    }

    fn zeroings_repeated(&self) -> u64 {
        self.zeroings_repeated
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Matrix2;
    use trace::BendingResponse;

    use super::*;

    const RATE_HZ: f64 = 250.0;
    const MODULO: f64 = 65536.0;

    fn response() -> Matrix2<f64> {
        Matrix2::new(2e7, 5e6, -4e6, 3e7)
    }

    fn conversion() -> BendingCounts {
        let counts_per_n_m = BendingResponse::new(response()).expect("it can be inverted");
        let sensor = BendingSensor { counts_per_n_m, noise_sd_n_m: 1e-7 };
        BendingCounts::new(sensor, 1e-5, [2, 0], Some(MODULO), 1.0, Timing::default(), RATE_HZ)
    }

    /// Moments from constant counts above rest of `length_s` from `t_s` on, which arrive at the same times.
    fn converted(
        counts: &mut BendingCounts,
        t_s: f64,
        now_s: f64,
        length_s: f64,
        above: Vector2<f64>,
    ) -> Vec<Vector2<f64>> {
        let mut moments_n_m = Vec::new();
        for step in 0..=(length_s * RATE_HZ) as u32 {
            let since_s = f64::from(step) / RATE_HZ;
            let [first, second] = [65_500.0 + above.x, 20.0 + above.y].map(|count: f64| count.rem_euclid(MODULO));
            counts.take(Stream::Own, t_s + since_s, [second, 7.0, first], now_s + since_s);
            while let Some(converted) = counts.next(now_s + since_s) {
                if let Reading::Of(reading) = converted.reading {
                    moments_n_m.push(reading);
                }
            }
        }
        moments_n_m
    }

    #[test]
    fn verif_counts_of_both_channels_give_the_moments_across_a_wrap() {
        let mut counts = conversion();
        assert!(converted(&mut counts, 0.0, 0.0, 1.0, Vector2::zeros()).is_empty());
        let moment_n_m = Vector2::new(3e-6, -5e-6);
        let found = converted(&mut counts, 2.0, 2.0, 1.0, response() * moment_n_m);
        assert_eq!(found.len(), 251);
        assert!(found.iter().all(|found| (found - moment_n_m).norm() < 1e-15), "{found:?}");
    }

    #[test]
    fn robust_a_clock_set_back_to_the_zeroing_repeats_it() {
        let mut counts = conversion();
        converted(&mut counts, 0.0, 0.0, 1.0, Vector2::zeros());
        let offset = Vector2::new(300.0, -200.0);
        // Four counts precede the detection of the jump.
        converted(&mut counts, 2.0, 2.0, 1.0, offset);
        let at_rest = converted(&mut counts, 0.0, 3.004, 1.1, offset);
        assert_eq!(at_rest.len(), 4 + 21);
        assert!(at_rest[4..].iter().all(|moment| moment.norm() < 1e-12), "{at_rest:?}");
        // And once more.
        let at_rest = converted(&mut counts, 0.0, 4.108, 1.1, Vector2::zeros());
        assert_eq!(at_rest.len(), 4 + 21);
        assert!(at_rest[4..].iter().all(|moment| moment.norm() < 1e-12), "{at_rest:?}");
        counts.take(Stream::Own, 2.0, [f64::NAN, 0.0, 0.0], 5.0);
        assert_eq!((counts.next(5.0), counts.incomplete()), (None, 1));
    }

    #[test]
    fn robust_the_zeroing_is_repeated_while_the_whisker_is_not_free() {
        let mut counts = conversion();
        let pressed = response() * Vector2::new(5e-6, 0.0);
        converted(&mut counts, 0.0, 0.0, 0.5, pressed);
        converted(&mut counts, 0.504, 0.504, 0.5, Vector2::zeros());
        assert_eq!((counts.zeroing.zero(), counts.zeroings_repeated()), (None, 1));
        let found = converted(&mut counts, 1.008, 1.008, 1.1, Vector2::zeros());
        assert_eq!((found.len(), counts.zeroings_repeated()), (26, 1));
        assert!(found.iter().all(|found| found.norm() < 1e-15), "{found:?}");
    }

    #[test]
    fn robust_steps_of_a_converter_do_not_repeat_the_zeroing() {
        let sensor = BendingSensor { noise_sd_n_m: 0.0, ..conversion().sensor };
        let mut counts = BendingCounts { sensor, ..conversion() };
        converted(&mut counts, 0.0, 0.0, 0.5, Vector2::zeros());
        // 1.3 % of the largest moment.
        converted(&mut counts, 0.504, 0.504, 0.5, response() * Vector2::new(1e-7, 8e-8));
        assert!(counts.zeroing.zero().is_some());
    }
}
