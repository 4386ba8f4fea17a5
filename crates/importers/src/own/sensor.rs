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
const GLITCH: f64 = 4.0;

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
    /// the differences of consecutive readings, which suppress drift.
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
        let mut readings: Vec<f64> = series.values[..count].iter().flatten().copied().collect();
        if readings.len() < LEAST_AT_REST {
            let found = format!("{} readings in the first {rest_s} s", readings.len());
            return Err(Error::value(path, "reading.rest_s", found, format!("at least {LEAST_AT_REST}")));
        }
        let squares: f64 = readings.windows(2).map(|pair| (pair[1] - pair[0]).powi(2)).sum();
        // The difference of two independent readings has twice the variance of one.
        let sd = (squares / (2.0 * (readings.len() - 1) as f64)).sqrt();
        let noise_sd = mapped.noise_sd.unwrap_or_else(|| sd.max(resolution(series) / 12.0_f64.sqrt()));
        let middle = readings.len() / 2;
        let rest = *readings.select_nth_unstable_by(middle, f64::total_cmp).1;
        Ok(Self { rest, noise_sd })
    }
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

/// Range of distances from rest in which the whisker touches, in the unit of the recording.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Touching {
    pub(crate) least: f64,
    most: f64,
}

impl Touching {
    /// Range for recordings whose largest reading, without glitches, is `largest`.
    pub(crate) fn new(mapped: &ReadingColumn, largest: f64) -> Self {
        Self { least: mapped.touch.unwrap_or(TOUCH_SHARE * largest), most: GLITCH * largest }
    }

    /// Whether a reading, relative to rest, is that of a contact.
    pub(crate) fn has(&self, reading: f64) -> bool {
        reading.abs() > self.least && !self.is_glitch(reading)
    }

    pub(crate) fn is_glitch(&self, reading: f64) -> bool {
        reading.abs() > self.most
    }
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

    /// Conversion fitted to pairs of moment by the elastica (N m) and reading relative to rest, of `known` contacts.
    ///
    /// # Errors
    /// [`Error::Value`] if the pairs do not determine it.
    pub(crate) fn fitted(
        path: &Path,
        mapped: &ReadingColumn,
        pairs: &[(f64, f64)],
        known: usize,
    ) -> Result<Self, Error> {
        let degree = mapped.degree.unwrap_or(DEGREE);
        let mut characteristic = Characteristic::fit(degree, pairs).ok_or_else(|| {
            let found =
                format!("none, and {} of {known} contacts of the calibration within reach of the whisker", pairs.len());
            let expected = format!(
                "contacts that determine a monotone characteristic of degree {degree}; compare units, `base` and \
                `face` of the mapping, or state a smaller `degree` or the characteristic"
            );
            Error::value(path, "reading.characteristic", found, expected)
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
