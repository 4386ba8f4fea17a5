//! Time stamps of samples from their arrival times.
//!
//! A sensor samples at equal intervals; USB and the scheduler delay the arrivals by a varying time and deliver several
//! samples at once. A delay-locked loop of second order filters the arrivals: F. Adriaensen, "Using a DLL to filter
//! time" (Linux Audio Conference 2005). With `e` the arrival minus the predicted time, `w = 2 pi BANDWIDTH_HZ T` and
//! `T` the period,
//!
//! ```text
//! next = t + T + sqrt(2) w e        T <- T + w^2 e
//! ```
//!
//! It starts at the nominal period and converges to the true one, for example 888 Hz instead of 800 Hz. The mean delay
//! of the arrivals is unobservable and remains in the times.

use std::f64::consts::{SQRT_2, TAU};

/// Bandwidth of the loop: slower changes of the rate are followed, faster ones are jitter.
const BANDWIDTH_HZ: f64 = 0.5;
/// Difference from the predicted time above which the sensor has paused and the loop restarts (s).
const PAUSE_S: f64 = 0.1;
/// Largest ratio between true and nominal rate, in either direction.
const MOST_OFF: f64 = 2.0;

/// Clock that assigns strictly increasing times to samples.
#[derive(Clone, Debug)]
pub struct SampleClock {
    nominal_s: f64,
    period_s: f64,
    last_s: f64,
    next_s: f64,
    pauses: u64,
}

impl SampleClock {
    /// Clock of a sensor with this nominal rate (Hz).
    pub fn new(rate_hz: f64) -> Self {
        let nominal_s = 1.0 / rate_hz;
        Self { nominal_s, period_s: nominal_s, last_s: f64::NEG_INFINITY, next_s: f64::NAN, pauses: 0 }
    }

    /// Times of samples that arrived together, the last of them at `arrival_s` (s).
    pub fn stamp(&mut self, arrival_s: f64, samples: usize) -> impl Iterator<Item = f64> + '_ {
        // The earlier samples of a group were taken one period apart.
        let spacing_s = self.period_s;
        let stamped = move |behind| self.next(arrival_s - behind as f64 * spacing_s);
        // Whole microseconds, as in logs, so that logs, recordings and live inference have identical times.
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
        // Times increase strictly, even if the loop steps back.
        self.next_s += (self.period_s + SQRT_2 * w * error_s).max(0.25 * self.period_s);
        self.period_s = (self.period_s + w * w * error_s).clamp(self.nominal_s / MOST_OFF, self.nominal_s * MOST_OFF);
        self.last_s
    }

    /// Estimated rate (Hz).
    pub fn rate_hz(&self) -> f64 {
        1.0 / self.period_s
    }

    /// Number of pauses of the sensor.
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
    fn val_jitter_is_removed_and_the_true_rate_estimated() {
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
    fn robust_a_burst_is_not_a_pause() {
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
