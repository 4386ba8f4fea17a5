//! How fast samples come, by their own times.

use signal::LONGEST_GAP_S;

/// Rates may differ by this share: slopes count samples, and a distance is off by about as much as its slope.
const SHARE: f64 = 0.05;

/// Counts the samples of a stream, gaps left out.
#[derive(Clone, Copy, Debug, Default)]
pub struct Rate {
    last_s: Option<f64>,
    steps: u64,
    time_s: f64,
}

impl Rate {
    /// Takes the time of the next sample.
    pub fn step(&mut self, t_s: f64) {
        let step_s = t_s - self.last_s.replace(t_s).unwrap_or(f64::NAN);
        if (0.0..=LONGEST_GAP_S).contains(&step_s) {
            self.steps += 1;
            self.time_s += step_s;
        }
    }

    /// Samples a second; not a number, or infinite, where no time has passed.
    pub fn hz(&self) -> f64 {
        self.steps as f64 / self.time_s
    }
}

/// Whether a calibration at one rate holds for samples at another.
pub fn is_same_rate(found_hz: f64, expected_hz: f64) -> bool {
    (1.0 - SHARE..=1.0 + SHARE).contains(&(found_hz / expected_hz))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn verif_gaps_and_repeated_times_do_not_slow_it_down() {
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
