//! Live inference on samples of a port, and how long it takes.

use std::fmt;
use std::time::{Duration, Instant};

use crate::calibration::{Live, Said};
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
    pub fn step<T>(&mut self, arrival: &Arrival, tell: impl FnOnce(&Said) -> T) -> Option<T> {
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

/// How long each sample took.
#[derive(Clone, Debug, Default)]
pub struct Latency {
    /// The computing alone.
    pub computing: Vec<Duration>,
    /// From its arrival until what it told was out.
    pub all: Vec<Duration>,
}

impl fmt::Display for Latency {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [computing, all] = [&self.computing, &self.all].map(|times| summary(times));
        write!(f, "{} samples, from arrival to told: {all}; computing: {computing}", self.all.len())
    }
}

/// Median, 99th percentile and worst.
fn summary(times: &[Duration]) -> String {
    let mut times = times.to_vec();
    times.sort();
    let Some(last) = times.len().checked_sub(1) else { return "nothing".into() };
    let [median, most, worst] =
        [0.5, 0.99, 1.0].map(|share| 1e3 * times[(last as f64 * share).round() as usize].as_secs_f64());
    format!("median {median:.3} ms, 99 % {most:.3} ms, worst {worst:.3} ms")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn verif_percentiles_are_those_of_the_sorted_times() {
        let times: Vec<_> = (0..=100).rev().map(Duration::from_millis).collect();
        assert_eq!(summary(&times), "median 50.000 ms, 99 % 99.000 ms, worst 100.000 ms");
        assert_eq!(summary(&[]), "nothing");
    }
}
