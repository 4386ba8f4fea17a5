//! Signal that a second contact has taken load.
//!
//! With a first contact at a known place, a second one nearer to the root raises the moment at the root, and one nearer to the tip
//! lowers it: the second contact takes over a part of the deflection at the first, with a lever that is shorter or longer. As long
//! as there is one contact, the innovations of a model that describes it have mean zero; from the instant at which a second contact
//! takes load they have a positive or a negative mean. The change is detected by Page's two-sided test ("Continuous inspection
//! schemes", Biometrika 41, 1954): the cumulative sum of the residuals less a drift, or that of their negatives less the drift,
//! each kept from falling below zero, exceeds a threshold.
//!
//! The residual is the one that remains after the update. Of an innovation `r` with the covariance `S`, the filter attributes the
//! share `1 - R / S` to a displacement of the contact, with the variance `R` of the reading (Bar-Shalom, Li and Kirubarajan,
//! "Estimation with Applications to Tracking and Navigation", 2001, chapter 5); only the rest, `r R / S`, is evidence of another
//! load. In standard deviations of the reading it is `r / sqrt(S) sqrt(R / S)`. Where the contact is uncertain, for instance as the
//! motion reverses on a round object, it is small.
//!
//! An object that begins to move changes the readings in the same way. A filter that estimates the velocity of the object has found
//! it long before a moving object has become probable. There are therefore cumulative sums for the innovations of the mixture and
//! for those of a moving object, and the smaller one counts: a change that either of them explains is no evidence, as in a test
//! whose null hypothesis is composite.
//!
//! A sum begins only while the first contact is known. Without this, contacts that have just jumped, that rub or that move with the
//! object would be taken for second ones.
//!
//! At a place that was touched before, a second contact is also found by the shape of the whisker ([`super::touched`]). The farther
//! the whisker lies past the place, the less the innovations need to change.

use filters::Innovation;
use serde::{Deserialize, Serialize};

use crate::settings::{SettingsError, within};

/// Settings of the signal.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub(super) struct SecondSettings {
    /// Half of the mean of the residuals to be detected, in standard deviations of a reading, which the test subtracts from each.
    pub drift_sds: f64,
    /// Largest normalised innovation that counts, which bounds the influence of an outlier.
    pub most_sds: f64,
    /// Cumulative sum above which the signal is raised. A lower value detects more and raises more false alarms. 0: no test.
    pub evidence_sds: f64,
    /// Largest standard deviation (m) of the contact at which a cumulative sum begins.
    pub known_m: f64,
    /// Time (s) after the touch and after a signal during which the model is still learning the contact and there is no test.
    pub settling_s: f64,
    /// Time (s) for which the signal stays raised.
    pub hold_s: f64,
    /// Distance (m) by which the whisker, if the estimated contact were the only one, would lie past a place that was touched
    /// before, for the signal to be raised whatever the readings. 0: places are not remembered.
    pub past_m: f64,
    /// Smaller distance (m) at which it is raised if the cumulative sum exceeds `supporting_sds`.
    pub supported_m: f64,
    /// Cumulative sum that supports a second contact at a place that was touched before.
    pub supporting_sds: f64,
    /// Whether a signal by the innovations also begins a new touch: the contact is then sought anywhere along the whisker, beside
    /// the place that it had. For objects whose protruding points are far apart; on a polygon, along whose sides the contact slides
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

    /// Page's test, and the return to places that were touched before. The values were chosen on the suite `hollow` with noise
    /// seeds that are not reported, and on the training suites of random scenes, in which almost every signal is a false one.
    const TESTED: Self = Self {
        drift_sds: 0.6,
        most_sds: 4.0,
        evidence_sds: 6.0,
        known_m: 3e-3,
        settling_s: 0.5,
        hold_s: 0.2,
        past_m: 0.2e-3,
        supported_m: 0.08e-3,
        supporting_sds: 2.0,
        begins_touch: false,
    };

    /// Checks every value.
    pub(super) fn validate(&self) -> Result<(), SettingsError> {
        within("second.drift_sds", self.drift_sds, 0.0..=10.0)?;
        within("second.most_sds", self.most_sds, 1.0..=1e3)?;
        within("second.evidence_sds", self.evidence_sds, 0.0..=1e6)?;
        within("second.known_m", self.known_m, 0.0..=1.0)?;
        within("second.settling_s", self.settling_s, 0.0..=1e3)?;
        within("second.hold_s", self.hold_s, 0.0..=1e3)?;
        within("second.past_m", self.past_m, 0.0..=1.0)?;
        within("second.supported_m", self.supported_m, 0.0..=1.0)?;
        within("second.supporting_sds", self.supporting_sds, 0.0..=1e6)
    }
}

