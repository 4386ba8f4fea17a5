//! Readings of the free whisker, and those that differ from them: touches and glitches.

use std::path::Path;

use files::Error;

use super::mapping::StatedAtRest;
use super::series::Series;

/// Distance from rest beyond which the whisker touches, relative to the largest reading, if the mapping states none.
const TOUCH_SHARE: f64 = 0.02;

/// Readings above this many times the largest of two consecutive ones are glitches, whose contact is not stated.
pub(super) const GLITCH: f64 = 4.0;

/// Distance from rest, in standard deviations of the noise, beyond which a reading of the free whisker is no noise.
const OUTLIER: f64 = 10.0;

/// Standard deviation of normal noise per median magnitude.
const SD_PER_MEDIAN: f64 = 1.4826;

/// Standard deviation of normal noise per median magnitude of the differences of two consecutive readings.
const SD_PER_MEDIAN_STEP: f64 = SD_PER_MEDIAN * std::f64::consts::FRAC_1_SQRT_2;

/// Share of equal consecutive readings up to which they are taken to be equal by chance.
const REPEATS_BY_CHANCE: f64 = 0.1;

/// Smallest number of readings at rest from which rest and noise are estimated.
const LEAST_AT_REST: usize = 10;

/// Readings of the free whisker, in the unit of the recording.
#[derive(Clone, Copy, Debug)]
pub(super) struct AtRest {
    pub(super) rest: f64,
    pub(super) noise_sd: f64,
    /// Change of the reading from the first to the second half of the time at rest (medians). 0 if rest is stated.
    pub(super) change: f64,
    /// Share of consecutive readings that are equal although the resolution does not explain it, as of a sensor that is slower than
    /// the recording. 0 if there are none, or if the noise is stated.
    pub(super) repeats: f64,
}

impl AtRest {
    /// Rest and noise as stated, or estimated from the start of a recording: the median, and the standard deviation by
    /// the differences of consecutive readings, which suppress drift. Readings far from rest are left out of the noise, since a
    /// single glitch would determine it, and so are differences of zero if the recording repeats the readings of a slower sensor.
    ///
    /// # Errors
    /// [`Error::Value`] if the start has too few readings.
    pub(super) fn of(path: &Path, stated: StatedAtRest, rest_s: Option<f64>, series: &Series) -> Result<Self, Error> {
        let StatedAtRest { rest, noise_sd } = stated;
        let Some(rest_s) = rest_s else {
            let (rest, noise_sd) = (rest.unwrap_or_default(), noise_sd.unwrap_or_default());
            return Ok(Self { rest, noise_sd, change: 0.0, repeats: 0.0 });
        };
        let times_s = &series.clock.times_s;
        let duration_s = times_s.last().map_or(0.0, |last_s| last_s - times_s[0]);
        if rest_s >= duration_s {
            let found = format!("{rest_s} s for a recording of {duration_s:.3} s");
            let expected = "the duration for which the whisker is free at first, less than that of the recording";
            return Err(Error::value(path, "reading.rest_s", found, expected));
        }
        let is_first = |time_s: &f64| time_s - times_s[0] <= rest_s;
        let count = times_s.iter().take_while(|time_s| is_first(time_s)).count();
        let readings: Vec<f64> = series.values[..count].iter().flatten().copied().collect();
        if readings.len() < LEAST_AT_REST {
            let found = format!("{} readings in the first {rest_s} s", readings.len());
            return Err(Error::value(path, "reading.rest_s", found, format!("at least {LEAST_AT_REST}")));
        }
        let (rest, resolution) = (median(readings.clone()), resolution(series));
        let repeats = repeats(&readings, rest, resolution);
        let is_counted = |pair: &&[f64]| repeats == 0.0 || pair[0] != pair[1];
        let step = median(readings.windows(2).filter(is_counted).map(|pair| (pair[1] - pair[0]).abs()).collect());
        let most = OUTLIER * (SD_PER_MEDIAN_STEP * step).max(resolution);
        let is_near = |pair: &&[f64]| pair.iter().all(|reading| (reading - rest).abs() <= most);
        let pairs = readings.windows(2).filter(is_counted).filter(is_near);
        let squares: Vec<f64> = pairs.map(|pair| (pair[1] - pair[0]).powi(2)).collect();
        // The difference of two independent readings has twice the variance of one.
        let sd = (squares.iter().sum::<f64>() / (2 * squares.len().max(1)) as f64).sqrt();
        let repeats = if noise_sd.is_some() { 0.0 } else { repeats };
        let noise_sd = noise_sd.unwrap_or_else(|| sd.max(resolution / 12.0_f64.sqrt()));
        let (first, second) = readings.split_at(readings.len() / 2);
        Ok(Self { rest, noise_sd, change: median(second.to_vec()) - median(first.to_vec()), repeats })
    }
}

/// Median; the larger of the two in the middle.
pub(super) fn median(mut values: Vec<f64>) -> f64 {
    let middle = values.len() / 2;
    *values.select_nth_unstable_by(middle, f64::total_cmp).1
}

/// Smallest difference of consecutive readings that is not zero; 0 if there is none.
fn resolution(series: &Series) -> f64 {
    let readings: Vec<f64> = series.values.iter().flatten().copied().collect();
    let steps = readings.windows(2).map(|pair| (pair[1] - pair[0]).abs()).filter(|step| *step > 0.0);
    let least = steps.fold(f64::INFINITY, f64::min);
    if least.is_finite() { least } else { 0.0 }
}

/// Share of consecutive readings that are equal. 0 if chance or the resolution explains it: of normal noise with a standard
/// deviation of s resolutions, a share of 0.28 / s is equal, or more if s is small.
fn repeats(readings: &[f64], rest: f64, resolution: f64) -> f64 {
    let equal = readings.windows(2).filter(|pair| pair[0] == pair[1]).count();
    let share = equal as f64 / (readings.len() - 1) as f64;
    let spread = SD_PER_MEDIAN * median(readings.iter().map(|reading| (reading - rest).abs()).collect());
    if share > REPEATS_BY_CHANCE && share * spread > resolution { share } else { 0.0 }
}

/// Largest magnitude that two consecutive readings reach: that of the largest reading without single glitches.
pub(super) fn sustained(readings: &[f64]) -> f64 {
    readings.windows(2).map(|pair| pair[0].abs().min(pair[1].abs())).fold(0.0, f64::max)
}

/// Distance from rest, in the unit of the recording, beyond which the whisker touches, if the mapping states none. `largest` is the
/// largest reading of the recordings, without glitches.
pub(super) fn touch(largest: f64) -> f64 {
    TOUCH_SHARE * largest
}

/// Checks that the recordings of the calibration have known contacts, to which the value of the mapping with this key is fitted.
///
/// # Errors
/// [`Error::Value`] that states what is missing.
pub(super) fn check_known_contacts(
    path: &Path,
    key: &str,
    recordings: usize,
    contacts: usize,
    touch: f64,
) -> Result<(), Error> {
    if recordings == 0 {
        let found = "none, and no recording with the role `calibration`";
        let expected = "recordings with this role, to whose known contacts the value is fitted, or the value itself";
        return Err(Error::value(path, key, found, expected));
    }
    if contacts == 0 {
        let found = format!("none, and no known contact in the recordings with the role `calibration` ({recordings})");
        let expected = format!(
            "a `contact`, and rows in which the whisker touches it: the reading differs by more than `touch` ({touch:.3e}) \
             from rest, the median of the first `rest_s`, or the column `touching` is 1; or the value itself"
        );
        return Err(Error::value(path, key, found, expected));
    }
    Ok(())
}
