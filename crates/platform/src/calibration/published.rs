//! The published pipeline (OpenWhisker, TAROS 2024), as it was: a polynomial of third order in *slope times true distance*.
//!
//! The true distance is what a robot wants to know, so none of this can run live; and as the feature contains the answer, its error says little
//! of what a slope tells. Samples are unwrapped, low-passed forwards and backwards (Butterworth, second order, 5 Hz), and an episode
//! begins where the slope falls below -10 counts a sample and ends where it rises above +10; its slope is that at its 120th sample. Fixed thresholds and fixed
//! samples suit one rig, one speed and one rate.

use nalgebra::{DMatrix, DVector};

use super::front::filter;
use super::least_squares::solve;
use super::regression::LeakingRegressor;
use super::{Error, LabelledPress, Unwrapped};
use crate::Sample;

pub(super) const NAME: &str = "published";

const ORDER: usize = 2;
const CUTOFF_HZ: f64 = 5.0;
const THRESHOLD_COUNTS_PER_SAMPLE: f64 = 10.0;
const SLOPE_AT_SAMPLE: usize = 120;
const DEGREE: usize = 3;

/// The low-pass forwards and backwards, so that nothing is delayed: the signal must be there whole.
///
/// At both ends it is continued by its point reflection over three times as many samples as the filter has coefficients, and the filter begins at
/// rest there, as in `scipy.signal.sosfiltfilt`. A signal shorter than that is continued over as much as there is.
///
/// # Errors
/// [`Error::Setting`] where the low-pass does not fit the rate.
pub fn zero_phase(signal: &[f64], order: usize, cutoff_hz: f64, rate_hz: f64) -> Result<Vec<f64>, Error> {
    let (Some(&first), Some(&last)) = (signal.first(), signal.last()) else { return Ok(Vec::new()) };
    let at_rest = filter(order, cutoff_hz, rate_hz)?;
    // As many coefficients as a filter of that order has: an odd one has a section with one of them zero.
    let margin = (3 * (order + 1)).min(signal.len() - 1);
    let before = signal[1..=margin].iter().rev().map(|value| 2.0 * first - value);
    let after = signal[signal.len() - 1 - margin..signal.len() - 1].iter().rev().map(|value| 2.0 * last - value);
    let mut values: Vec<f64> = before.chain(signal.iter().copied()).chain(after).collect();
    for _ in 0..2 {
        let mut filter = at_rest.clone();
        filter.settle(values[0]);
        values.iter_mut().for_each(|value| *value = filter.step(*value));
        values.reverse();
    }
    Ok(values[margin..margin + signal.len()].to_vec())
}

/// An episode of the published pipeline.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Episode {
    /// Time of its first sample.
    pub onset_s: f64,
    /// Slope at its 120th sample, or at its last if it is shorter.
    pub slope_counts_per_sample: f64,
}

/// The published episodes of one axis of a recording.
///
/// # Errors
/// [`Error::Setting`] where the rate is too low for the low-pass.
pub fn episodes(samples: &[Sample], axis: usize, rate_hz: f64) -> Result<Vec<Episode>, Error> {
    let mut unwrapped = Unwrapped::default();
    let counts: Vec<f64> = samples.iter().map(|sample| unwrapped.step(sample.counts[axis]) as f64).collect();
    let slopes = gradient(&zero_phase(&counts, ORDER, CUTOFF_HZ, rate_hz)?);
    let mut episodes = Vec::new();
    let mut begin = None;
    for (i, &slope) in slopes.iter().enumerate() {
        match begin {
            None if slope < -THRESHOLD_COUNTS_PER_SAMPLE => begin = Some(i),
            Some(first) if slope > THRESHOLD_COUNTS_PER_SAMPLE => {
                let at = (first + SLOPE_AT_SAMPLE).min(i - 1);
                episodes.push(Episode { onset_s: samples[first].t_s, slope_counts_per_sample: slopes[at] });
                begin = None;
            }
            _ => {}
        }
    }
    Ok(episodes)
}

/// Central differences, one-sided at the ends, as `numpy.gradient`.
fn gradient(values: &[f64]) -> Vec<f64> {
    let last = values.len().saturating_sub(1);
    let at = |i: usize| {
        let (low, high) = (i.saturating_sub(1), (i + 1).min(last));
        (values[high] - values[low]) / (high - low).max(1) as f64
    };
    (0..values.len()).map(at).collect()
}

/// A polynomial in slope times true distance.
#[derive(Clone, Debug)]
struct Published {
    scale: f64,
    coefficients_m: DVector<f64>,
}

/// The feature that contains the answer.
fn feature(press: &LabelledPress) -> f64 {
    press.features.slope_counts_per_s * press.distance_m
}

impl LeakingRegressor for Published {
    fn distance_m(&self, press: &LabelledPress) -> f64 {
        let x = feature(press) / self.scale;
        self.coefficients_m.iter().rev().fold(0.0, |sum, coefficient| sum * x + coefficient)
    }
}

pub(super) fn fit(presses: &[LabelledPress]) -> Result<Box<dyn LeakingRegressor>, Error> {
    let scale = presses.iter().map(|press| feature(press).abs()).fold(0.0, f64::max);
    let rows =
        DMatrix::from_fn(presses.len(), DEGREE + 1, |i, power| (feature(&presses[i]) / scale).powi(power as i32));
    let distances_m = DVector::from_iterator(presses.len(), presses.iter().map(|press| press.distance_m));
    let equal = DVector::repeat(presses.len(), 1.0);
    let coefficients_m = solve(&rows, &distances_m, &equal).ok_or(Error::Undetermined(NAME))?;
    Ok(Box::new(Published { scale, coefficients_m }))
}
