//! Live inference on the samples of a port, and its latency.

use std::collections::BTreeMap;
use std::fmt;
use std::time::{Duration, Instant};

use crate::calibration::{Detection, Live};
use crate::sensor::Arrival;

/// Live inference on one stream, with its latency.
#[derive(Debug)]
pub struct Inference<'a> {
    live: Live<'a>,
    latency: Latency,
}

impl<'a> Inference<'a> {
    /// Inference at the start of a stream.
    pub fn new(live: Live<'a>) -> Self {
        Self { live, latency: Latency::default() }
    }

    /// Processes the next sample and passes a detection, if there is one, to `report`, whose result it returns.
    pub fn step<T>(&mut self, arrival: &Arrival, report: impl FnOnce(&Detection) -> T) -> Option<T> {
        let begun = Instant::now();
        let detection = self.live.step(&arrival.sample);
        self.latency.computing.push(begun.elapsed());
        let reported = detection.as_ref().map(report);
        self.latency.all.push(arrival.at.elapsed());
        reported
    }

    /// Latency of the samples so far.
    pub fn latency(self) -> Latency {
        self.latency
    }
}

/// Latency of samples.
#[derive(Clone, Debug, Default)]
pub struct Latency {
    /// Computation only.
    pub computing: Times,
    /// From the arrival of a sample until its detection was reported.
    pub all: Times,
}

impl fmt::Display for Latency {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { computing, all } = self;
        write!(f, "{} samples, latency from arrival to report: {all}; computation: {computing}", all.count)
    }
}

/// Ratio of the times of two neighbouring bins.
const RATIO: f64 = 1.01;

/// Histogram of times with bins one per cent wide, so that its memory is bounded.
#[derive(Clone, Debug, Default)]
pub struct Times {
    bins: BTreeMap<u16, u64>,
    count: u64,
    worst: Duration,
}

impl Times {
    /// Adds a time.
    pub fn push(&mut self, time: Duration) {
        // The first bin begins at one nanosecond; the longest representable time is in bin 6541.
        let bin = ((time.as_nanos().max(1) as f64).ln() / RATIO.ln()).round() as u16;
        *self.bins.entry(bin).or_default() += 1;
        self.count += 1;
        self.worst = self.worst.max(time);
    }

    /// Number of times.
    pub fn count(&self) -> u64 {
        self.count
    }

    /// Quantile at this share, to one per cent; zero if there are no times.
    pub fn quantile(&self, share: f64) -> Duration {
        let rank = (share * self.count as f64).ceil() as u64;
        let mut below = 0;
        let bin = self.bins.iter().find(|(_, count)| {
            below += **count;
            below >= rank
        });
        let time = |(bin, _): (&u16, _)| Duration::from_secs_f64(1e-9 * RATIO.powi(i32::from(*bin)));
        bin.map_or(Duration::ZERO, time).min(self.worst)
    }
}

impl fmt::Display for Times {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [median, most, worst] =
            [self.quantile(0.5), self.quantile(0.99), self.worst].map(|time| 1e3 * time.as_secs_f64());
        write!(f, "median {median:.4} ms, 99 % {most:.4} ms, worst {worst:.4} ms")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn verif_quantiles_are_those_of_the_sorted_times() {
        let mut times = Times::default();
        assert_eq!((times.count(), times.quantile(0.99)), (0, Duration::ZERO));
        (1..=1000).rev().for_each(|k| times.push(Duration::from_micros(k)));
        for share in [0.001, 0.5, 0.99, 1.0] {
            let expected_s = 1e-3 * share;
            assert!((times.quantile(share).as_secs_f64() / expected_s - 1.0).abs() < 0.01, "{share}: {times}");
        }
        assert!(times.to_string().ends_with("worst 1.0000 ms"));
        times.push(Duration::ZERO);
        times.push(Duration::MAX);
        assert_eq!(times.count(), 1002);
    }
}