/// Innovations of the mean of some readings, for the test.
#[derive(Clone, Copy, Debug)]
pub(super) struct Found {
    /// Of the mixture.
    pub mixture: Innovation<1>,
    /// Of the candidates for a moving object. `None` if there are none.
    pub moving: Option<Innovation<1>>,
    /// Number of readings.
    pub count: f64,
    /// Variance of their mean, of noise and sensor model together.
    pub variance_n2_m2: f64,
}

impl Found {
    /// Residual after the update in standard deviations of the mean, of an innovation bounded by `most_sds`.
    fn unexplained_sds(&self, innovation: &Innovation<1>, most_sds: f64) -> f64 {
        let covariance = innovation.covariance.x;
        let bounded = (innovation.residual.x / covariance.sqrt()).clamp(-most_sds, most_sds);
        bounded * (self.variance_n2_m2 / covariance).min(1.0).sqrt()
    }
}

/// Cumulative sums that detect a positive and a negative mean of the residuals.
#[derive(Clone, Copy, Debug, Default)]
struct Sums {
    above_sds: f64,
    below_sds: f64,
}

impl Sums {
    /// Adds a value less the drift, and its negative less the drift. A sum that is zero stays so unless it `may_begin`.
    fn add(&mut self, added_sds: f64, drift_sds: f64, may_begin: bool) {
        for (sum_sds, added_sds) in [(&mut self.above_sds, added_sds), (&mut self.below_sds, -added_sds)] {
            let goes_on = *sum_sds > 0.0 || may_begin;
            *sum_sds = if goes_on { (*sum_sds + added_sds - drift_sds).max(0.0) } else { 0.0 };
        }
    }
}

/// Page's test on the residuals of one touch.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Second {
    mixture: Sums,
    moving: Sums,
    since_start_s: f64,
    /// Whether the contact was known at the last step.
    was_known: bool,
    /// Time for which the signal stays raised.
    held_s: f64,
}

impl Second {
    /// Takes innovations and whether the contact is known after them. Returns whether they raise the signal.
    pub(super) fn advance(
        &mut self,
        settings: &SecondSettings,
        dt_s: f64,
        found: Option<Found>,
        is_known: bool,
    ) -> bool {
        self.since_start_s += dt_s;
        self.held_s -= dt_s;
        let was_known = std::mem::replace(&mut self.was_known, is_known);
        let Some(found) = found.filter(|_| settings.evidence_sds > 0.0) else { return false };
        let may_begin = was_known && self.since_start_s >= settings.settling_s;
        let drift_sds = found.count * settings.drift_sds;
        let moving = found.moving.unwrap_or(found.mixture);
        for (sums, innovation) in [(&mut self.mixture, found.mixture), (&mut self.moving, moving)] {
            let unexplained_sds = found.unexplained_sds(&innovation, settings.most_sds);
            sums.add(found.count.sqrt() * unexplained_sds, drift_sds, may_begin);
        }
        let is_detected = self.evidence_sds() > settings.evidence_sds;
        if is_detected {
            self.raise(settings);
        }
        is_detected
    }

    /// Evidence of a positive or a negative mean that neither the mixture nor a moving object explains.
    fn evidence_sds(&self) -> f64 {
        let (mixture, moving) = (&self.mixture, &self.moving);
        mixture.above_sds.min(moving.above_sds).max(mixture.below_sds.min(moving.below_sds))
    }

