//! Contact detection from the *ring-compensated* reading: the reading without the whisker's own oscillation.
//!
//! A free whisker is an oscillator. With its first mode's angular frequency w and damping ratio z the reading M obeys
//!
//! ```text
//! M'' / w^2 + 2 z M' / w + M = P
//! ```
//!
//! where P is the moment by which objects press on it, plus a small one by the base's acceleration. After a release P
//! falls to zero immediately, however long M rings, and it rises at the next touch even while M still rings. The
//! detector therefore uses P, smoothed by a Butterworth low-pass of second order at 1.5 w that limits the noise of the
//! derivatives: one section, whose zeros are the whisker's own poles. In contact the whisker is stiffer and follows the
//! base, M changes slowly, and P equals M.
//!
//! If the sampling rate is too low for the first mode, the reading itself is used.
//!
//! A light or slow touch stays below the noise of a single value for long. Its mean over a period of the first mode is
//! less noisy, and what remains of the oscillation vanishes in it; a touch therefore also begins when this mean exceeds a
//! threshold of its own, and then ends by the mean until it has become firm.

use std::collections::VecDeque;
use std::f64::consts::{FRAC_1_SQRT_2, PI};

use serde::{Deserialize, Serialize};
use signal::{Cascade, Section};

use super::background_rms::BackgroundRms;
use super::median::MedianOfFive;
use super::{Rule, Sensing, Signals, first_mode_band};
use crate::face::Face;
use crate::settings::{SettingsError, within};

/// Edge of the low-pass relative to the whisker's natural frequency: a lower edge gives less noise and more delay.
const EDGE: f64 = 1.5;

/// Factor of the threshold above which a contact counts as firm, so that noise cannot imitate its drop.
const FIRM: f64 = 2.0;

/// Largest ratio of the background's estimated mean square to that of the measurement noise if there is nothing else.
const NOISE_SPREAD: f64 = 2.0;

/// Factor of the share of the largest reading below which a mean is no touch, since a sensor's offset does not average out.
const LIGHT: f64 = 2.0;

/// Largest ratio of the threshold of the mean to that of a single value at which the mean is of use.
const LIGHTER: f64 = 0.5;

/// Smallest number of samples per period of that edge.
const LEAST_SAMPLES: f64 = 8.0;

/// Settings. Thresholds are those of the ring-compensated reading. The aliases are
/// [`FORMER_NAMES`](super::FORMER_NAMES).
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Config {
    /// Threshold of a touch, in standard deviations of the measurement noise ...
    pub noise_sds: f64,
    /// ... but at least this share of the largest calibrated reading, ...
    pub largest_share: f64,
    /// ... this many times the background RMS of the free whisker in the band of its first mode, for example on a
    /// vibrating arm, ...
    #[serde(alias = "unrest_sds")]
    pub background_sds: f64,
    /// ... and this share of the oscillation's amplitude, the remainder if the assumed frequency is wrong by a tenth.
    #[serde(alias = "swing_share")]
    pub ringing_share: f64,
    /// A touch starts when the threshold is exceeded for this many consecutive samples ...
    pub touch_samples: u32,
    /// ... or for this time, whichever is shorter, ...
    pub touch_s: f64,
    /// ... or when that of the mean over this many periods of the first mode is. 0: no mean.
    pub light_periods: f64,
    /// A touch ends when the smoothed ring-compensated reading is below this share of the threshold without the
    /// oscillation's part, ...
    pub release_share: f64,
    /// ... with this time constant of the smoothing, ...
    pub release_time_s: f64,
    /// ... or, after a firm contact, when it is below this share of its maximum within the last period of the
    /// oscillation ...
    pub drop_share: f64,
    /// ... for this many consecutive samples.
    pub drop_samples: u32,
    /// Time constant of the decay of the oscillation.
    #[serde(alias = "swing_decay_s")]
    pub ringing_decay_s: f64,
    /// Memory of the background RMS.
    #[serde(alias = "unrest_memory_s")]
    pub background_memory_s: f64,
    /// Delay of the background RMS, so that a touch does not mask itself.
    #[serde(alias = "unrest_lag_s")]
    pub background_lag_s: f64,
}

impl Default for Config {
    fn default() -> Self {
        Self {
            noise_sds: 5.0,
            largest_share: 0.01,
            background_sds: 7.0,
            ringing_share: 0.3,
            touch_samples: 3,
            touch_s: 0.012,
            light_periods: 1.0,
            release_share: 0.3,
            release_time_s: 0.01,
            drop_share: 0.2,
            drop_samples: 2,
            ringing_decay_s: 0.3,
            background_memory_s: 1.0,
            background_lag_s: 0.1,
        }
    }
}

