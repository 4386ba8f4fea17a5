//! Levels and slopes of the three axes: unwrapping and low-pass.

use std::path::Path;

use serde::{Deserialize, Serialize};
use signal::{Cascade, LONGEST_GAP_S, low_pass};

use super::ramp::Ramps;
use super::{Error, Unwrapped};
use crate::Sample;

/// Highest order of the low-pass.
pub(super) const MOST_ORDER: usize = 8;

/// Highest sampling rate (Hz), above that of any magnetometer.
pub(super) const MOST_RATE_HZ: f64 = 1e4;

/// Largest ratio of the sampling rate to `cutoff_hz`: the effort of [`Ramps`] grows with its square.
pub(super) const MOST_SAMPLES: f64 = 2000.0;

/// Parameters of the detection of presses in samples.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Chain {
    /// Sampling rate (Hz).
    pub rate_hz: f64,
    /// Order of the Butterworth low-pass.
    pub order: usize,
    /// Edge of the low-pass (Hz).
    pub cutoff_hz: f64,
    /// Axis with the largest slopes: 0 for x, 1 for y, 2 for z.
    pub main_axis: usize,
    /// Axis with the second largest slopes.
    pub second_axis: usize,
    /// Standard deviation of the main axis's slope at rest.
    pub noise_counts_per_s: f64,
    /// Smallest absolute slope of a press or a release.
    pub threshold_counts_per_s: f64,
    /// Time without movement after a release, until the next press may begin (s).
    pub quiet_s: f64,
}

impl Chain {
    /// # Errors
    /// [`files::Error::Value`] names the key out of range.
    pub(super) fn check(&self, path: &Path) -> Result<(), files::Error> {
        let wrong =
            |key: &str, found: f64, expected: &str| files::Error::value(path, format!("chain.{key}"), found, expected);
        let positive = [
            ("rate_hz", self.rate_hz),
            ("noise_counts_per_s", self.noise_counts_per_s),
            ("threshold_counts_per_s", self.threshold_counts_per_s),
            ("quiet_s", self.quiet_s),
        ];
        if let Some((key, found)) = positive.into_iter().find(|(_, value)| *value <= 0.0) {
            return Err(wrong(key, found, "a number above zero"));
        }
        if self.rate_hz > MOST_RATE_HZ {
            let expected = format!("a number above zero, at most {MOST_RATE_HZ}");
            return Err(wrong("rate_hz", self.rate_hz, &expected));
        }
        for (key, axis) in [("main_axis", self.main_axis), ("second_axis", self.second_axis)] {
            if axis > 2 {
                return Err(wrong(key, axis as f64, "0, 1 or 2"));
            }
        }
        if !(1..=MOST_ORDER).contains(&self.order) {
            return Err(wrong("order", self.order as f64, "1 to 8"));
        }
        let least_hz = self.rate_hz / MOST_SAMPLES;
        if !(least_hz <= self.cutoff_hz && 2.0 * self.cutoff_hz < self.rate_hz) {
            let expected = format!("at least {least_hz:.3} and below half of rate_hz");
            return Err(wrong("cutoff_hz", self.cutoff_hz, &expected));
        }
        Ok(())
    }
}

/// Low-passed level and slope of an axis.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Motion {
    pub(super) level_counts: f64,
    pub(super) slope_counts_per_s: f64,
}

/// Levels and slopes at a sample.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Moved {
    /// The filter was reset: this sample is the first, or follows a gap.
    pub(super) anew: bool,
    pub(super) axes: [Motion; 3],
}

/// Butterworth low-pass.
///
/// # Errors
/// [`Error::Setting`] if its edge is not between zero and half the rate.
pub(super) fn filter(order: usize, cutoff_hz: f64, rate_hz: f64) -> Result<Cascade, Error> {
    low_pass(order, cutoff_hz, rate_hz).map(Cascade::new).map_err(|_| Error::Setting {
        key: "cutoff_hz",
        found: cutoff_hz,
        expected: format!("above 0 and below {}, half the sampling rate", 0.5 * rate_hz),
    })
}

