//! Coordinates of a contact along and away from the undeflected whisker.

use nalgebra::{SVector, Vector2};

/// Coordinates of a contact beside one face of the undeflected whisker.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AlongAway {
    /// Arc length of the nearest point of the undeflected whisker, from the root (m).
    pub along_m: f64,
    /// Distance from that point (m), positive away from the object.
    pub away_m: f64,
}

impl AlongAway {
    /// The coordinates with these values, both in m.
    pub fn new(along_m: f64, away_m: f64) -> Self {
        Self { along_m, away_m }
    }

    /// The first two entries of a state vector.
    pub(crate) fn of_state<const N: usize>(x: &SVector<f64, N>) -> Self {
        Self::new(x[0], x[1])
    }

    /// The coordinates as a vector, 2x1.
    pub(crate) fn vector(self) -> Vector2<f64> {
        Vector2::new(self.along_m, self.away_m)
    }
}
