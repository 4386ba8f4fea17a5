//! Bound of the memory of concurrent replays.
//!
//! A replay holds its whole trace, its samples and its estimates, about a kilobyte per row. Traces of usual length are
//! replayed on all threads at once; of very long traces only as many as the bound allows, and always at least one.

use std::sync::{Condvar, Mutex, PoisonError};

/// Largest number of rows of all replays at the same time, if each has fewer: some gigabytes.
pub(super) const MOST_ROWS: usize = 4_000_000;

/// Number of replays of a scene with this many rows that may run at the same time.
pub(super) fn at_once(rows: usize) -> usize {
    (MOST_ROWS / rows.max(1)).max(1)
}

/// Rows of the replays that are running.
#[derive(Default)]
pub(super) struct RunningRows {
    rows: Mutex<usize>,
    freed: Condvar,
}

/// Permission for replays with a number of rows, until it is dropped.
pub(super) struct Permit<'a> {
    running: &'a RunningRows,
    rows: usize,
}

impl RunningRows {
    /// Waits until replays with this many rows may run.
    pub(super) fn permit(&self, rows: usize) -> Permit<'_> {
        let rows = rows.min(MOST_ROWS);
        let running = self.rows.lock().unwrap_or_else(PoisonError::into_inner);
        let is_full = |running: &mut usize| *running + rows > MOST_ROWS;
        *self.freed.wait_while(running, is_full).unwrap_or_else(PoisonError::into_inner) += rows;
        Permit { running: self, rows }
    }
}

impl Drop for Permit<'_> {
    fn drop(&mut self) {
        *self.running.rows.lock().unwrap_or_else(PoisonError::into_inner) -= self.rows;
        self.running.freed.notify_all();
    }
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::{AtomicUsize, Ordering};
    use std::thread;

    use super::*;

    #[test]
    fn verif_running_replays_never_exceed_the_bound() {
        let (running, rows, most) = (RunningRows::default(), AtomicUsize::new(0), AtomicUsize::new(0));
        // Also a scene that exceeds the bound by itself is replayed.
        let demands = [MOST_ROWS / 3, 2 * MOST_ROWS, MOST_ROWS / 2, MOST_ROWS];
        thread::scope(|scope| {
            for demand in demands.into_iter().cycle().take(40) {
                let (running, rows, most) = (&running, &rows, &most);
                scope.spawn(move || {
                    let _permit = running.permit(demand);
                    let counted = demand.min(MOST_ROWS);
                    most.fetch_max(rows.fetch_add(counted, Ordering::SeqCst) + counted, Ordering::SeqCst);
                    rows.fetch_sub(counted, Ordering::SeqCst);
                });
            }
        });
        assert!(most.into_inner() <= MOST_ROWS);
        assert_eq!((at_once(2500) > 1000, at_once(MOST_ROWS / 2), at_once(3 * MOST_ROWS)), (true, 2, 1));
    }
}
