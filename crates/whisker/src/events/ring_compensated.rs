//! Contacts from the *steadied* reading: the reading with the whisker's own swing taken out.
//!
//! While it is free the whisker is an oscillator. With its first mode's angular frequency w and damping ratio z the reading M obeys
//!
//! ```text
//! M'' / w^2 + 2 z M' / w + M = P
//! ```
//!
//! where P is the moment by which objects press on it and, small beside that, by which the base shakes it. After a release P falls to zero
//! at once, however long M rings on, and it rises at the next touch even while M still rings. So what is watched is P, smoothed by a Butterworth
//! low-pass of second order at 1.5 w without which its derivatives would drown in noise: one section, whose zeros lie on the whisker's own poles.
//! In contact the whisker is stiffer and follows the base, M changes slowly, and P is M.
//!
//! Where the sampling is too slow to show the swing, the reading itself is watched.

use std::f64::consts::{FRAC_1_SQRT_2, PI};

use serde::{Deserialize, Serialize};
use signal::{Cascade, Section};

use super::background_rms::BackgroundRms;
use super::median::MedianOfFive;
use super::{Rule, Sensing, Signals, first_mode_band};
use crate::face::Face;
use crate::settings::{SettingsError, within};

/// Edge of the low-pass over the whisker's natural frequency: the smaller, the less noise and the more delay.
const EDGE: f64 = 1.5;

/// A contact that has pressed this many times as much as the threshold is a firm one, whose drop noise does not feign.
const FIRM: f64 = 2.0;

/// Samples that a period of that edge needs at least.
const LEAST_SAMPLES: f64 = 8.0;

/// Settings. The thresholds are thresholds of the steadied reading.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Config {
    /// A touch starts above this many standard deviations of the measurement noise ...
    pub noise_sds: f64,
    /// ... and above this share of the largest calibrated reading ...
    pub largest_share: f64,
    /// ... and above this many standard deviations of what the free whisker has shown so far in the band of its swing, on a vibrating arm for
    /// example ...
    pub unrest_sds: f64,
    /// ... and above this share of the swing, which is what a frequency that is wrong by a tenth leaves of it ...
    pub swing_share: f64,
    /// ... for this many samples on end.
    pub touch_samples: u32,
    /// A touch ends where the steadied reading, smoothed, is below this share of the threshold, the swing left out ...
    pub release_share: f64,
    /// ... with this time constant; ...
    pub release_time_s: f64,
    /// ... or, after a firm contact, where no more than this share is left of what pressed within the last period of the swing ...
    pub drop_share: f64,
    /// ... for this many samples on end.
    pub drop_samples: u32,
    /// Time in which the swing is taken to fall to 1 / e.
    pub swing_decay_s: f64,
    /// Memory of the unrest.
    pub unrest_memory_s: f64,
    /// Time by which the unrest lags behind, so that a touch does not hide itself.
    pub unrest_lag_s: f64,
}

impl Default for Config {
    fn default() -> Self {
        Self {
            noise_sds: 5.0,
            largest_share: 0.01,
            unrest_sds: 7.0,
            swing_share: 0.3,
            touch_samples: 3,
            release_share: 0.3,
            release_time_s: 0.01,
            drop_share: 0.2,
            drop_samples: 2,
            swing_decay_s: 0.3,
            unrest_memory_s: 1.0,
            unrest_lag_s: 0.1,
        }
    }
}

impl Config {
    pub(super) fn validate(&self) -> Result<(), SettingsError> {
        within("noise_sds", self.noise_sds, 0.0..=1e3)?;
        within("largest_share", self.largest_share, 1e-6..=1.0)?;
        within("unrest_sds", self.unrest_sds, 0.0..=1e3)?;
        within("swing_share", self.swing_share, 0.0..=1.0)?;
        within("touch_samples", f64::from(self.touch_samples), 1.0..=1e6)?;
        within("release_share", self.release_share, 0.0..=1.0)?;
        within("release_time_s", self.release_time_s, 1e-4..=10.0)?;
        within("drop_share", self.drop_share, 0.0..=1.0)?;
        within("drop_samples", f64::from(self.drop_samples), 1.0..=1e6)?;
        within("swing_decay_s", self.swing_decay_s, 1e-3..=100.0)?;
        within("unrest_memory_s", self.unrest_memory_s, 1e-2..=100.0)?;
        within("unrest_lag_s", self.unrest_lag_s, 0.0..=10.0)
    }
}

