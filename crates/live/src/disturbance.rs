//! Disturbances of a connection: lost messages, jitter and changes of order, drawn from a seed.

use anyhow::bail;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use strict_json::shown_number;

/// Disturbances of the messages of one stream.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Disturbance {
    /// Fraction of messages that are lost.
    pub lost: f64,
    /// Longest delay (s). The delay of a message is uniform between 0 and this; messages do not overtake each other by it.
    pub jitter_s: f64,
    /// Fraction of messages that arrive after their successor.
    pub swapped: f64,
}

/// Largest jitter.
const MOST_S: f64 = 10.0;

impl Disturbance {
    /// Checks the values.
    ///
    /// # Errors
    /// If a fraction is not in 0 to 1, or the jitter is negative or above 10 s.
    pub fn validate(&self) -> anyhow::Result<()> {
        for (name, value, most) in
            [("lost", self.lost, 1.0), ("jitter", self.jitter_s, MOST_S), ("swapped", self.swapped, 1.0)]
        {
            if !(0.0..=most).contains(&value) {
                bail!("{name}: found {}, expected 0 to {most}", shown_number(value));
            }
        }
        Ok(())
    }

    /// Arrivals of the messages of these times: indices of the messages that arrive and the times of their arrival, in the order of
    /// arrival.
    pub fn arrivals(&self, times_s: &[f64], seed: u64) -> Vec<(usize, f64)> {
        let mut rng = Pcg64::seed_from_u64(seed);
        let mut arrivals: Vec<(usize, f64)> = Vec::with_capacity(times_s.len());
        let mut last_s = f64::NEG_INFINITY;
        for (index, t_s) in times_s.iter().enumerate() {
            let [lost, delayed]: [f64; 2] = [rng.random(), rng.random()];
            if lost >= self.lost {
                last_s = (t_s + self.jitter_s * delayed).max(last_s);
                arrivals.push((index, last_s));
            }
        }
        let mut place = 1;
        while place < arrivals.len() {
            let swapped: f64 = rng.random();
            if swapped < self.swapped {
                let ((first, _), (second, at_s)) = (arrivals[place - 1], arrivals[place]);
                (arrivals[place - 1], arrivals[place]) = ((second, at_s), (first, at_s));
                place += 1;
            }
            place += 1;
        }
        arrivals
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn verif_a_quiet_connection_changes_nothing() {
        let times_s = [0.0, 0.1, 0.2];
        assert_eq!(Disturbance::default().arrivals(&times_s, 3), [(0, 0.0), (1, 0.1), (2, 0.2)]);
    }

    #[test]
    fn verif_the_fractions_are_those_asked_for() {
        let times_s: Vec<f64> = (0..100_000).map(|i| 0.004 * f64::from(i)).collect();
        let disturbance = Disturbance { lost: 0.05, jitter_s: 0.02, swapped: 0.01 };
        let arrivals = disturbance.arrivals(&times_s, 1);
        let lost = 1.0 - arrivals.len() as f64 / times_s.len() as f64;
        assert!((lost - 0.05).abs() < 0.005, "{lost}");
        let behind = arrivals.windows(2).filter(|pair| pair[1].0 < pair[0].0).count() as f64 / arrivals.len() as f64;
        assert!((behind - 0.01).abs() < 0.002, "{behind}");
        assert!(arrivals.windows(2).all(|pair| pair[0].1 <= pair[1].1));
        assert!(arrivals.iter().all(|(_, at_s)| *at_s >= 0.0) && arrivals == disturbance.arrivals(&times_s, 1));
    }

    #[test]
    fn robust_values_out_of_range_are_refused() {
        let error = Disturbance { lost: 1.5, ..Disturbance::default() }.validate().unwrap_err().to_string();
        assert_eq!(error, "lost: found 1.5, expected 0 to 1");
        assert!(Disturbance { jitter_s: f64::NAN, ..Disturbance::default() }.validate().is_err());
    }
}
