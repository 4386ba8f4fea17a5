//! Live inference on samples of a port, and how long it takes.

use std::collections::BTreeMap;
use std::fmt;
use std::time::{Duration, Instant};

use crate::calibration::{Detection, Live};
use crate::sensor::Arrival;

/// A calibration at work on one stream, on the clock.
#[derive(Debug)]
pub struct Inference<'a> {
    live: Live<'a>,
    latency: Latency,
}

impl<'a> Inference<'a> {
    /// On a stream that has not begun.
    pub fn new(live: Live<'a>) -> Self {
        Self { live, latency: Latency::default() }
    }

    /// Takes the next sample, and hands on what it tells. Gives what `tell` gives.
    pub fn step<T>(&mut self, arrival: &Arrival, tell: impl FnOnce(&Detection) -> T) -> Option<T> {
        let begun = Instant::now();
        let said = self.live.step(&arrival.sample);
        self.latency.computing.push(begun.elapsed());
        let told = said.as_ref().map(tell);
        self.latency.all.push(arrival.at.elapsed());
        told
    }

    /// How long it took so far.
    pub fn latency(self) -> Latency {
        self.latency
    }
}

/// How long samples took.
#[derive(Clone, Debug, Default)]
pub struct Latency {
    /// The computing alone.
    pub computing: Times,
    /// From its arrival until what it told was out.
    pub all: Times,
}

impl fmt::Display for Latency {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { computing, all } = self;
        write!(f, "{} samples, from arrival to told: {all}; computing: {computing}", all.count)
    }
}

/// Ratio of two neighbouring classes of times.
const RATIO: f64 = 1.01;

/// Times, of which as many as there may be take no more room than a few: they are counted in classes that are one per cent wide.
#[derive(Clone, Debug, Default)]
pub struct Times {
    classes: BTreeMap<u16, u64>,
    count: u64,
    worst: Duration,
}

impl Times {
    /// Adds one.
    pub fn push(&mut self, time: Duration) {
        // From a nanosecond on; the longest time that there can be lies in class 6541.
        let class = ((time.as_nanos().max(1) as f64).ln() / RATIO.ln()).round() as u16;
        *self.classes.entry(class).or_default() += 1;
        self.count += 1;
        self.worst = self.worst.max(time);
    }

    /// How many there are.
    pub fn count(&self) -> u64 {
        self.count
    }

    /// The time that this share of all does not exceed, to one per cent; zero where there are none.
    pub fn quantile(&self, share: f64) -> Duration {
        let rank = (share * self.count as f64).ceil() as u64;
        let mut below = 0;
        let class = self.classes.iter().find(|(_, count)| {
            below += **count;
            below >= rank
        });
        let time = |(class, _): (&u16, _)| Duration::from_secs_f64(1e-9 * RATIO.powi(i32::from(*class)));
        class.map_or(Duration::ZERO, time).min(self.worst)
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
