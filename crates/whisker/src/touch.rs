//! Whether the whisker touches something, told from the reading alone, sample by sample.

use serde::{Deserialize, Serialize};

use crate::estimators::SettingsError;
use crate::estimators::settings::within;

/// Settings of the [`TouchDetector`].
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct TouchConfig {
    /// A touch starts where the reading exceeds this many standard deviations of the measurement noise ...
    pub threshold_sds: f64,
    /// ... and this share of the largest calibrated reading, so that a whisker that swings freely is no touch ...
    pub threshold_share: f64,
    /// ... for this many samples on end.
    pub samples: u32,
    /// A touch ends where the smoothed reading falls below this share of the threshold, or changes its sign.
    pub release_share: f64,
    /// Time constant of that smoothing.
    pub release_time_s: f64,
}

impl Default for TouchConfig {
    fn default() -> Self {
        Self { threshold_sds: 5.0, threshold_share: 0.01, samples: 2, release_share: 0.3, release_time_s: 0.04 }
    }
}

impl TouchConfig {
    /// Checks every value.
    ///
    /// # Errors
    /// [`SettingsError`] names the first that is out of range.
    pub fn validate(&self) -> Result<(), SettingsError> {
        within("threshold_sds", self.threshold_sds, 0.0..=1e3)?;
        within("threshold_share", self.threshold_share, 1e-6..=1.0)?;
        within("samples", f64::from(self.samples), 1.0..=1e6)?;
        within("release_share", self.release_share, 0.0..=1.0)?;
        within("release_time_s", self.release_time_s, 1e-4..=10.0)
    }
}

/// Tells touch from free motion by a threshold with hysteresis.
#[derive(Clone, Debug, PartialEq)]
pub struct TouchDetector {
    config: TouchConfig,
    threshold_n_m: f64,
    above: u32,
    /// Smoothed reading, signed so that it is positive in the present touch; nothing while free.
    smoothed: Option<Smoothed>,
}

#[derive(Clone, Copy, Debug, PartialEq)]
struct Smoothed {
    sign: f64,
    value_n_m: f64,
}

impl TouchDetector {
    /// A detector for a sensor with measurement noise of standard deviation `noise_sd_n_m` that was calibrated up to
    /// `largest_reading_n_m`.
    pub fn new(config: TouchConfig, noise_sd_n_m: f64, largest_reading_n_m: f64) -> Self {
        let threshold_n_m = (config.threshold_sds * noise_sd_n_m).max(config.threshold_share * largest_reading_n_m);
        Self { config, threshold_n_m, above: 0, smoothed: None }
    }

    /// Takes the next reading, `dt_s` after the last, and says whether the whisker touches.
    pub fn step(&mut self, reading_n_m: f64, dt_s: f64) -> bool {
        match &mut self.smoothed {
            Some(smoothed) => {
                let gain = 1.0 - (-dt_s / self.config.release_time_s).exp();
                smoothed.value_n_m += gain * (smoothed.sign * reading_n_m - smoothed.value_n_m);
                if smoothed.value_n_m < self.config.release_share * self.threshold_n_m {
                    self.smoothed = None;
                    self.above = 0;
                }
            }
            None => {
                self.above = if reading_n_m.abs() > self.threshold_n_m { self.above + 1 } else { 0 };
                if self.above >= self.config.samples {
                    self.smoothed = Some(Smoothed { sign: reading_n_m.signum(), value_n_m: reading_n_m.abs() });
                }
            }
        }
        self.smoothed.is_some()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn detector() -> TouchDetector {
        TouchDetector::new(TouchConfig::default(), 1e-7, 1e-5)
    }

    #[test]
    fn verif_noise_is_no_touch_and_a_push_is() {
        let mut detector = detector();
        for i in 0..1000 {
            assert!(!detector.step(3e-7 * f64::from(i).sin(), 0.004));
        }
        assert!(!detector.step(-6e-7, 0.004));
        assert!(detector.step(-7e-7, 0.004));
    }

    #[test]
    fn verif_one_spike_is_no_touch() {
        let mut detector = detector();
        assert!(!detector.step(1e-5, 0.004));
        assert!(!detector.step(0.0, 0.004));
    }

    #[test]
    fn verif_release_ends_the_touch() {
        let mut detector = detector();
        for _ in 0..100 {
            detector.step(5e-6, 0.004);
        }
        let held = (0..).take_while(|_| detector.step(0.0, 0.004)).count();
        assert!((10..60).contains(&held), "held for {held} samples");
    }
}
