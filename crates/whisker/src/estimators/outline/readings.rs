//! Readings that an outline is fitted to.

use crate::frames::{Base, Pose, Start};

/// Largest number of readings that are averaged, and the largest displacement and rotation of the base among them.
const MOST_TOGETHER: f64 = 8.0;
const MOST_WAY_M: f64 = 0.3e-3;
const MOST_TURN_RAD: f64 = 5e-3;

/// The mean of readings between which the base hardly moved, at its mean pose.
#[derive(Clone, Copy, Debug)]
pub(super) struct Reading {
    /// Mean pose of the base.
    pub(super) base: Pose<Base, Start>,
    /// Mean reading.
    pub(super) reading_n_m: f64,
    /// Number of readings.
    pub(super) count: f64,
    /// `tau` of the contact when last computed.
    pub(super) near_m: f64,
    first: Pose<Base, Start>,
}

impl Reading {
    /// A single reading, whose contact lies about `near_m`.
    pub(super) fn new(base: Pose<Base, Start>, reading_n_m: f64, near_m: f64) -> Self {
        Self { base, reading_n_m, count: 1.0, near_m, first: base }
    }

    /// Includes another reading in the mean, unless the base has moved too far. Returns whether it was included.
    fn joins(&mut self, next: &Self) -> bool {
        let way_m = next.base.origin().distance(&self.first.origin());
        let turn_rad = (next.base.yaw_rad() - self.first.yaw_rad()).abs();
        if self.count >= MOST_TOGETHER || way_m > MOST_WAY_M || turn_rad > MOST_TURN_RAD {
            return false;
        }
        let share = 1.0 / (self.count + 1.0);
        let origin = self.base.origin().vector().lerp(&next.base.origin().vector(), share);
        let yaw_rad = self.base.yaw_rad() + share * (next.base.yaw_rad() - self.base.yaw_rad());
        self.base = Pose::new(origin.x, origin.y, yaw_rad);
        self.reading_n_m += share * (next.reading_n_m - self.reading_n_m);
        self.near_m = next.near_m;
        self.count += 1.0;
        true
    }
}

/// Appends a reading, or includes it in the last one.
pub(super) fn keep(readings: &mut Vec<Reading>, reading: Reading) {
    if !readings.last_mut().is_some_and(|last| last.joins(&reading)) {
        readings.push(reading);
    }
}
