//! Settings of the matching by time.

use anyhow::bail;
use serde::{Deserialize, Serialize};
use strict_json::shown_number;

/// Longest waits and gaps (s).
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Timing {
    /// Longest wait of a reading for its pose.
    pub wait_s: f64,
    /// Longest wait of a reading for earlier readings that have not arrived; 0 for none.
    pub reorder_s: f64,
    /// Longest time between two poses between which the pose is interpolated.
    pub gap_s: f64,
    /// Smallest difference between the clock of a stream and that of the arrivals that counts as a jump. A larger interval between
    /// readings, three nominal ones, takes its place.
    pub jump_s: f64,
}

impl Default for Timing {
    fn default() -> Self {
        Self { wait_s: 0.05, reorder_s: 0.0, gap_s: 0.1, jump_s: 0.1 }
    }
}

/// Longest of these times.
const MOST_S: f64 = 10.0;

/// Number of nominal intervals between readings by which a clock may differ at least.
const INTERVALS: f64 = 3.0;

impl Timing {
    /// Smallest jump of a clock at this nominal rate of the readings (s).
    pub fn smallest_jump_s(&self, rate_hz: f64) -> f64 {
        self.jump_s.max(INTERVALS / rate_hz)
    }

    /// Checks the values.
    ///
    /// # Errors
    /// If one is negative or above 10 s.
    pub fn validate(&self) -> anyhow::Result<()> {
        let values = [("wait", self.wait_s), ("reorder", self.reorder_s), ("gap", self.gap_s), ("jump", self.jump_s)];
        for (name, value) in values {
            if !(0.0..=MOST_S).contains(&value) {
                bail!("{name}: found {} s, expected 0 to {MOST_S} s", shown_number(value));
            }
        }
        Ok(())
    }
}
