//! Values over time and their interpolation.

use std::collections::VecDeque;

use crate::clock::Clock;

/// Largest number of kept values.
const MOST: usize = 1 << 14;

/// Value at a requested time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Sampled<T> {
    /// It is known.
    At(T),
    /// A later value may determine it.
    Pending,
    /// No later value can determine it.
    Unknown,
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
        match place.checked_sub(1).and_then(|place| self.kept.get(place)) {
            Some((before_s, before)) if after_s - before_s <= gap_s => {
                Sampled::At(between(before, after, (t_s - before_s) / (after_s - before_s)))
            }
            _ => Sampled::Unknown,
        }
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
