//! Contact detection: first touch, loss of contact and renewed touch, from the reading alone, sample by sample.
//!
//! A released whisker rings at its natural frequency, initially with the amplitude of its deflection, for a second or
//! more. A [`ContactDetector`] must neither report the ringing as touches nor miss a touch that occurs meanwhile. Its
//! methods are the rows of [`DETECTORS`].
//!
//! Filters require readings at equal intervals: those of the recording's nominal rate. Missing samples are interpolated
//! linearly; after a gap of more than [`LONGEST_GAP_S`] detection restarts. Readings beyond the [`ReadingGate`] count
//! as missing. A recording without a clock has the nominal rate that it is given; if that is too low for the whisker's
//! first mode, detectors use the reading itself.
//!
//! The sensor's offset is estimated from the free whisker in the first 0.1 s of a recording and subtracted from the later readings
//! ([`ContactDetector::rest_reading_n_m`]). During this time, a touch is detected only if the reading exceeds the largest plausible
//! offset, 3 % of the largest calibrated reading.
//!
//! Contact at the tip follows from an estimate of the contact, not from the reading: see
//! [`Estimate::at_tip`](crate::estimators::Estimate::at_tip).
//!
//! To add a detector: one file with a [`Rule`], a variant of [`TouchConfig`] and a row in [`DETECTORS`].

mod background_rms;
mod band_pass;
mod first_mode;
mod median;
mod rest_reading;
mod ring_compensated;

use std::fmt::Debug;
use std::mem::discriminant;

use serde::{Deserialize, Serialize};
use signal::{LONGEST_GAP_S, NoSuchBand, Section, band_pass};

use crate::face::Face;
use crate::settings::SettingsError;
use crate::{ReadingGate, Whisker};
use rest_reading::RestReading;

pub use first_mode::FirstMode;

/// Method of contact detection, with its settings.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "detector", rename_all = "kebab-case")]
pub enum TouchConfig {
    /// Thresholds on the ring-compensated reading.
    #[serde(alias = "steadied")]
    RingCompensated(ring_compensated::Config),
    /// Thresholds on the reading and its band-pass, as published.
    BandPass(band_pass::Config),
}

/// Former names of a detector and of its settings, which are still accepted, each with its present name.
pub const FORMER_NAMES: [(&str, &str); 6] = [
    ("steadied", "ring-compensated"),
    ("unrest_sds", "background_sds"),
    ("swing_share", "ringing_share"),
    ("swing_decay_s", "ringing_decay_s"),
    ("unrest_memory_s", "background_memory_s"),
    ("unrest_lag_s", "background_lag_s"),
];

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

    /// Whether these are the settings of a registered detector.
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
    /// One-line description.
    pub about: &'static str,
    /// Its default settings.
    pub config: fn() -> TouchConfig,
}

/// The registry of detectors; the first is the default.
pub static DETECTORS: &[DetectorRow] = &[
    DetectorRow {
        name: "ring-compensated",
        about: "thresholds on the reading without the whisker's own oscillation",
        config: || TouchConfig::RingCompensated(ring_compensated::Config::default()),
    },
    DetectorRow {
        name: "band-pass",
        about: "thresholds on the reading and its Butterworth band-pass of sixth order (Lin et al. 2022)",
        config: || TouchConfig::BandPass(band_pass::Config::default()),
    },
];

/// Parameters to which a detector is adapted.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sensing {
    /// Sampling rate (Hz).
    pub rate_hz: f64,
    /// Standard deviation of the measurement noise.
    pub noise_sd_n_m: f64,
    /// Largest calibrated reading.
    pub largest_reading_n_m: f64,
    /// First mode of the free whisker.
    pub first_mode: FirstMode,
}

impl Sensing {
    /// The parameters for a whisker.
    pub fn new(whisker: &Whisker, rate_hz: f64, noise_sd_n_m: f64, largest_reading_n_m: f64) -> Self {
        Self { rate_hz, noise_sd_n_m, largest_reading_n_m, first_mode: FirstMode::of(whisker) }
    }
}

/// Order of the prototype of [`first_mode_band`], half that of the band-pass.
const BAND_ORDER: usize = 3;