impl Config {
    pub(super) fn validate(&self) -> Result<(), SettingsError> {
        within("noise_sds", self.noise_sds, 0.0..=1e3)?;
        within("largest_share", self.largest_share, 1e-6..=1.0)?;
        within("background_sds", self.background_sds, 0.0..=1e3)?;
        within("ringing_share", self.ringing_share, 0.0..=1.0)?;
        within("touch_samples", f64::from(self.touch_samples), 1.0..=1e6)?;
        within("touch_s", self.touch_s, 1e-4..=10.0)?;
        within("light_periods", self.light_periods, 0.0..=100.0)?;
        within("release_share", self.release_share, 0.0..=1.0)?;
        within("release_time_s", self.release_time_s, 1e-4..=10.0)?;
        within("drop_share", self.drop_share, 0.0..=1.0)?;
        within("drop_samples", f64::from(self.drop_samples), 1.0..=1e6)?;
        within("ringing_decay_s", self.ringing_decay_s, 1e-3..=100.0)?;
        within("background_memory_s", self.background_memory_s, 1e-2..=100.0)?;
        within("background_lag_s", self.background_lag_s, 0.0..=10.0)
    }
}

/// A contact. Moments are positive towards the object's side.
#[derive(Clone, Copy, Debug)]
struct Touched {
    face: Face,
    smoothed_n_m: f64,
    /// Recent maximum of the pressing moment.
    held_n_m: f64,
    /// Whether only the mean has exceeded its threshold so far.
    is_light: bool,
}

/// Mean of the pressing moment over the last samples.
#[derive(Clone, Debug)]
struct LightMean {
    recent_n_m: VecDeque<f64>,
    sum_n_m: f64,
    /// Number of samples; 0 if there is no mean.
    samples: usize,
    /// Threshold for a touch of a whisker at rest.
    base_n_m: f64,
    /// Mean square up to which the background is that of the measurement noise, which `base_n_m` allows for.
    of_noise_n2_m2: f64,
    /// Part of a signal in the band of the background that remains in the mean.
    band_gain: f64,
}

impl LightMean {
    /// The mean beside a threshold `single_n_m` of single values, if it detects touches that are much lighter.
    fn new(config: &Config, sensing: &Sensing, compensator: &Cascade, band: Option<&Cascade>, single_n_m: f64) -> Self {
        let samples = (config.light_periods * sensing.rate_hz / sensing.first_mode.frequency_hz).round() as usize;
        let noise_n_m = MedianOfFive::noise_gain(|mean_over| compensator.noise_gain(mean_over.max(samples)));
        let base_n_m = (config.noise_sds * noise_n_m * sensing.noise_sd_n_m)
            .max(LIGHT * config.largest_share * sensing.largest_reading_n_m);
        let in_band = band.map_or(0.0, |band| {
            let both = Cascade::new([compensator.sections(), band.sections()].concat());
            MedianOfFive::noise_gain(|mean_over| both.noise_gain(mean_over)) * sensing.noise_sd_n_m
        });
        let of_noise_n2_m2 = NOISE_SPREAD * in_band.powi(2);
        let band_gain = band.map_or(1.0, |band| band.noise_gain(samples.max(1)) / band.noise_gain(1));
        let is_lighter = base_n_m < LIGHTER * single_n_m;
        let samples = if is_lighter { samples } else { 0 };
        let recent_n_m = VecDeque::with_capacity(samples + 1);
        Self { recent_n_m, sum_n_m: 0.0, samples, base_n_m, of_noise_n2_m2, band_gain }
    }

    /// Root mean square in the mean of a background of this one, without that of the measurement noise.
    fn beyond_noise_n_m(&self, background_n_m: f64) -> f64 {
        self.band_gain * (background_n_m.powi(2) - self.of_noise_n2_m2).max(0.0).sqrt()
    }

    /// Forgets the samples so far.
    fn clear(&mut self) {
        self.recent_n_m.clear();
        self.sum_n_m = 0.0;
    }

    /// Takes a sample and returns the mean, zero until there are enough samples.
    fn step(&mut self, pressing_n_m: f64) -> f64 {
        if self.samples == 0 {
            return 0.0;
        }
        self.recent_n_m.push_back(pressing_n_m);
        self.sum_n_m += pressing_n_m;
        if self.recent_n_m.len() > self.samples
            && let Some(oldest_n_m) = self.recent_n_m.pop_front()
        {
            self.sum_n_m -= oldest_n_m;
        }
        if self.recent_n_m.len() == self.samples { self.sum_n_m / self.samples as f64 } else { 0.0 }
    }
}

