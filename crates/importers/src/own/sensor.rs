//! Conversion of readings to moments: rest, noise and characteristic of a sensor.

use std::path::Path;

use files::Error;
use trace::Characteristic;

use super::mapping::ReadingColumn;
use super::series::Series;
use super::units::{Reading, Unit};

/// Distance from rest beyond which the whisker touches, relative to the largest reading, if the mapping states none.
const TOUCH_SHARE: f64 = 0.02;

/// Readings above this many times the largest of two consecutive ones are glitches, whose contact is not stated.
pub(crate) const GLITCH: f64 = 4.0;

/// Distance from rest, in standard deviations of the noise, beyond which a reading of the free whisker is no noise.
const OUTLIER: f64 = 10.0;

/// Standard deviation of normal noise per median magnitude of the differences of two consecutive readings.
const SD_PER_MEDIAN_STEP: f64 = 1.4826 * std::f64::consts::FRAC_1_SQRT_2;

/// Smallest number of readings at rest from which rest and noise are estimated.
const LEAST_AT_REST: usize = 10;

/// Degree of a fitted characteristic if the mapping states none.
const DEGREE: usize = 3;

/// Readings of the free whisker, in the unit of the recording.
#[derive(Clone, Copy, Debug)]
pub(crate) struct AtRest {
    pub(crate) rest: f64,
    pub(crate) noise_sd: f64,
}

impl AtRest {
    /// Rest and noise as stated, or estimated from the start of a recording: the median, and the standard deviation by
    /// the differences of consecutive readings, which suppress drift. Readings far from rest are left out of the noise, since a
    /// single glitch would determine it.
    ///
    /// # Errors
    /// [`Error::Value`] if the start has too few readings.
    pub(crate) fn of(path: &Path, mapped: &ReadingColumn, series: &Series) -> Result<Self, Error> {
        let stated = Self { rest: mapped.rest.unwrap_or_default(), noise_sd: mapped.noise_sd.unwrap_or_default() };
        let Some(rest_s) = mapped.rest_s else { return Ok(stated) };
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
        let step = median(readings.windows(2).map(|pair| (pair[1] - pair[0]).abs()).collect());
        let most = OUTLIER * (SD_PER_MEDIAN_STEP * step).max(resolution);
        let pairs = readings.windows(2).filter(|pair| pair.iter().all(|reading| (reading - rest).abs() <= most));
        let squares: Vec<f64> = pairs.map(|pair| (pair[1] - pair[0]).powi(2)).collect();
        // The difference of two independent readings has twice the variance of one.
        let sd = (squares.iter().sum::<f64>() / (2 * squares.len().max(1)) as f64).sqrt();
        let noise_sd = mapped.noise_sd.unwrap_or_else(|| sd.max(resolution / 12.0_f64.sqrt()));
        Ok(Self { rest, noise_sd })
    }
}