    /// Whether a whisker that lies past a touched place by this distance bears on it.
    pub(super) fn bears(&self, settings: &SecondSettings, past_m: f64) -> bool {
        past_m > settings.past_m || (past_m > settings.supported_m && self.evidence_sds() > settings.supporting_sds)
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

    /// An innovation of one reading, in standard deviations of the reading, with this variance in those of the reading.
    fn found(sds: f64, covariance: f64) -> Option<Found> {
        let mixture = Innovation::of(vector![sds], Matrix1::new(covariance))?;
        Some(Found { mixture, moving: None, count: 1.0, variance_n2_m2: 1.0 })
    }

    /// Samples until the signal is raised, of at most 10,000, for these innovations in their standard deviations, which have this
    /// variance.
    fn raised_with(covariance: f64, is_known: impl Fn(usize) -> bool, sds: impl Fn(usize) -> f64) -> Option<usize> {
        let (settings, mut second) = (SecondSettings::default(), Second::default());
        let innovation = |i: usize| found(covariance.sqrt() * sds(i), covariance);
        (0..10_000).find(|&i| second.advance(&settings, 0.004, innovation(i), is_known(i)))
    }

    /// Likewise, for a known contact of which the readings show nothing new.
    fn raised(sds: impl Fn(usize) -> f64) -> Option<usize> {
        raised_with(1.0, |_| true, sds)
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

    /// A change of the moment after 200 samples.
    fn changed(i: usize) -> f64 {
        white(i) + if i < 200 { 0.0 } else { 2.0 }
    }

    #[test]
    fn verif_innovations_that_a_displaced_contact_explains_are_no_evidence() {
        assert!(raised_with(1.1, |_| true, changed).is_some());
        assert_eq!(raised_with(16.0, |_| true, changed), None);
        let found = found(3.0, 4.0).unwrap();
        let residual_sds = found.unexplained_sds(&found.mixture, 4.0);
        assert!((residual_sds - 3.0 / 4.0).abs() < 1e-12, "{residual_sds}");
    }

    #[test]
    fn verif_a_change_that_a_moving_object_explains_is_no_evidence() {
        let raised_beside = |moving: fn(usize) -> f64| {
            let (settings, mut second) = (SecondSettings::default(), Second::default());
            let found =
                |i: usize| Some(Found { moving: Some(found(moving(i), 1.0)?.mixture), ..found(changed(i), 1.0)? });
            (0..1000).find(|&i| second.advance(&settings, 0.004, found(i), true))
        };
        assert_eq!(raised_beside(white), None);
        assert_eq!(raised_beside(|i| -changed(i)), None);
        assert_eq!(raised_beside(changed), raised(changed));
    }

    #[test]
    fn verif_a_change_is_detected_only_if_it_begins_at_a_known_contact() {
        assert_eq!(raised_with(1.0, |_| false, changed), None);
        assert_eq!(raised_with(1.0, |i| i < 201, changed), raised(changed));
    }

    #[test]
    fn verif_innovations_support_a_contact_at_a_touched_place() {
        let (settings, mut second) = (SecondSettings::default(), Second::default());
        let bears = |second: &Second| [0.05e-3, 0.15e-3, 0.25e-3].map(|past_m| second.bears(&settings, past_m));
        (0..200).for_each(|_| _ = second.advance(&settings, 0.004, found(0.0, 1.0), true));
        assert_eq!(bears(&second), [false, false, true]);
        assert!(!second.advance(&settings, 0.004, found(3.0, 1.0), true));
        assert_eq!(bears(&second), [false, true, true]);
    }

    #[test]
    fn robust_a_single_outlier_does_not_raise_the_signal() {
        for sign in [-1.0, 1.0] {
            assert_eq!(raised(|i| if i % 50 == 0 { sign * 1e6 } else { white(i) }), None);
        }
    }
}