/// Detector of [`Config`].
#[derive(Clone, Debug)]
pub(super) struct RingCompensated {
    config: Config,
    median: MedianOfFive,
    compensator: Cascade,
    /// Band-pass of the background RMS; a slow touch does not pass.
    band: Option<Cascade>,
    base_n_m: f64,
    light: LightMean,
    background: BackgroundRms,
    /// Amplitude of the oscillation if the whisker were free now.
    ringing_n_m: f64,
    /// Factor of the oscillation's decay per sample.
    ringing_decay: f64,
    touched: Option<Touched>,
    smoothing: f64,
    /// Factor of the recent maximum's decay per sample.
    held_decay: f64,
    /// Number of consecutive samples in favour of a touch, or of a drop.
    in_favour: u32,
    /// Number of samples with which a touch starts.
    touch_samples: u32,
}

impl RingCompensated {
    pub(super) fn new(config: Config, sensing: &Sensing) -> Self {
        let compensator = Cascade::new(ring_compensator(sensing).into_iter().collect());
        let noise_n_m = MedianOfFive::noise_gain(|mean_over| compensator.noise_gain(mean_over)) * sensing.noise_sd_n_m;
        let base_n_m = (config.noise_sds * noise_n_m).max(config.largest_share * sensing.largest_reading_n_m);
        let band = first_mode_band(sensing).ok().map(Cascade::new);
        let light = LightMean::new(&config, sensing, &compensator, band.as_ref(), base_n_m);
        let start_n_m = if config.background_sds > 0.0 { base_n_m / config.background_sds } else { 0.0 };
        let lag = (config.background_lag_s * sensing.rate_hz).round() as usize;
        Self {
            config,
            median: MedianOfFive::default(),
            compensator,
            band,
            base_n_m,
            light,
            background: BackgroundRms::new(start_n_m, config.background_memory_s * sensing.rate_hz, lag),
            ringing_n_m: 0.0,
            ringing_decay: (-1.0 / (sensing.rate_hz * config.ringing_decay_s)).exp(),
            touched: None,
            smoothing: 1.0 - (-1.0 / (sensing.rate_hz * config.release_time_s)).exp(),
            held_decay: (-sensing.first_mode.frequency_hz / sensing.rate_hz).exp(),
            in_favour: 0,
            touch_samples: config.touch_samples.min((config.touch_s * sensing.rate_hz).ceil() as u32).max(1),
        }
    }
}

impl Rule for RingCompensated {
    fn settle(&mut self, reading_n_m: f64) {
        self.median.settle(reading_n_m);
        self.compensator.settle(reading_n_m);
        if let Some(band) = &mut self.band {
            band.settle(reading_n_m);
        }
        self.background.interrupt();
        self.light.clear();
        self.ringing_n_m = 0.0;
        self.touched = None;
        self.in_favour = 0;
    }

    fn step(&mut self, reading_n_m: f64) -> Signals {
        let config = &self.config;
        let reading_n_m = self.median.step(reading_n_m);
        let compensated_n_m = self.compensator.step(reading_n_m);
        let background_n_m = self.band.as_mut().map_or(0.0, |band| band.step(compensated_n_m));
        self.ringing_n_m = reading_n_m.abs().max(self.ringing_decay * self.ringing_n_m);
        let light_n_m = self.light.step(compensated_n_m);
        let background_sd_n_m = self.background.sd();
        let light_sd_n_m = self.light.beyond_noise_n_m(background_sd_n_m);
        let thresholds = Thresholds {
            single_n_m: self.base_n_m.max(config.background_sds * background_sd_n_m),
            light_n_m: self.light.base_n_m.max(config.background_sds * light_sd_n_m),
        };
        let threshold_n_m = if self.touched.is_some() {
            self.in_touch(compensated_n_m, light_n_m, &thresholds)
        } else {
            self.while_free(compensated_n_m, light_n_m, background_n_m, &thresholds)
        };
        let touched = self.touched.map(|touched| touched.face);
        Signals { watched_n_m: compensated_n_m, threshold_n_m, touched }
    }
}

/// Thresholds of a whisker that does not oscillate: of a single value and of the mean.
struct Thresholds {
    single_n_m: f64,
    light_n_m: f64,
}

impl RingCompensated {
    /// Ends the touch if it is over. Returns the threshold of the end.
    fn in_touch(&mut self, compensated_n_m: f64, light_n_m: f64, thresholds: &Thresholds) -> f64 {
        let config = &self.config;
        let Some(Touched { face, smoothed_n_m, held_n_m, is_light }) = &mut self.touched else { return 0.0 };
        let pressing_n_m = face.away_sign() * compensated_n_m;
        *smoothed_n_m += self.smoothing * (pressing_n_m - *smoothed_n_m);
        *held_n_m = pressing_n_m.max(self.held_decay * *held_n_m);
        *is_light &= pressing_n_m < thresholds.single_n_m;
        let drop_n_m = if *held_n_m > FIRM * thresholds.single_n_m { config.drop_share * *held_n_m } else { 0.0 };
        let threshold_n_m = if *is_light { thresholds.light_n_m } else { thresholds.single_n_m };
        let release_n_m = config.release_share * threshold_n_m;
        let lasting_n_m = if *is_light { face.away_sign() * light_n_m } else { *smoothed_n_m };
        self.in_favour = if pressing_n_m < drop_n_m { self.in_favour + 1 } else { 0 };
        if lasting_n_m < release_n_m || self.in_favour >= config.drop_samples {
            self.touched = None;
            self.in_favour = 0;
            self.light.clear();
        }
        release_n_m.max(drop_n_m)
    }

