//! A method beside those that are averaged, which only raises doubt.
//!
//! The logarithm of the ratio of its likelihood of each reading to that of the mixture is summed, and the sum is kept from
//! falling below zero: Page's test of a change to the method ("Continuous inspection schemes", Biometrika 41, 1954). A sum above a
//! threshold says that its model has described the readings better for a while. It moves no estimate: where the method explains errors
//! of other causes, as a velocity of the object explains those of a sensor, its own estimate may be as wrong.

use std::sync::Arc;

use filters::{Innovation, robust};
use serde::{Deserialize, Serialize};

use super::{Method, Sample, Touch, Tracker};
use crate::settings::{SettingsError, within};

/// Settings of the watched method.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub(super) struct WatchedSettings {
    /// Summed logarithmic likelihood ratio of the method to the mixture above which the models are in doubt. 0: no method is
    /// watched.
    pub evidence: f64,
    /// Time for which the signal stays raised after that.
    pub hold_s: f64,
}

impl Default for WatchedSettings {
    /// Chosen on the training suite of random scenes and on the suite `hollow`.
    fn default() -> Self {
        Self { evidence: 30.0, hold_s: 0.5 }
    }
}

impl WatchedSettings {
    /// Checks every value.
    pub(super) fn validate(&self) -> Result<(), SettingsError> {
        within("watched.evidence", self.evidence, 0.0..=1e6)?;
        within("watched.hold_s", self.hold_s, 0.0..=1e3)
    }
}

/// Largest sum of the evidence over its threshold.
const MOST_EVIDENCE: f64 = 2.0;

/// The method on one contact.
pub(super) struct Watched {
    method: Arc<dyn Method>,
    tracker: Box<dyn Tracker>,
    evidence: Evidence,
    /// Time for which the signal stays raised.
    held_s: f64,
}

impl Watched {
    /// Begins to track a contact.
    pub(super) fn new(method: &Arc<dyn Method>, touch: &Touch<'_>) -> Self {
        Self { method: method.clone(), tracker: method.begin(touch), evidence: Evidence::default(), held_s: 0.0 }
    }

    /// Takes the mean of `count` samples, and the innovation of the mixture. `jumps` is passed to [`Tracker::expect_jumps`]. In the
    /// evidence the covariances of the innovations are multiplied by `factor`.
    pub(super) fn step(
        &mut self,
        (sample, count): (&Sample, f64),
        jumps: bool,
        of_mixture: Option<Innovation<1>>,
        (factor, gate_sds): (f64, f64),
        settings: &WatchedSettings,
    ) {
        let own = self.tracker.step_mean(sample, count).and_then(|estimate| estimate.innovation);
        self.tracker.expect_jumps(jumps);
        let scaled = |found: Option<Innovation<1>>| found.map(|found| found.scaled(factor));
        self.evidence.advance(scaled(own), scaled(of_mixture), gate_sds);
        // Without a bound the signal would stay raised for long on the next object.
        self.evidence.sum = self.evidence.sum.min(MOST_EVIDENCE * settings.evidence);
        let is_ahead = self.evidence.sum > settings.evidence;
        self.held_s = if is_ahead { settings.hold_s } else { self.held_s - sample.dt_s };
    }

    /// Begins the next touch, which may be of the same object: the evidence is kept.
    pub(super) fn resume(&mut self, touch: &Touch<'_>) {
        if !self.tracker.resume(touch) {
            self.tracker = self.method.begin(touch);
        }
    }

    /// Whether the models are in doubt.
    pub(super) fn is_raised(&self, settings: &WatchedSettings) -> bool {
        self.evidence.sum > settings.evidence || self.held_s > 0.0
    }
}

/// Page's cumulative sum of logarithmic likelihood ratios.
#[derive(Clone, Copy, Debug, Default)]
struct Evidence {
    sum: f64,
}

impl Evidence {
    /// Takes the innovations of one reading. If either is missing, the reading is no evidence.
    fn advance(&mut self, own: Option<Innovation<1>>, of_mixture: Option<Innovation<1>>, gate_sds: f64) {
        let (Some(own), Some(of_mixture)) = (own, of_mixture) else { return };
        let [own, of_mixture] = [own, of_mixture].map(|found| robust::log_likelihood(&found, gate_sds));
        self.sum = (self.sum + own - of_mixture).max(0.0);
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::{Matrix1, vector};

    use super::*;

    fn innovation(sds: f64) -> Option<Innovation<1>> {
        Innovation::of(vector![sds], Matrix1::new(1.0))
    }

    #[test]
    fn verif_only_a_lasting_advantage_is_evidence() {
        let mut evidence = Evidence::default();
        for _ in 0..1000 {
            evidence.advance(innovation(1.0), innovation(0.9), 5.0);
        }
        assert_eq!(evidence.sum, 0.0);
        (0..20).for_each(|_| evidence.advance(innovation(0.0), innovation(1.0), 5.0));
        assert!((evidence.sum - 10.0).abs() < 1e-9, "{evidence:?}");
        evidence.advance(None, innovation(3.0), 5.0);
        assert!((evidence.sum - 10.0).abs() < 1e-9, "{evidence:?}");
    }

    #[test]
    fn robust_an_outlier_counts_as_one_at_the_gate() {
        let mut evidence = Evidence::default();
        evidence.advance(innovation(0.0), innovation(1e3), 5.0);
        assert!((evidence.sum - 12.5).abs() < 1e-6, "{evidence:?}");
    }
}
