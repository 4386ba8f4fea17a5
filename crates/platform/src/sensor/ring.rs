//! Queue of samples from the reader thread to the consumer.

use std::collections::VecDeque;
use std::sync::{Condvar, Mutex, MutexGuard};
use std::time::Duration;

use super::Arrival;

/// Bounded queue. When it is full, the oldest samples are overwritten and counted.
#[derive(Debug)]
pub(super) struct Ring {
    state: Mutex<State>,
    changed: Condvar,
    capacity: usize,
}

#[derive(Debug, Default)]
struct State {
    waiting: VecDeque<Arrival>,
    overwritten: u64,
    closed: bool,
}

impl Ring {
    pub(super) fn new(capacity: usize) -> Self {
        Self { state: Mutex::default(), changed: Condvar::new(), capacity }
    }

    pub(super) fn put(&self, arrivals: &[Arrival]) {
        let mut state = self.state();
        state.waiting.extend(arrivals);
        let surplus = state.waiting.len().saturating_sub(self.capacity);
        state.waiting.drain(..surplus);
        state.overwritten += surplus as u64;
        self.changed.notify_one();
    }

    /// Closes the queue: no more samples follow.
    pub(super) fn close(&self) {
        self.state().closed = true;
        self.changed.notify_one();
    }

    /// Moves all samples into `arrivals`, with a timeout for the first one. `false` if the queue is closed and empty.
    pub(super) fn take(&self, arrivals: &mut Vec<Arrival>, patience: Duration) -> bool {
        let waits = |state: &mut State| state.waiting.is_empty() && !state.closed;
        let state = self.changed.wait_timeout_while(self.state(), patience, waits);
        let (mut state, _) = state.expect("no holder of the lock panics");
        arrivals.extend(state.waiting.drain(..));
        !(arrivals.is_empty() && state.closed)
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
    use std::time::Instant;

    use super::*;
    use crate::Sample;

    #[test]
    fn verif_overwritten_samples_are_counted() {
        let ring = Ring::new(3);
        let at = Instant::now();
        let arrival = |k| Arrival { at, sample: Sample { t_s: f64::from(k), counts: [0; 3] } };
        let arrivals: Vec<_> = (0..5).map(arrival).collect();
        ring.put(&arrivals);
        let mut taken = Vec::new();
        assert!(ring.take(&mut taken, Duration::ZERO));
        assert_eq!(taken, arrivals[2..]);
        assert_eq!(ring.overwritten(), 2);
        ring.close();
        taken.clear();
        assert!(!ring.take(&mut taken, Duration::from_secs(60)));
    }
}