/// A contact. Moments are positive towards the object's side.
#[derive(Clone, Copy, Debug)]
struct Touched {
    face: Face,
    smoothed_n_m: f64,
    /// What pressed on the whisker lately.
    held_n_m: f64,
}

/// The rule of [`Config`].
#[derive(Clone, Debug)]
pub(super) struct RingCompensated {
    config: Config,
    median: MedianOfFive,
    steady: Cascade,
    /// The band in which unrest shows; a slow touch does not.
    band: Option<Cascade>,
    base_n_m: f64,
    unrest: BackgroundRms,
    /// How far the whisker swings, were it free now.
    swing_n_m: f64,
    /// What is left of the swing after a sample.
    swing_left: f64,
    touched: Option<Touched>,
    smoothing: f64,
    /// What is left after a sample of what pressed lately.
    held_left: f64,
    /// Samples on end that speak for a touch, or for a drop.
    in_favour: u32,
}

impl RingCompensated {
    pub(super) fn new(config: Config, sensing: &Sensing) -> Self {
        let steady = Cascade::new(swing_remover(sensing).into_iter().collect());
        let noise_n_m = MedianOfFive::noise_gain(|mean_over| steady.noise_gain(mean_over)) * sensing.noise_sd_n_m;
        let base_n_m = (config.noise_sds * noise_n_m).max(config.largest_share * sensing.largest_reading_n_m);
        let start_n_m = if config.unrest_sds > 0.0 { base_n_m / config.unrest_sds } else { 0.0 };
        let lag = (config.unrest_lag_s * sensing.rate_hz).round() as usize;
        Self {
            config,
            median: MedianOfFive::default(),
            steady,
            band: first_mode_band(sensing).ok().map(Cascade::new),
            base_n_m,
            unrest: BackgroundRms::new(start_n_m, config.unrest_memory_s * sensing.rate_hz, lag),
            swing_n_m: 0.0,
            swing_left: (-1.0 / (sensing.rate_hz * config.swing_decay_s)).exp(),
            touched: None,
            smoothing: 1.0 - (-1.0 / (sensing.rate_hz * config.release_time_s)).exp(),
            held_left: (-sensing.first_mode.frequency_hz / sensing.rate_hz).exp(),
            in_favour: 0,
        }
    }
}

impl Rule for RingCompensated {
    fn settle(&mut self, reading_n_m: f64) {
        self.median.settle(reading_n_m);
        self.steady.settle(reading_n_m);
        if let Some(band) = &mut self.band {
            band.settle(reading_n_m);
        }
        self.unrest.interrupt();
        self.swing_n_m = 0.0;
        self.touched = None;
        self.in_favour = 0;
    }

