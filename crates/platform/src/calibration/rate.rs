//! Sampling rate of a stream by the times of its samples.

use signal::LONGEST_GAP_S;

/// Largest relative difference of two equal rates. Slopes are proportional to the rate, and the relative error of a distance is about that of its slope.
const SHARE: f64 = 0.05;

/// Estimator of the sampling rate, without gaps.
#[derive(Clone, Copy, Debug, Default)]
pub struct Rate {
    last_s: Option<f64>,
    steps: u64,
    time_s: f64,
}

impl Rate {
    /// Adds the time of the next sample (s).
    pub fn step(&mut self, t_s: f64) {
        let step_s = t_s - self.last_s.replace(t_s).unwrap_or(f64::NAN);
        if (0.0..=LONGEST_GAP_S).contains(&step_s) {
            self.steps += 1;
            self.time_s += step_s;
        }
    }

    /// Sampling rate (Hz); not a number, or infinite, if no time has passed.
    pub fn hz(&self) -> f64 {
        self.steps as f64 / self.time_s
    }
}

/// Whether a calibration at one rate is valid at another.
pub fn is_same_rate(found_hz: f64, expected_hz: f64) -> bool {
    (1.0 - SHARE..=1.0 + SHARE).contains(&(found_hz / expected_hz))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn verif_gaps_and_repeated_times_do_not_change_the_rate() {
        let mut rate = Rate::default();
        assert!(!is_same_rate(rate.hz(), 800.0));
        for k in 0..1000 {
            // Two samples at a time, and an hour between the halves.
            rate.step(f64::from(k / 2) / 400.0 + if k < 500 { 0.0 } else { 3600.0 });
        }
        assert!(is_same_rate(rate.hz(), 800.0) && (rate.hz() - 800.0).abs() < 4.0, "{}", rate.hz());
        assert!(!is_same_rate(rate.hz(), 888.0));
    }
}
