//! Signal that a second contact has taken load.
//!
//! With a first contact at a known place, a second one nearer to the root raises the moment at the root, and one nearer to the tip
//! lowers it: the second contact takes over a part of the deflection at the first, with a lever that is shorter or longer. As long
//! as there is one contact, the normalised innovations of a model that describes it have mean zero; from the instant at which a
//! second contact takes load they have a positive or a negative mean. The change is detected by Page's two-sided test
//! ("Continuous inspection schemes", Biometrika 41, 1954): the cumulative sum of the innovations less a drift, or that of their
//! negatives less the drift, each kept from falling below zero, exceeds a threshold.
//!
//! At a place that was touched before, a second contact is also found by the shape of the whisker ([`super::touched`]), which needs no
//! change of the innovations.

use filters::Innovation;
use serde::{Deserialize, Serialize};

use crate::settings::{SettingsError, within};

/// Settings of the signal.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub(super) struct SecondSettings {
    /// Half of the mean of the normalised innovations to be detected, which the test subtracts from each.
    pub drift_sds: f64,
    /// Largest normalised innovation that counts, which bounds the influence of an outlier.
    pub most_sds: f64,
    /// Cumulative sum above which the signal is raised. A lower value detects more and raises more false alarms. 0: no test.
    pub evidence_sds: f64,
    /// Time after the touch and after a signal during which the model is still learning the contact and there is no test.
    pub settling_s: f64,
    /// Time for which the signal stays raised.
    pub hold_s: f64,
    /// Distance (m) by which the whisker, if the estimated contact were the only one, would lie past a place that was touched
    /// before, for the signal to be raised. 0: places are not remembered.
    pub past_m: f64,
    /// Time (s) for which it must have done so.
    pub past_s: f64,
    /// Whether a signal by the innovations also begins a new touch: the contact is then sought anywhere along the whisker, beside the
    /// place that it had. For objects whose protruding points are far apart; on a polygon, along whose sides the contact slides
    /// from corner to corner, it discards what is known.
    pub begins_touch: bool,
}

impl Default for SecondSettings {
    fn default() -> Self {
        Self::TESTED
    }
}

impl SecondSettings {
    /// No signal.
    pub(super) const NONE: Self = Self { evidence_sds: 0.0, past_m: 0.0, ..Self::TESTED };

    /// Page's test, and the return to places that were touched before. `past_m` and `past_s` were chosen, as the other values, on
    /// the suite `hollow` with noise seeds that are not reported.
    const TESTED: Self = Self {
        drift_sds: 0.75,
        most_sds: 4.0,
        evidence_sds: 7.0,
        settling_s: 0.25,
        hold_s: 0.2,
        past_m: 0.15e-3,
        past_s: 0.03,
        begins_touch: false,
    };

    /// Checks every value.
    pub(super) fn validate(&self) -> Result<(), SettingsError> {
        within("second.drift_sds", self.drift_sds, 0.0..=10.0)?;
        within("second.most_sds", self.most_sds, 1.0..=1e3)?;
        within("second.evidence_sds", self.evidence_sds, 0.0..=1e6)?;
        within("second.settling_s", self.settling_s, 0.0..=1e3)?;
        within("second.hold_s", self.hold_s, 0.0..=1e3)?;
        within("second.past_m", self.past_m, 0.0..=1.0)?;
        within("second.past_s", self.past_s, 0.0..=1e3)
    }
}

/// Page's test on the innovations of one touch.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Second {
    /// Cumulative sums that detect a positive and a negative mean of the innovations.
    above_sds: f64,
    below_sds: f64,
    since_start_s: f64,
    /// Time for which the signal stays raised.
    held_s: f64,
}

impl Second {
    /// Takes the innovation of the mean of `count` readings and returns whether it raises the signal.
    pub(super) fn advance(
        &mut self,
        settings: &SecondSettings,
        dt_s: f64,
        count: f64,
        innovation: Option<Innovation<1>>,
    ) -> bool {
        self.since_start_s += dt_s;
        self.held_s -= dt_s;
        let Some(innovation) = innovation.filter(|_| settings.evidence_sds > 0.0) else { return false };
        if self.since_start_s < settings.settling_s {
            return false;
        }
        let found = innovation.residual.x / innovation.covariance.x.sqrt();
        let bounded = found.clamp(-settings.most_sds, settings.most_sds);
        let (bounded, drift_sds) = (count.sqrt() * bounded, count * settings.drift_sds);
        self.above_sds = (self.above_sds + bounded - drift_sds).max(0.0);
        self.below_sds = (self.below_sds - bounded - drift_sds).max(0.0);
        let is_detected = self.above_sds.max(self.below_sds) > settings.evidence_sds;
        if is_detected {
            self.raise(settings);
        }
        is_detected
    }

    /// Raises the signal and begins the test anew.
    pub(super) fn raise(&mut self, settings: &SecondSettings) {
        *self = Self { held_s: settings.hold_s, ..Self::default() };
    }

    /// Whether the signal is raised.
    pub(super) fn is_raised(&self) -> bool {
        self.held_s > 0.0
    }

    /// Begins the next touch.
    pub(super) fn resume(&mut self) {
        *self = Self::default();
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::{Matrix1, vector};

    use super::*;

    /// Samples until the signal is raised, of at most 10,000, for these innovations in standard deviations.
    fn raised(sds: impl Fn(usize) -> f64) -> Option<usize> {
        let (settings, mut second) = (SecondSettings::default(), Second::default());
        (0..10_000).find(|&i| second.advance(&settings, 0.004, 1.0, Innovation::of(vector![sds(i)], Matrix1::new(1.0))))
    }

    /// An evenly spaced quantile sample of the normal distribution, shuffled.
    fn white(i: usize) -> f64 {
        [0.1, -1.8, 0.5, -0.15, 0.95, -0.45, 1.5, -1.05, -0.3, 0.3, 1.8, -0.6][i % 12]
    }

    #[test]
    fn verif_a_lasting_change_of_the_moment_is_detected() {
        assert_eq!(raised(white), None);
        for sign in [-1.0, 1.0] {
            let found = raised(|i| white(i) + if i < 200 { 0.0 } else { 2.0 * sign }).unwrap();
            assert!((200..220).contains(&found), "{found}");
        }
    }

    #[test]
    fn robust_a_single_outlier_does_not_raise_the_signal() {
        for sign in [-1.0, 1.0] {
            assert_eq!(raised(|i| if i % 50 == 0 { sign * 1e6 } else { white(i) }), None);
        }
    }
}