    fn step(&mut self, reading_n_m: f64) -> Signals {
        let config = &self.config;
        let reading_n_m = self.median.step(reading_n_m);
        let steadied_n_m = self.steady.step(reading_n_m);
        let unrest_n_m = self.band.as_mut().map_or(0.0, |band| band.step(steadied_n_m));
        self.swing_n_m = reading_n_m.abs().max(self.swing_left * self.swing_n_m);
        let restless_n_m = self.base_n_m.max(config.unrest_sds * self.unrest.sd());
        let threshold_n_m = match &mut self.touched {
            Some(Touched { face, smoothed_n_m, held_n_m }) => {
                let pressing_n_m = face.away_sign() * steadied_n_m;
                *smoothed_n_m += self.smoothing * (pressing_n_m - *smoothed_n_m);
                *held_n_m = pressing_n_m.max(self.held_left * *held_n_m);
                let drop_n_m = if *held_n_m > FIRM * restless_n_m { config.drop_share * *held_n_m } else { 0.0 };
                let release_n_m = config.release_share * restless_n_m;
                self.in_favour = if pressing_n_m < drop_n_m { self.in_favour + 1 } else { 0 };
                if *smoothed_n_m < release_n_m || self.in_favour >= config.drop_samples {
                    self.touched = None;
                    self.in_favour = 0;
                }
                release_n_m.max(drop_n_m)
            }
            None => {
                let touch_n_m = restless_n_m.max(config.swing_share * self.swing_n_m);
                // What is far out is rather the start of a touch than unrest.
                let most_n_m = FRAC_1_SQRT_2 * touch_n_m;
                self.unrest.watch(unrest_n_m.clamp(-most_n_m, most_n_m));
                self.in_favour = if steadied_n_m.abs() > touch_n_m { self.in_favour + 1 } else { 0 };
                if self.in_favour >= config.touch_samples {
                    let pressing_n_m = steadied_n_m.abs();
                    let face = Face::of_reading(steadied_n_m);
                    self.touched = Some(Touched { face, smoothed_n_m: pressing_n_m, held_n_m: pressing_n_m });
                    self.unrest.interrupt();
                    self.in_favour = 0;
                }
                touch_n_m
            }
        };
        let touched = self.touched.map(|touched| touched.face);
        Signals { watched_n_m: steadied_n_m, threshold_n_m, touched }
    }
}

/// The section that turns the reading into what presses on the whisker; none where the sampling is too slow for it.
fn swing_remover(sensing: &Sensing) -> Option<Section> {
    let first_mode = sensing.first_mode;
    if sensing.rate_hz < LEAST_SAMPLES * EDGE * first_mode.frequency_hz {
        return None;
    }
    // The bilinear transform s = k (z - 1) / (z + 1), with k such that the whisker's frequency stays in its place.
    let tangent = (PI * first_mode.frequency_hz / sensing.rate_hz).tan();
    // s^2 / w^2 + 2 d s / w + 1 times (z + 1)^2, for w = `over` times the whisker's, as coefficients of z^2, z and 1.
    let polynomial = |over: f64, damping_ratio: f64| {
        let k = 1.0 / (over * tangent);
        [k * k + 2.0 * damping_ratio * k + 1.0, 2.0 - 2.0 * k * k, k * k - 2.0 * damping_ratio * k + 1.0]
    };
    let (above, below) = (polynomial(1.0, first_mode.damping_ratio), polynomial(EDGE, FRAC_1_SQRT_2));
    Some(Section { b: above.map(|value| value / below[0]), a: [below[1] / below[0], below[2] / below[0]] })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::events::first_mode::FirstMode;

    const SENSING: Sensing = Sensing {
        rate_hz: 250.0,
        noise_sd_n_m: 1e-7,
        largest_reading_n_m: 5e-5,
        first_mode: FirstMode { frequency_hz: 7.89, damping_ratio: 0.058 },
    };

    #[test]
    fn verif_ringing_vanishes_and_a_press_stays() {
        let mut steady = Cascade::new(vec![swing_remover(&SENSING).unwrap()]);
        let w = 2.0 * PI * SENSING.first_mode.frequency_hz;
        let ringing = |t: f64| {
            (-SENSING.first_mode.damping_ratio * w * t).exp() * (w * (1.0_f64 - 0.058 * 0.058).sqrt() * t).cos()
        };
        let mut worst: f64 = 0.0;
        for sample in 0..500 {
            let t = f64::from(sample) / 250.0;
            let steadied = steady.step(ringing(t));
            if t > 0.1 {
                worst = worst.max(steadied.abs());
            }
        }
        assert!(worst < 0.02, "{worst} of the ringing is left");
        steady.settle(1.0);
        assert!((steady.step(1.0) - 1.0).abs() < 1e-12);
    }

    #[test]
    fn verif_too_slow_a_sampling_leaves_the_reading_alone() {
        assert!(swing_remover(&Sensing { rate_hz: 60.0, ..SENSING }).is_none());
    }
}
