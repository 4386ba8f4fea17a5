//! How restless the whisker is while it is free.

use std::collections::VecDeque;

/// Running mean square of what is watched while the whisker is free. It lags, so that the rise of a touch does not raise it.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct BackgroundRms {
    mean_square: f64,
    /// Samples that the mean counts, at most `most`.
    counted: f64,
    most: f64,
    waiting: VecDeque<f64>,
    lag: usize,
}

impl BackgroundRms {
    /// Begins with `sd`, which counts like the observation of half the lag. The memory is `memory` samples long.
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

    /// Drops what was not yet counted: it may belong to a touch.
    pub(super) fn interrupt(&mut self) {
        self.waiting.clear();
    }

    /// Root mean square.
    pub(super) fn sd(&self) -> f64 {
        self.mean_square.sqrt()
    }
}
