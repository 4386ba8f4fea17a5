//! Innovations that are larger than stated.

use serde::{Deserialize, Serialize};

use crate::settings::{SettingsError, within};

/// Search for a contact that has left its place, for example for another corner of a polygon: if the innovations are
/// larger than stated, hypotheses all along the whisker are added, as at a touch.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub(super) struct Search {
    /// Number of samples over which the normalised innovations squared are averaged (exponentially).
    pub window: f64,
    /// Mean above which the search begins.
    pub nis: f64,
    /// Probability of the added hypotheses together. 0: no search.
    pub share: f64,
    /// Shortest time between two searches.
    pub pause_s: f64,
}

impl Search {
    /// No search.
    pub(super) const NONE: Self = Self { window: 8.0, nis: 2.5, share: 0.0, pause_s: 0.1 };

    /// Whether there is a search.
    pub(super) fn is_on(&self) -> bool {
        self.share > 0.0
    }

    /// Checks every value.
    pub(super) fn validate(&self) -> Result<(), SettingsError> {
        within("search.window", self.window, 1.0..=1e6)?;
        within("search.nis", self.nis, 1.0..=1e6)?;
        within("search.share", self.share, 0.0..=0.5)?;
        within("search.pause_s", self.pause_s, 0.0..=1e6)
    }
}

impl Default for Search {
    fn default() -> Self {
        Self { share: 0.01, ..Self::NONE }
    }
}

/// Running mean of the normalised innovations squared, and the time since the last search.
#[derive(Clone, Copy, Debug)]
pub(super) struct Doubt {
    nis: f64,
    since_s: f64,
}

impl Default for Doubt {
    fn default() -> Self {
        Self { nis: 1.0, since_s: 0.0 }
    }
}

impl Doubt {
    /// Takes the innovation of a step and returns whether a search is due.
    pub(super) fn next(&mut self, search: &Search, dt_s: f64, nis: f64) -> bool {
        self.since_s += dt_s;
        self.nis += (nis - self.nis) / search.window;
        let is_due = self.nis > search.nis && self.since_s >= search.pause_s;
        if is_due {
            *self = Self::default();
        }
        is_due
    }
}
