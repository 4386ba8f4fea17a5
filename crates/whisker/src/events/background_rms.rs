//! Background level of a signal while the whisker is free.

use std::collections::VecDeque;

/// Running mean square of a signal while the whisker is free. It is delayed, so that the rise at a touch does not
/// increase it.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct BackgroundRms {
    mean_square: f64,
    /// Number of samples that the mean covers, at most `most`.
    counted: f64,
    most: f64,
    waiting: VecDeque<f64>,
    lag: usize,
}

impl BackgroundRms {
    /// Begins with the standard deviation `sd`, weighted like the observation of half the lag. `memory` and `lag` are
    /// in samples.
    pub(super) fn new(sd: f64, memory: f64, lag: usize) -> Self {
        Self {
            mean_square: sd * sd,
            counted: 0.5 * lag as f64,
            most: memory,
            waiting: VecDeque::with_capacity(lag + 1),
            lag,
        }
    }

    /// Takes a sample of the free whisker.
    pub(super) fn watch(&mut self, value: f64) {
        self.waiting.push_back(value * value);
        if self.waiting.len() > self.lag
            && let Some(square) = self.waiting.pop_front()
        {
            self.counted = (self.counted + 1.0).min(self.most);
            self.mean_square += (square - self.mean_square) / self.counted;
        }
    }

    /// Drops the delayed samples, which may belong to a touch.
    pub(super) fn interrupt(&mut self) {
        self.waiting.clear();
    }

    /// Root of the mean square.
    pub(super) fn sd(&self) -> f64 {
        self.mean_square.sqrt()
    }
}
