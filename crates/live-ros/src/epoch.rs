//! Epoch of the times of a stream.

use std::sync::{Arc, OnceLock};

use bag::messages::Time;

const NANOSECONDS: i64 = 1_000_000_000;

/// Beginning of the times of a stream: the whole second of its first message. Times since it are exact to the nanosecond,
/// which seconds since 1970 are not.
#[derive(Clone, Debug, Default)]
pub struct Epoch(Arc<OnceLock<i64>>);

impl Epoch {
    /// Time of a message (s). The first one determines the epoch.
    pub(crate) fn seconds(&self, stamp: &Time) -> f64 {
        let epoch_s = *self.0.get_or_init(|| i64::from(stamp.sec));
        let since_ns = (i64::from(stamp.sec) - epoch_s) * NANOSECONDS + i64::from(stamp.nanosec);
        // The quotient of whole numbers is the number with the same decimals.
        since_ns as f64 / NANOSECONDS as f64
    }

    /// Time on the clock of the messages (ns).
    pub(crate) fn nanoseconds(&self, t_s: f64) -> u64 {
        let epoch_ns = self.0.get().copied().unwrap_or_default() * NANOSECONDS;
        epoch_ns.saturating_add((NANOSECONDS as f64 * t_s).round() as i64).max(0) as u64
    }
}
