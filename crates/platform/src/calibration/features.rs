//! What is known of a press at run time.

use serde::{Deserialize, Serialize};

/// Features of a press, all of which exist at run time.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Features {
    /// Steepest slope of the low-passed main axis, positive in the direction of the press. Where the edge moves at the same speed in each press it tells the reading's
    /// change per metre of push, which falls with the contact's distance.
    pub slope_counts_per_s: f64,
    /// Farthest that the low-passed main axis went from its level at rest, in the direction of the press: it grows with the depth of the push too.
    pub peak_counts: Option<f64>,
    /// Slope of the second axis over that of the main axis, where the latter is steepest: the direction of bending.
    pub slope_ratio: Option<f64>,
}

/// A press whose distance is known.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LabelledPress {
    /// The recording in which it is, by the name that the user gave.
    pub log: String,
    /// When the contact began, in the recording's time; absent where it was taken from a table of presses.
    pub onset_s: Option<f64>,
    /// What is known of it at run time.
    pub features: Features,
    /// True radial distance of the contact from the whisker's root.
    pub distance_m: f64,
}
