//! The side of the whisker on which the object lies.

use serde::{Deserialize, Serialize};

/// Side of the whisker on which the object lies.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Face {
    /// The object lies on the left (+y) and pushes the whisker to the right: the reading is negative.
    Left,
    /// The object lies on the right (-y) and pushes the whisker to the left: the reading is positive.
    Right,
}

impl Face {
    /// Face that belongs to the sign of a reading.
    pub fn of_reading(reading_n_m: f64) -> Self {
        if reading_n_m < 0.0 { Self::Left } else { Self::Right }
    }

    /// +1 if "away from the object" is to the left of the whisker, -1 if it is to the right. Equals the sign of the
    /// reading.
    pub fn away_sign(self) -> f64 {
        match self {
            Self::Left => -1.0,
            Self::Right => 1.0,
        }
    }

    /// Lower-case name, as in files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Left => "left",
            Self::Right => "right",
        }
    }
}
