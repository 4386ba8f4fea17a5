//! When a sample was taken, from when it arrived.
//!
//! A sensor samples evenly; its samples arrive late by whatever USB and the scheduler add, some of them several at once. A
//! delay-locked loop of second order follows the arrivals: F. Adriaensen, "Using a DLL to filter time" (Linux Audio Conference 2005). With `e`
//! the arrival minus the predicted time, `w = 2 pi BANDWIDTH_HZ T` and `T` the period,
//!
//! ```text
//! next = t + T + sqrt(2) w e        T <- T + w^2 e
//! ```
//!
//! It begins with the nominal period and finds the true one, as of a sensor that is said to run at 800 Hz and runs at 888. The mean delay
//! of the arrivals cannot be told from the samples and stays in the times.

use std::f64::consts::{SQRT_2, TAU};

/// Changes of the rate slower than this are followed, faster ones are taken for jitter.
const BANDWIDTH_HZ: f64 = 0.5;
/// A sample that is this far from its predicted time was not delayed: the sensor paused. Counting begins anew.
const PAUSE_S: f64 = 0.1;
/// How far the rate may be from the nominal one, either way.
const MOST_OFF: f64 = 2.0;

/// Stamps samples with times that increase strictly.
#[derive(Clone, Debug)]
pub struct SampleClock {
    nominal_s: f64,
    period_s: f64,
    last_s: f64,
    next_s: f64,
    pauses: u64,
}

impl SampleClock {
    /// One for a sensor of this nominal rate.
    pub fn new(rate_hz: f64) -> Self {
        let nominal_s = 1.0 / rate_hz;
        Self { nominal_s, period_s: nominal_s, last_s: f64::NEG_INFINITY, next_s: f64::NAN, pauses: 0 }
    }

    /// Times of some samples that arrived together at `arrival_s`, the last of them just then.
    pub fn stamp(&mut self, arrival_s: f64, samples: usize) -> impl Iterator<Item = f64> + '_ {
        // Samples that waited somewhere to be read arrived a period apart from one another before.
        let spacing_s = self.period_s;
        let stamped = move |behind| self.next(arrival_s - behind as f64 * spacing_s);
        // Whole microseconds, as logs keep them: what is recorded, in whatever way, and what is told live have the very same times.
        (0..samples).rev().map(stamped).map(|t_s| (1e6 * t_s).round() / 1e6)
    }

    fn next(&mut self, arrival_s: f64) -> f64 {
        if self.next_s.is_nan() {
            self.next_s = arrival_s;
        }
        let mut error_s = arrival_s - self.next_s;
        if error_s.abs() > PAUSE_S {
            self.pauses += 1;
            self.next_s = arrival_s.max(self.last_s + 0.25 * self.nominal_s);
            error_s = 0.0;
        }
        self.last_s = self.next_s;
        let w = TAU * BANDWIDTH_HZ * self.period_s;
        // However far it is to go back, time goes on.
        self.next_s += (self.period_s + SQRT_2 * w * error_s).max(0.25 * self.period_s);
        self.period_s = (self.period_s + w * w * error_s).clamp(self.nominal_s / MOST_OFF, self.nominal_s * MOST_OFF);
        self.last_s
    }

    /// The rate that it has found.
    pub fn rate_hz(&self) -> f64 {
        1.0 / self.period_s
    }

    /// How often the sensor paused.
    pub fn pauses(&self) -> u64 {
        self.pauses
    }
}

#[cfg(test)]
mod tests {
    use rand::{RngExt, SeedableRng};
    use rand_distr::Exp1;
    use rand_pcg::Pcg64;

    use super::*;

    /// True and stamped times of a sensor of `rate_hz`, whose samples are delayed at random by `delay_s` on the mean.
    fn stamped(rate_hz: f64, delay_s: f64) -> Vec<(f64, f64)> {
        let (mut clock, mut rng) = (SampleClock::new(800.0), Pcg64::seed_from_u64(1));
        let mut arrival_s = 0.0_f64;
        let times = (0..(20.0 * rate_hz) as usize).map(|k| k as f64 / rate_hz).map(|true_s| {
            let delay_s: f64 = delay_s * rng.sample::<f64, _>(Exp1);
            arrival_s = arrival_s.max(true_s + delay_s);
            let stamped_s = clock.stamp(arrival_s, 1).next().expect("one");
            (true_s, stamped_s)
        });
        times.collect()
    }

    #[test]
    fn val_jitter_is_taken_out_and_the_true_rate_found() {
        for rate_hz in [800.0, 888.0] {
            let times = stamped(rate_hz, 1e-3);
            assert!(times.windows(2).all(|pair| pair[1].1 > pair[0].1), "times increase");
            let late: Vec<_> =
                times.iter().filter(|(true_s, _)| *true_s > 10.0).map(|(true_s, s)| s - true_s).collect();
            let mean = late.iter().sum::<f64>() / late.len() as f64;
            let sd = (late.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / late.len() as f64).sqrt();
            // The arrivals scatter by a millisecond.
            assert!(sd < 0.15e-3, "{rate_hz}: {sd}");
            assert!(mean > 0.0 && mean < 3e-3, "{rate_hz}: {mean}");
        }
    }

    #[test]
    fn robust_a_burst_is_no_pause_and_a_pause_is_one() {
        let mut clock = SampleClock::new(800.0);
        let mut stamp = |arrival_s: f64, samples: usize| clock.stamp(arrival_s, samples).collect::<Vec<_>>();
        (0..800).for_each(|k| assert_eq!(stamp(f64::from(k) / 800.0, 1).len(), 1));
        // The reader slept for half a second.
        let burst = stamp(1.5 - 1.0 / 800.0, 400);
        assert!((burst[0] - 1.0).abs() < 1e-3 && (burst[399] - 1.49875).abs() < 1e-3, "{burst:?}");
        // The sensor did.
        let after = stamp(2.5, 1);
        assert!((after[0] - 2.5).abs() < 1e-9);
        assert_eq!(clock.pauses(), 1);
    }
}
