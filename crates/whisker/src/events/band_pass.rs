//! Contact detection as in Lin et al. (IROS 2022): a released whisker rings, which a band-pass around its natural
//! frequency detects.
//!
//! A touch starts when the reading exceeds a threshold while the whisker does not ring. It ends when the band-passed
//! reading exceeds its own threshold, or when the reading decays without ringing. The publication names the filter, a
//! Butterworth band-pass of sixth order, but neither band nor threshold: here the band is half to twice the natural
//! frequency \[inferred\], and the thresholds follow from the noise and the calibration. If the sampling rate is too
//! low for the band, only the reading is used.

use serde::{Deserialize, Serialize};
use signal::Cascade;

use super::{Rule, Sensing, Signals, first_mode_band};
use crate::face::Face;
use crate::settings::{SettingsError, within};

/// Settings.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Config {
    /// Threshold of the reading and of the band-passed reading, in standard deviations of the measurement noise in each
    /// ...
    pub noise_sds: f64,
    /// ... but at least this share of the largest calibrated reading.
    pub largest_share: f64,
    /// A touch starts when the reading exceeds its threshold for this many consecutive samples.
    pub touch_samples: u32,
    /// A touch ends, if not by ringing, when the smoothed reading falls below this share of the threshold.
    pub release_share: f64,
    /// Time constant of that smoothing.
    pub release_time_s: f64,
}

impl Default for Config {
    fn default() -> Self {
        Self { noise_sds: 5.0, largest_share: 0.02, touch_samples: 2, release_share: 0.3, release_time_s: 0.04 }
    }
}

impl Config {
    pub(super) fn validate(&self) -> Result<(), SettingsError> {
        within("noise_sds", self.noise_sds, 0.0..=1e3)?;
        within("largest_share", self.largest_share, 1e-6..=1.0)?;
        within("touch_samples", f64::from(self.touch_samples), 1.0..=1e6)?;
        within("release_share", self.release_share, 0.0..=1.0)?;
        within("release_time_s", self.release_time_s, 1e-4..=10.0)
    }
}

/// Detector of [`Config`].
#[derive(Clone, Debug)]
pub(super) struct BandPass {
    config: Config,
    band: Option<Cascade>,
    threshold_n_m: f64,
    ringing_n_m: f64,
    smoothing: f64,
    /// Samples for which the band-passed reading must stay below its threshold for the whisker to count as quiet: one
    /// period.
    quiet_samples: u32,
    quiet: u32,
    above: u32,
    touched: Option<Touched>,
}

#[derive(Clone, Copy, Debug)]
struct Touched {
    face: Face,
    /// Smoothed reading, positive towards the object's side.
    smoothed_n_m: f64,
}

impl BandPass {
    pub(super) fn new(config: Config, sensing: &Sensing) -> Self {
        let band = first_mode_band(sensing).ok().map(Cascade::new);
        let gain = band.as_ref().map_or(1.0, |band| band.noise_gain(1));
        let threshold_n_m = |gain: f64| {
            (config.noise_sds * gain * sensing.noise_sd_n_m).max(config.largest_share * sensing.largest_reading_n_m)
        };
        let quiet_samples = (sensing.rate_hz / sensing.first_mode.frequency_hz).round() as u32;
        Self {
            config,
            band,
            threshold_n_m: threshold_n_m(1.0),
            ringing_n_m: threshold_n_m(gain),
            smoothing: 1.0 - (-1.0 / (sensing.rate_hz * config.release_time_s)).exp(),
            quiet_samples,
            quiet: quiet_samples,
            above: 0,
            touched: None,
        }
    }
}

impl Rule for BandPass {
    fn settle(&mut self, reading_n_m: f64) {
        if let Some(band) = &mut self.band {
            band.settle(reading_n_m);
        }
        self.quiet = self.quiet_samples;
        self.above = 0;
        self.touched = None;
    }

    fn step(&mut self, reading_n_m: f64) -> Signals {
        let ringing_n_m = self.band.as_mut().map_or(0.0, |band| band.step(reading_n_m));
        self.quiet = if ringing_n_m.abs() > self.ringing_n_m { 0 } else { self.quiet.saturating_add(1) };
        match &mut self.touched {
            Some(Touched { face, smoothed_n_m }) => {
                *smoothed_n_m += self.smoothing * (face.away_sign() * reading_n_m - *smoothed_n_m);
                if self.quiet == 0 || *smoothed_n_m < self.config.release_share * self.threshold_n_m {
                    self.touched = None;
                    self.above = 0;
                }
            }
            None => {
                let counts = reading_n_m.abs() > self.threshold_n_m && self.quiet >= self.quiet_samples;
                self.above = if counts { self.above + 1 } else { 0 };
                if self.above >= self.config.touch_samples {
                    self.touched =
                        Some(Touched { face: Face::of_reading(reading_n_m), smoothed_n_m: reading_n_m.abs() });
                }
            }
        }
        Signals {
            watched_n_m: ringing_n_m,
            threshold_n_m: self.ringing_n_m,
            touched: self.touched.map(|touched| touched.face),
        }
    }
}
