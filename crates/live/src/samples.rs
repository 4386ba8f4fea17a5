//! Values over time and their interpolation.

use std::collections::VecDeque;

use crate::clock::Clock;

/// Largest number of kept values.
const MOST: usize = 1 << 14;

/// Relative tolerance of the longest gap: times of equal intervals are rounded.
const ROUNDED: f64 = 1e-6;

/// Reason why no later value can determine the one of a requested time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Lack {
    /// It lies before all values.
    BeforeAll {
        /// Time of the first value.
        first_s: f64,
    },
    /// Its neighbours are too far apart.
    Gap {
        /// Time of the value before.
        before_s: f64,
        /// Time of the value after.
        after_s: f64,
    },
}

/// Value at a requested time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Sampled<T> {
    /// It is known.
    At(T),
    /// A later value may determine it.
    Pending,
    /// No later value can determine it.
    Unknown(Lack),
}

/// Values in order of time, with the clock of their messages. The oldest are dropped if there are too many.
#[derive(Clone, Debug)]
pub struct Samples<T> {
    kept: VecDeque<(f64, T)>,
    /// Clock of the messages.
    pub clock: Clock,
}

impl<T> Default for Samples<T> {
    fn default() -> Self {
        Self { kept: VecDeque::new(), clock: Clock::default() }
    }
}

impl<T: Copy> Samples<T> {
    /// Adds a value and returns whether there was none at its time.
    pub fn insert(&mut self, t_s: f64, value: T) -> bool {
        let place = self.kept.partition_point(|(of_kept_s, _)| *of_kept_s < t_s);
        if self.kept.get(place).is_some_and(|(of_kept_s, _)| *of_kept_s == t_s) {
            return false;
        }
        self.kept.insert(place, (t_s, value));
        if self.kept.len() > MOST {
            self.kept.pop_front();
        }
        true
    }

    /// The value of that time or, by `between(before, after, share)`, one between its neighbours if they are at most
    /// `gap_s` apart.
    pub fn at(&self, t_s: f64, gap_s: f64, between: impl Fn(&T, &T, f64) -> T) -> Sampled<T> {
        let place = self.kept.partition_point(|(of_kept_s, _)| *of_kept_s < t_s);
        let Some((after_s, after)) = self.kept.get(place) else { return Sampled::Pending };
        if *after_s == t_s {
            return Sampled::At(*after);
        }
        let Some((before_s, before)) = place.checked_sub(1).and_then(|place| self.kept.get(place)) else {
            return Sampled::Unknown(Lack::BeforeAll { first_s: *after_s });
        };
        let rounding_s = ROUNDED * gap_s + 2.0 * f64::EPSILON * after_s.abs();
        if after_s - before_s > gap_s + rounding_s {
            return Sampled::Unknown(Lack::Gap { before_s: *before_s, after_s: *after_s });
        }
        Sampled::At(between(before, after, (t_s - before_s) / (after_s - before_s)))
    }

    /// The last value before a time; otherwise the first one.
    pub fn beside(&self, t_s: f64) -> Option<&T> {
        let place = self.kept.partition_point(|(of_kept_s, _)| *of_kept_s < t_s);
        self.kept.get(place.saturating_sub(1)).map(|(_, value)| value)
    }

    /// Time of the newest value.
    pub fn newest_s(&self) -> Option<f64> {
        self.kept.back().map(|(t_s, _)| *t_s)
    }

    /// Whether a time lies before all values.
    pub fn is_before_all(&self, t_s: f64) -> bool {
        self.kept.front().is_some_and(|(first_s, _)| t_s < *first_s)
    }

    /// Drops the values that no time from `t_s` on requires.
    pub fn settle(&mut self, t_s: f64) {
        while self.kept.get(1).is_some_and(|(next_s, _)| *next_s <= t_s) {
            self.kept.pop_front();
        }
    }

    /// Drops all values.
    pub fn clear(&mut self) {
        *self = Self::default();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn regress_values_whose_interval_is_the_longest_gap_are_interpolated() {
        // Ten values a second; the difference of their times exceeds 0.1 s by rounding.
        for origin_s in [0.0, 1.7e9] {
            let mut samples = Samples::default();
            (0..10).for_each(|row| assert!(samples.insert(origin_s + 0.1 * f64::from(row), f64::from(row))));
            for row in 0..9 {
                let t_s = origin_s + 0.1 * f64::from(row) + 0.05;
                let sampled = samples.at(t_s, 0.1, |before, after, share| before + (after - before) * share);
                let Sampled::At(value) = sampled else { panic!("{t_s} s: {sampled:?}") };
                assert!((value - f64::from(row) - 0.5).abs() < 1e-5, "{value}");
            }
            let gap = samples.at(origin_s + 0.05, 0.0999, |before, _, _| *before);
            assert!(matches!(gap, Sampled::Unknown(Lack::Gap { .. })), "{gap:?}");
        }
    }
}
