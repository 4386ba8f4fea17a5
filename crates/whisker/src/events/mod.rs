//! Contact events: the first touch, the lost contact, the next touch, told from the reading alone, sample by sample.
//!
//! A whisker that is released rings at its natural frequency, first as far as it was deflected, for a second or more. A [`ContactDetector`] must
//! neither take that for touches nor miss the touch that comes meanwhile. How it judges is one of [`DETECTORS`].
//!
//! Filters want readings at equal intervals: those of the recording's nominal rate. Where a recording skips some, the gap is filled in a straight
//! line; after a gap of more than [`LONGEST_GAP_S`] nothing is known any more and detection starts anew. A recording without a clock has the nominal rate that it
//! is given; if that is too low to show the whisker's swing, detectors judge the reading itself.
//!
//! That the contact has reached the tip is told by an estimate of its place, not by the reading: see
//! [`Estimate::at_tip`](crate::estimators::Estimate::at_tip).
//!
//! To add a detector: one file with a [`Rule`], a variant of [`TouchConfig`] and a row in [`DETECTORS`].

mod background_rms;
mod band_pass;
mod first_mode;
mod median;
mod ring_compensated;

use std::fmt::Debug;
use std::mem::discriminant;

use serde::{Deserialize, Serialize};
use signal::{LONGEST_GAP_S, NoSuchBand, Section, band_pass};

use crate::Whisker;
use crate::face::Face;
use crate::settings::SettingsError;

pub use first_mode::FirstMode;

/// How contacts are detected, with the settings of that way.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "detector", rename_all = "kebab-case")]
pub enum TouchConfig {
    /// By the reading with the whisker's swing taken out.
    RingCompensated(ring_compensated::Config),
    /// By a band-pass, as published.
    BandPass(band_pass::Config),
}

impl Default for TouchConfig {
    fn default() -> Self {
        Self::RingCompensated(ring_compensated::Config::default())
    }
}

impl TouchConfig {
    /// Checks every value.
    ///
    /// # Errors
    /// [`SettingsError`] names the first that is out of range.
    pub fn validate(&self) -> Result<(), SettingsError> {
        match self {
            Self::RingCompensated(config) => config.validate(),
            Self::BandPass(config) => config.validate(),
        }
    }

    /// Whether these are settings of a registered detector.
    pub fn is_of(&self, row: &DetectorRow) -> bool {
        discriminant(self) == discriminant(&(row.config)())
    }

    fn rule(self, sensing: &Sensing) -> Box<dyn Rule> {
        match self {
            Self::RingCompensated(config) => Box::new(ring_compensated::RingCompensated::new(config, sensing)),
            Self::BandPass(config) => Box::new(band_pass::BandPass::new(config, sensing)),
        }
    }
}

/// A row of the registry of detectors.
#[derive(Clone, Copy, Debug)]
pub struct DetectorRow {
    /// Name, the `detector` of its settings.
    pub name: &'static str,
    /// One line about it.
    pub about: &'static str,
    /// Its default settings.
    pub config: fn() -> TouchConfig,
}

/// The registry of detectors; the first is the default.
pub const DETECTORS: &[DetectorRow] = &[
    DetectorRow {
        name: "steadied",
        about: "thresholds on the reading with the whisker's own swing taken out",
        config: || TouchConfig::RingCompensated(ring_compensated::Config::default()),
    },
    DetectorRow {
        name: "band-pass",
        about: "thresholds on the reading and on its Butterworth band-pass of sixth order (Lin et al. 2022)",
        config: || TouchConfig::BandPass(band_pass::Config::default()),
    },
];

/// What a detector is fitted to.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sensing {
    /// Readings a second.
    pub rate_hz: f64,
    /// Standard deviation of the measurement noise.
    pub noise_sd_n_m: f64,
    /// Largest calibrated reading.
    pub largest_reading_n_m: f64,
    /// How the free whisker swings.
    pub first_mode: FirstMode,
}

impl Sensing {
    /// With this whisker.
    pub fn new(whisker: &Whisker, rate_hz: f64, noise_sd_n_m: f64, largest_reading_n_m: f64) -> Self {
        Self { rate_hz, noise_sd_n_m, largest_reading_n_m, first_mode: FirstMode::of(whisker) }
    }
}

/// Order of the prototype of [`first_mode_band`], half that of the band-pass.
const BAND_ORDER: usize = 3;

/// Edges of that band over the whisker's natural frequency.
const BAND: [f64; 2] = [0.5, 2.0];

/// The Butterworth band-pass of sixth order in which the whisker's ringing shows.
fn first_mode_band(sensing: &Sensing) -> Result<Vec<Section>, NoSuchBand> {
    let [low_hz, high_hz] = BAND.map(|edge| edge * sensing.first_mode.frequency_hz);
    band_pass(BAND_ORDER, low_hz, high_hz, sensing.rate_hz)
}

/// What a detector saw and concluded at one sample.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Signals {
    /// The filtered reading that was judged.
    pub watched_n_m: f64,
    /// The threshold that its absolute value was held against.
    pub threshold_n_m: f64,
    /// The side on which the object lies, while the whisker touches.
    pub touched: Option<Face>,
}

/// A way to judge readings at equal intervals.
pub trait Rule: Debug + Send {
    /// Starts anew, free, as if the reading had stood at this value for ever.
    fn settle(&mut self, reading_n_m: f64);

    /// Takes the next reading.
    fn step(&mut self, reading_n_m: f64) -> Signals;
}

/// Tells touch from free motion, sample by sample.
#[derive(Debug)]
pub struct ContactDetector {
    rule: Box<dyn Rule>,
    rate_hz: f64,
    last: Option<(f64, Signals)>,
}

impl ContactDetector {
    /// A detector of these settings, fitted to what senses.
    pub fn new(config: TouchConfig, sensing: &Sensing) -> Self {
        Self { rule: config.rule(sensing), rate_hz: sensing.rate_hz, last: None }
    }

    /// Takes the next reading, `dt_s` after the last, and says on which side the object lies while the whisker touches. Ringing can give the reading the
    /// other sign for a while.
    pub fn step(&mut self, reading_n_m: f64, dt_s: f64) -> Option<Face> {
        self.judge(reading_n_m, dt_s).touched
    }

    /// The same, with all that was seen.
    pub fn judge(&mut self, reading_n_m: f64, dt_s: f64) -> Signals {
        let known = self.last.filter(|_| dt_s <= LONGEST_GAP_S);
        let signals = match known {
            None => {
                self.rule.settle(reading_n_m);
                self.rule.step(reading_n_m)
            }
            Some((from_n_m, mut signals)) => {
                let steps = (dt_s * self.rate_hz).round().max(1.0);
                for step in 1..=steps as usize {
                    let share = step as f64 / steps;
                    signals = self.rule.step(from_n_m + share * (reading_n_m - from_n_m));
                }
                signals
            }
        };
        self.last = Some((reading_n_m, signals));
        signals
    }
}
