//! Features and labels of presses.

use serde::{Deserialize, Serialize};

/// Features of a press, all of them available at run time.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Features {
    /// Steepest slope of the low-passed main axis (counts/s), positive in the direction of the press. At a constant
    /// speed of the edge it is proportional to the change of the reading per metre of push, which decreases with the
    /// distance of the contact.
    pub slope_counts_per_s: f64,
    /// Peak of the low-passed main axis above its level at rest (counts), in the direction of the press. It increases
    /// with the depth of the push too.
    pub peak_counts: Option<f64>,
    /// Ratio of the second axis's slope to the main axis's, at the latter's steepest point: the direction of bending.
    pub slope_ratio: Option<f64>,
    /// Slope of the main axis without its loss in the low-pass (counts/s), from slope and peak. `None` if the push was
    /// too short for the low-pass.
    #[serde(default)]
    pub ramp_counts_per_s: Option<f64>,
}

impl Features {
    /// Features of a press of which only the slope is known.
    pub fn of_slope(slope_counts_per_s: f64) -> Self {
        Self { slope_counts_per_s, ..Self::default() }
    }
}

/// A press with a known distance.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LabelledPress {
    /// Name of its recording.
    pub log: String,
    /// Onset of the contact in the recording's time (s). `None` for a press of a table.
    pub onset_s: Option<f64>,
    /// Features.
    pub features: Features,
    /// True radial distance of the contact from the whisker's root (m).
    pub distance_m: f64,
}