/// Unwrapping and low-pass of the three axes, sample by sample.
#[derive(Clone, Debug)]
pub(super) struct Front {
    rate_hz: f64,
    filter: Cascade,
    axes: [(Unwrapped, Cascade, f64); 3],
    last_s: Option<f64>,
}

impl Front {
    /// # Errors
    /// [`Error::Setting`] if the edge of the low-pass is not between zero and half the rate.
    pub(super) fn new(order: usize, cutoff_hz: f64, rate_hz: f64) -> Result<Self, Error> {
        let filter = filter(order, cutoff_hz, rate_hz)?;
        let axes = std::array::from_fn(|_| (Unwrapped::default(), filter.clone(), 0.0));
        Ok(Self { rate_hz, filter, axes, last_s: None })
    }

    pub(super) fn step(&mut self, sample: &Sample) -> Moved {
        // The sensor samples at equal intervals, although a serial line delivers unevenly: only gaps depend on the times.
        let anew = self.last_s.is_none_or(|last_s| !(0.0..=LONGEST_GAP_S).contains(&(sample.t_s - last_s)));
        self.last_s = Some(sample.t_s);
        let rate_hz = self.rate_hz;
        let mut moved = Moved { anew, axes: [Motion::default(); 3] };
        for ((axis, motion), &counts) in self.axes.iter_mut().zip(&mut moved.axes).zip(&sample.counts) {
            let (unwrapped, filter, last) = axis;
            if anew {
                *unwrapped = Unwrapped::default();
                *filter = self.filter.clone();
                filter.settle(f64::from(counts));
                *last = f64::from(counts);
            }
            let level_counts = filter.step(unwrapped.step(counts) as f64);
            *motion = Motion { level_counts, slope_counts_per_s: (level_counts - *last) * rate_hz };
            *last = level_counts;
        }
        moved
    }

    /// Slopes of ramps before the low-pass.
    pub(super) fn ramps(&self) -> Ramps {
        Ramps::new(&self.filter, self.delay_s(), self.rate_hz)
    }

    /// Delay of the slope (s): the group delay of the low-pass at frequency zero, and half a sample of the difference.
    pub(super) fn delay_s(&self) -> f64 {
        // The group delay of a polynomial in 1/z at frequency zero is the mean of its exponents, weighted with its coefficients.
        let delay = |polynomial: [f64; 3]| (polynomial[1] + 2.0 * polynomial[2]) / polynomial.iter().sum::<f64>();
        let samples: f64 = self.filter.sections().iter().map(|s| delay(s.b) - delay([1.0, s.a[0], s.a[1]])).sum();
        (samples + 0.5) / self.rate_hz
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn verif_a_ramp_is_followed_with_the_stated_delay() {
        let mut front = Front::new(2, 5.0, 888.0).unwrap();
        let sample = |i: usize| Sample { t_s: i as f64 / 888.0, counts: [0, (65_000 + 10 * i) as u16, 7] };
        let last = (0..2000).map(|i| front.step(&sample(i))).last().unwrap().axes[1];
        let expected = 65_000.0 + 10.0 * (1999.0 - (front.delay_s() * 888.0 - 0.5));
        assert!((last.level_counts - expected).abs() < 1e-6, "{} {expected}", last.level_counts);
        assert!((last.slope_counts_per_s - 8880.0).abs() < 1e-6);
        // The textbook's delay of an analogue filter of second order, sqrt(2) / (2 pi f).
        assert!((front.delay_s() - 0.5 / 888.0 - 2.0_f64.sqrt() / (2.0 * std::f64::consts::PI * 5.0)).abs() < 1e-5);
    }

    #[test]
    fn robust_a_gap_resets_the_filter_and_jitter_does_not() {
        let mut front = Front::new(2, 5.0, 800.0).unwrap();
        let times = [0.0, 0.000_01, 0.016, 0.016, 0.3, 0.9, 0.901, 0.2];
        let anew = times.map(|t_s| front.step(&Sample { t_s, counts: [9; 3] }).anew);
        assert_eq!(anew, [true, false, false, false, false, true, false, true]);
    }
}
