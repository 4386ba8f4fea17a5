//! Signal that the readings contradict the models of a method, common to model averages of the plane and of space.

use filters::Innovation;
use serde::{Deserialize, Serialize};

use crate::settings::{SettingsError, within};

/// Largest threshold relative to the upper limit of a value: the mean hardly exceeds a higher one.
const LARGEST_SHARE: f64 = 0.9;

/// Settings of the signal that the models are in doubt.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub(crate) struct DoubtSettings {
    /// Time over which the mixture's normalised innovations squared, per reading, are averaged (exponentially).
    pub window_s: f64,
    /// Upper limit of a value. It bounds the influence of outliers and of the first moments after a touch or a jump, when correct
    /// estimates also have large innovations.
    pub most_nis: f64,
    /// Mean above which the models are in doubt; 1 if the predictive distribution of the mixture is right. A lower value
    /// detects more and raises more false alarms. At most [`LARGEST_SHARE`] of `most_nis`. The doubt lasts until the mean has
    /// fallen halfway from there to 1, so that one contradiction is one signal.
    pub nis: f64,
}

impl Default for DoubtSettings {
    /// Chosen on the training suite of random scenes in the plane.
    fn default() -> Self {
        Self { window_s: 0.5, most_nis: 9.0, nis: 4.0 }
    }
}

impl DoubtSettings {
    /// # Errors
    /// [`SettingsError`] if a value is out of range.
    pub(crate) fn validate(&self) -> Result<(), SettingsError> {
        within("doubt.window_s", self.window_s, 1e-3..=1e3)?;
        within("doubt.most_nis", self.most_nis, 1.0..=1e6)?;
        within("doubt.nis", self.nis, 1.0..=LARGEST_SHARE * self.most_nis)
    }
}

/// Signal that the readings contradict the mixture: the running mean of its normalised innovations squared per reading, with the
/// covariance of the predictive distribution that all candidates together have. Candidates that disagree with one
/// another widen it and do not raise the signal.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Doubtful {
    nis: f64,
    is_raised: bool,
}

impl Default for Doubtful {
    fn default() -> Self {
        Self { nis: 1.0, is_raised: false }
    }
}

impl Doubtful {
    /// Takes the mixture's innovation after a step.
    pub(crate) fn advance<const M: usize>(
        &mut self,
        settings: &DoubtSettings,
        dt_s: f64,
        innovation: Option<Innovation<M>>,
    ) {
        let Some(Innovation { nis, .. }) = innovation else { return };
        let per_reading = nis / M as f64;
        self.nis += (per_reading.min(settings.most_nis) - self.nis) * (1.0 - (-dt_s / settings.window_s).exp());
        let threshold = if self.is_raised { 0.5 * (1.0 + settings.nis) } else { settings.nis };
        self.is_raised = self.nis > threshold;
    }

    /// Begins the next touch. What contradicted the models of the last one is no evidence about it. A mean below 1 remains, since
    /// stated variances that are too large are those of the sensor.
    pub(crate) fn resume(&mut self) {
        self.nis = self.nis.min(1.0);
        self.is_raised = false;
    }

    /// The signal with this mean at the start, for models that may be wrong.
    pub(crate) fn starting_at(nis: f64) -> Self {
        Self { nis, is_raised: false }
    }

    /// Running mean of the normalised innovations squared per reading.
    pub(crate) fn mean_nis(&self) -> f64 {
        self.nis
    }

    /// Whether the models are in doubt.
    pub(crate) fn is_raised(&self) -> bool {
        self.is_raised
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::{Matrix1, Matrix2, vector};

    use super::*;

    /// Samples until the signal is raised, of at most 1000, and the same with two readings of that NIS each.
    fn raised(nis: impl Fn(usize) -> f64) -> Option<usize> {
        let settings = DoubtSettings::default();
        let (mut one, mut two) = (Doubtful::default(), Doubtful::default());
        (0..1000).find(|&i| {
            let residual = nis(i).sqrt();
            one.advance(&settings, 0.01, Innovation::of(vector![residual], Matrix1::new(1.0)));
            two.advance(&settings, 0.01, Innovation::of(vector![residual, -residual], Matrix2::identity()));
            assert!((one.nis - two.nis).abs() < 1e-12 * one.nis);
            one.is_raised()
        })
    }

    #[test]
    fn verif_doubt_is_raised_by_lasting_innovations() {
        // Squares of an evenly spaced quantile sample of the normal distribution, with mean about 1.
        let consistent = |i: usize| [0.01, 3.2, 0.3, 0.02, 0.9, 0.2, 2.3, 1.1][i % 8];
        assert_eq!(raised(consistent), None);
        let lasting = raised(|_| 6.0).unwrap();
        assert!((20..100).contains(&lasting), "{lasting}");
        // An outlier now and then is none, nor is a tenth of a second of large innovations, as after a jump.
        assert_eq!(raised(|i| if i % 50 == 0 { 1e4 } else { consistent(i) }), None);
        assert_eq!(raised(|i| if (500..510).contains(&i) { 100.0 } else { consistent(i) }), None);
    }

    #[test]
    fn robust_a_threshold_that_no_mean_exceeds_is_refused() {
        let of = |nis: f64| DoubtSettings { nis, ..DoubtSettings::default() };
        assert!(of(8.0).validate().is_ok());
        let refused = of(16.0).validate().unwrap_err().to_string();
        assert!(refused.contains("doubt.nis") && refused.contains("8.1"), "{refused}");
    }

    #[test]
    fn verif_a_doubt_lasts_until_the_mean_is_halfway_to_one_or_the_touch_ends() {
        let settings = DoubtSettings::default();
        let mut doubtful = Doubtful::default();
        let mut advance = |nis: f64, count: usize| {
            let innovation = Innovation::of(vector![nis.sqrt()], Matrix1::new(1.0));
            (0..count).for_each(|_| doubtful.advance(&settings, 0.01, innovation));
            doubtful
        };
        assert!(!advance(3.0, 1000).is_raised(), "never above the threshold");
        assert!(advance(6.0, 1000).is_raised() && advance(2.6, 1000).is_raised());
        assert!(!advance(2.4, 1000).is_raised());
        let mut next = advance(6.0, 1000);
        next.resume();
        assert!(!next.is_raised());
    }
}