    /// Begins a touch if there is one. Returns the threshold of a single value.
    fn while_free(
        &mut self,
        compensated_n_m: f64,
        light_n_m: f64,
        background_n_m: f64,
        thresholds: &Thresholds,
    ) -> f64 {
        let config = &self.config;
        let ringing_n_m = config.ringing_share * self.ringing_n_m;
        let touch_n_m = thresholds.single_n_m.max(ringing_n_m);
        // A large value is more likely the start of a touch than background.
        let most_n_m = FRAC_1_SQRT_2 * touch_n_m;
        self.background.watch(background_n_m.clamp(-most_n_m, most_n_m));
        let is_firm = compensated_n_m.abs() > touch_n_m;
        let is_light = !is_firm && light_n_m.abs() > thresholds.light_n_m.max(self.light.band_gain * ringing_n_m);
        self.in_favour = if is_firm || is_light { self.in_favour + 1 } else { 0 };
        if self.in_favour >= self.touch_samples {
            let found_n_m = if is_light { light_n_m } else { compensated_n_m };
            let (face, pressing_n_m) = (Face::of_reading(found_n_m), found_n_m.abs());
            self.touched = Some(Touched { face, smoothed_n_m: pressing_n_m, held_n_m: pressing_n_m, is_light });
            self.background.interrupt();
            self.in_favour = 0;
        }
        touch_n_m
    }
}

/// The section that turns the reading into the pressing moment. `None` if the sampling rate is too low.
fn ring_compensator(sensing: &Sensing) -> Option<Section> {
    let first_mode = sensing.first_mode;
    if sensing.rate_hz < LEAST_SAMPLES * EDGE * first_mode.frequency_hz {
        return None;
    }
    // The bilinear transform s = k (z - 1) / (z + 1), with k such that the whisker's frequency is preserved.
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
    fn verif_ringing_is_removed_and_a_press_is_kept() {
        let mut compensator = Cascade::new(vec![ring_compensator(&SENSING).unwrap()]);
        let w = 2.0 * PI * SENSING.first_mode.frequency_hz;
        let ringing = |t: f64| {
            (-SENSING.first_mode.damping_ratio * w * t).exp() * (w * (1.0_f64 - 0.058 * 0.058).sqrt() * t).cos()
        };
        let mut worst: f64 = 0.0;
        for sample in 0..500 {
            let t = f64::from(sample) / 250.0;
            let compensated = compensator.step(ringing(t));
            if t > 0.1 {
                worst = worst.max(compensated.abs());
            }
        }
        assert!(worst < 0.02, "{worst} of the ringing is left");
        compensator.settle(1.0);
        assert!((compensator.step(1.0) - 1.0).abs() < 1e-12);
    }

    /// Samples until a touch is found in a constant reading with measurement noise, of at most 50,000.
    fn found(config: Config, reading_n_m: f64) -> Option<usize> {
        let sensing = Sensing { noise_sd_n_m: 2e-6, ..SENSING };
        let mut detector = RingCompensated::new(config, &sensing);
        detector.settle(0.0);
        let mut state = 1_u64;
        let mut uniform = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 11) as f64 / (1_u64 << 53) as f64
        };
        // The sum of twelve uniform numbers is nearly normal with variance one.
        let mut noise = || (0..12).map(|_| uniform()).sum::<f64>() - 6.0;
        (0..50_000).find(|_| detector.step(reading_n_m + 2e-6 * noise()).touched.is_some())
    }

    #[test]
    fn verif_a_touch_lighter_than_the_noise_of_a_reading_is_found_by_the_mean() {
        let without = Config { light_periods: 0.0, ..Config::default() };
        assert_eq!(found(Config::default(), 0.0), None);
        let by_mean = found(Config::default(), 4e-6).unwrap();
        assert!(by_mean < 100, "{by_mean}");
        assert!(found(without, 4e-6).is_none_or(|samples| samples > 10 * by_mean));
    }

    #[test]
    fn verif_a_low_sampling_rate_gives_no_compensation() {
        assert!(ring_compensator(&Sensing { rate_hz: 60.0, ..SENSING }).is_none());
    }
}