/// Median; the larger of the two in the middle.
fn median(mut values: Vec<f64>) -> f64 {
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

/// Largest magnitude that two consecutive readings reach: that of the largest reading without single glitches.
pub(crate) fn sustained(readings: &[f64]) -> f64 {
    readings.windows(2).map(|pair| pair[0].abs().min(pair[1].abs())).fold(0.0, f64::max)
}

/// Distance from rest, in the unit of the recording, beyond which the whisker touches, for recordings whose largest reading,
/// without glitches, is `largest`.
pub(crate) fn touch(mapped: &ReadingColumn, largest: f64) -> f64 {
    mapped.touch.unwrap_or(TOUCH_SHARE * largest)
}

/// Known contacts of the calibration.
pub(crate) struct Known {
    /// Number of recordings with the role `calibration`.
    pub(crate) recordings: usize,
    /// Number of contacts.
    pub(crate) contacts: usize,
    /// Moment by the elastica (N m) and reading relative to rest, of the contacts within reach of the whisker.
    pub(crate) pairs: Vec<(f64, f64)>,
}

/// Conversion from readings relative to rest to moments.
#[derive(Clone, Debug)]
pub(crate) struct Conversion {
    pub(crate) characteristic: Characteristic,
    pub(crate) residual: f64,
}

impl Conversion {
    /// Conversion by the unit or by the stated characteristic. `None` if it must be fitted. `largest` is the largest
    /// reading relative to rest.
    ///
    /// # Errors
    /// [`Error::Value`] if the stated characteristic is not invertible.
    pub(crate) fn stated(path: &Path, mapped: &ReadingColumn, largest: f64) -> Result<Option<Self>, Error> {
        let coefficients = match (mapped.unit, mapped.characteristic) {
            (Reading::Counts, None) => return Ok(None),
            (Reading::Counts, Some(stated)) => stated.map(|coefficient| mapped.sign * coefficient),
            (unit, _) => [mapped.sign / unit.si(), 0.0, 0.0],
        };
        // The range over which a polynomial is monotone is not stated: the largest that the readings may need.
        let first = (largest / coefficients[0]).abs();
        let ranges = (0..).map(|halvings| first * 2.0_f64.powi(1 - halvings)).take(40);
        let within = |most_n_m: f64| Characteristic::new(coefficients.to_vec(), [-most_n_m, most_n_m]);
        let characteristic = ranges.filter(|most_n_m| most_n_m.is_finite()).find_map(within).ok_or_else(|| {
            let found = format!("{coefficients:?}");
            Error::value(path, "reading.characteristic", found, "a nonzero first coefficient, counts per N m")
        })?;
        Ok(Some(Self { characteristic, residual: 0.0 }))
    }

    /// Conversion fitted to the known contacts of the calibration. `touch` is the distance from rest beyond which the whisker
    /// touches.
    ///
    /// # Errors
    /// [`Error::Value`] if the contacts do not determine it.
    pub(crate) fn fitted(path: &Path, mapped: &ReadingColumn, known: &Known, touch: f64) -> Result<Self, Error> {
        let degree = mapped.degree.unwrap_or(DEGREE);
        let Known { recordings, contacts, pairs } = known;
        let missing = |found: String, expected: String| Error::value(path, "reading.characteristic", found, expected);
        if *recordings == 0 {
            let found = "none, and no recording with the role `calibration`";
            let expected =
                "recordings with this role, to whose known contacts the characteristic is fitted; or state it";
            return Err(missing(found.into(), expected.into()));
        }
        if *contacts == 0 {
            let found =
                format!("none, and no known contact in the recordings with the role `calibration` ({recordings})");
            let expected = format!(
                "a `contact`, and rows in which the whisker touches it: the reading differs by more than `touch` \
                 ({touch:.3e}) from rest, the median of the first `rest_s`, or the column `touching` is 1; or state the \
                 characteristic"
            );
            return Err(missing(found, expected));
        }
        let mut characteristic = Characteristic::fit(degree, pairs).ok_or_else(|| {
            let found = format!(
                "none, and {} of {contacts} contacts of the calibration within reach of the whisker",
                pairs.len()
            );
            let expected = format!(
                "contacts that determine a monotone characteristic of degree {degree}; compare units, `base` and \
                `face` of the mapping, or state a smaller `degree` or the characteristic"
            );
            missing(found, expected)
        })?;
        let squares: f64 =
            pairs.iter().map(|(moment_n_m, reading)| (reading - characteristic.counts(*moment_n_m)).powi(2)).sum();
        characteristic.coefficients.resize(DEGREE, 0.0);
        Ok(Self { characteristic, residual: (squares / pairs.len() as f64).sqrt() })
    }

    /// Coefficients as stored in a sidecar.
    pub(crate) fn coefficients(&self) -> [f64; 3] {
        std::array::from_fn(|power| self.characteristic.coefficients[power])
    }
}