/// Edges of that band relative to the whisker's natural frequency.
const BAND: [f64; 2] = [0.5, 2.0];

/// The Butterworth band-pass of sixth order around the first mode.
fn first_mode_band(sensing: &Sensing) -> Result<Vec<Section>, NoSuchBand> {
    let [low_hz, high_hz] = BAND.map(|edge| edge * sensing.first_mode.frequency_hz);
    band_pass(BAND_ORDER, low_hz, high_hz, sensing.rate_hz)
}

/// Signals of a detector at one sample.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Signals {
    /// The filtered reading.
    pub watched_n_m: f64,
    /// The threshold of its absolute value.
    pub threshold_n_m: f64,
    /// Side on which the object lies. `None` while the whisker is free.
    pub touched: Option<Face>,
}

/// A detection method for readings at equal intervals.
pub trait Rule: Debug + Send {
    /// Resets to a free whisker with a constant reading.
    fn settle(&mut self, reading_n_m: f64);

    /// Takes the next reading.
    fn step(&mut self, reading_n_m: f64) -> Signals;
}

/// Detects contact, sample by sample.
#[derive(Debug)]
pub struct ContactDetector {
    rule: Box<dyn Rule>,
    rest_reading: RestReading,
    gate: ReadingGate,
    rate_hz: f64,
    last: Option<(f64, Signals)>,
    /// Duration of the gated readings since the last admitted one.
    gated_s: f64,
}

impl ContactDetector {
    /// A detector with these settings, adapted to the sensor.
    pub fn new(config: TouchConfig, sensing: &Sensing) -> Self {
        let gate = ReadingGate::new(sensing.largest_reading_n_m);
        let rule = config.rule(sensing);
        Self { rule, rest_reading: RestReading::new(sensing), gate, rate_hz: sensing.rate_hz, last: None, gated_s: 0.0 }
    }

    /// Rest reading (N m), an estimate of the sensor's offset. Subtract it from the readings that estimators receive. 0 until it is
    /// determined, and if no significant offset was found.
    pub fn rest_reading_n_m(&self) -> f64 {
        self.rest_reading.rest_reading_n_m()
    }

    /// Whether a reading is larger than that of any free whisker, whatever the sensor's offset.
    pub(crate) fn exceeds_rest(&self, reading_n_m: f64) -> bool {
        self.rest_reading.is_exceeded_by(reading_n_m)
    }

    /// Ends the estimate of the rest reading, as the whisker is known to touch.
    pub(crate) fn give_up_rest(&mut self) {
        self.rest_reading.give_up();
    }

    /// Takes the rest reading of an earlier detector of the same sensor, if that has determined it or found none: the whisker may
    /// touch when the detection starts again.
    pub fn keep_rest_reading(&mut self, earlier: &Self) {
        self.rest_reading.keep(&earlier.rest_reading);
    }

    /// Takes the next reading, `dt_s` after the last, and returns the side on which the object lies. `None` while the
    /// whisker is free. Ringing can temporarily reverse the sign of the reading.
    pub fn step(&mut self, reading_n_m: f64, dt_s: f64) -> Option<Face> {
        self.judge(reading_n_m, dt_s).touched
    }

    /// As [`Self::step`], with all signals. At a gated reading they are those of the last admitted one.
    pub fn judge(&mut self, reading_n_m: f64, dt_s: f64) -> Signals {
        if !self.gate.admits(reading_n_m) {
            self.gated_s += dt_s;
            return self.signals();
        }
        let dt_s = dt_s + std::mem::take(&mut self.gated_s);
        let may_be_rest = self.rest_reading.update(reading_n_m, dt_s);
        if may_be_rest && self.rest_reading_n_m() != 0.0 {
            // Restarts the rule: the readings that it has received contain the offset.
            self.last = None;
        }
        let reading_n_m = reading_n_m - self.rest_reading_n_m();
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
        let signals = Signals { touched: signals.touched.filter(|_| !may_be_rest), ..signals };
        self.last = Some((reading_n_m, signals));
        signals
    }

    /// Signals at the last admitted reading; zero before the first.
    pub fn signals(&self) -> Signals {
        self.last.map_or_else(Signals::default, |(_, signals)| signals)
    }
}
