//! Samples on their way from the thread that reads to whoever takes them.

use std::collections::VecDeque;
use std::sync::{Condvar, Mutex, MutexGuard};
use std::time::Duration;

use crate::Sample;

/// A queue with a bound. Where nobody takes samples in time the oldest are overwritten, and counted.
#[derive(Debug)]
pub(super) struct Ring {
    state: Mutex<State>,
    changed: Condvar,
    capacity: usize,
}

#[derive(Debug, Default)]
struct State {
    samples: VecDeque<Sample>,
    overwritten: u64,
    closed: bool,
}

impl Ring {
    pub(super) fn new(capacity: usize) -> Self {
        Self { state: Mutex::default(), changed: Condvar::new(), capacity }
    }

    pub(super) fn put(&self, samples: &[Sample]) {
        let mut state = self.state();
        state.samples.extend(samples);
        let surplus = state.samples.len().saturating_sub(self.capacity);
        state.samples.drain(..surplus);
        state.overwritten += surplus as u64;
        self.changed.notify_one();
    }

    /// No more samples come.
    pub(super) fn close(&self) {
        self.state().closed = true;
        self.changed.notify_one();
    }

    /// Moves all samples there are into `samples`, after waiting for the first of them. `false` once the ring is closed and empty.
    pub(super) fn take(&self, samples: &mut Vec<Sample>, patience: Duration) -> bool {
        let waits = |state: &mut State| state.samples.is_empty() && !state.closed;
        let state = self.changed.wait_timeout_while(self.state(), patience, waits);
        let (mut state, _) = state.expect("no holder of the lock panics");
        samples.extend(state.samples.drain(..));
        !(samples.is_empty() && state.closed)
    }

    pub(super) fn overwritten(&self) -> u64 {
        self.state().overwritten
    }

    fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock().expect("no holder of the lock panics")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn verif_what_nobody_takes_is_counted() {
        let ring = Ring::new(3);
        let samples: Vec<_> = (0..5).map(|k| Sample { t_s: f64::from(k), counts: [0; 3] }).collect();
        ring.put(&samples);
        let mut taken = Vec::new();
        assert!(ring.take(&mut taken, Duration::ZERO));
        assert_eq!(taken, samples[2..]);
        assert_eq!(ring.overwritten(), 2);
        ring.close();
        taken.clear();
        assert!(!ring.take(&mut taken, Duration::from_secs(60)));
    }
}
