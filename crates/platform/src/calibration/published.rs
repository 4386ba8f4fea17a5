//! Press detection of the published pipeline (OpenWhisker, TAROS 2024), kept as the reference for its figures.
//!
//! Samples are unwrapped and low-passed forwards and backwards (Butterworth, second order, 5 Hz). An episode begins
//! where the slope falls below -10 counts per sample and ends where it rises above +10; its slope is that at its 120th
//! sample. The fixed thresholds and the fixed sample suit one rig, one speed and one rate, and a zero-phase filter
//! needs the whole recording, so the pipeline cannot run live.

use super::front::filter;
use super::{Error, Unwrapped};
use crate::Sample;

const ORDER: usize = 2;
const CUTOFF_HZ: f64 = 5.0;
const THRESHOLD_COUNTS_PER_SAMPLE: f64 = 10.0;
const SLOPE_AT_SAMPLE: usize = 120;

/// Zero-phase low-pass: a Butterworth filter of this order and edge, forwards and backwards over the whole signal.
///
/// Both ends are extended by their point reflection over three times the number of filter coefficients, with the filter
/// in its steady state there, as in `scipy.signal.sosfiltfilt`. A shorter signal is extended over its own length less
/// one sample.
///
/// # Errors
/// [`Error::Setting`] if the edge is not between zero and half the rate.
pub fn zero_phase(signal: &[f64], order: usize, cutoff_hz: f64, rate_hz: f64) -> Result<Vec<f64>, Error> {
    let (Some(&first), Some(&last)) = (signal.first(), signal.last()) else { return Ok(Vec::new()) };
    let at_rest = filter(order, cutoff_hz, rate_hz)?;
    // A filter of order n has n + 1 coefficients; at an odd order one coefficient of a section is zero.
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
    /// Time of its first sample (s).
    pub onset_s: f64,
    /// Slope at its 120th sample, or at the last one of a shorter episode.
    pub slope_counts_per_sample: f64,
}

/// Episodes of one axis of a recording, by the published thresholds.
///
/// # Errors
/// [`Error::Setting`] if the rate is too low for the low-pass.
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

/// Central differences, one-sided at the ends, as in `numpy.gradient`.
fn gradient(values: &[f64]) -> Vec<f64> {
    let last = values.len().saturating_sub(1);
    let at = |i: usize| {
        let (low, high) = (i.saturating_sub(1), (i + 1).min(last));
        (values[high] - values[low]) / (high - low).max(1) as f64
    };
    (0..values.len()).map(at).collect()
}
