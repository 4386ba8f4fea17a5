//! Settings of a fit.

use serde::{Deserialize, Serialize};

use crate::settings::{Settings, SettingsError, within};
use crate::space::estimators::follower;
use crate::space::estimators::motion::MotionSettings;

/// Settings of a fit.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(in crate::space::estimators) struct Config {
    /// Model of the contact's motion.
    pub(in crate::space::estimators) motion: MotionSettings,
    /// Number of initial hypotheses along the whisker.
    hypotheses: usize,
    /// Time since the touch after which the fit begins.
    pub(in crate::space::estimators) start_s: f64,
    /// Largest number of modes at the start, and after the first searches.
    pub(in crate::space::estimators) modes: usize,
    pub(in crate::space::estimators) kept_modes: usize,
    /// Weight of a mode, relative to the heaviest, below which it is dropped.
    pub(in crate::space::estimators) prune_share: f64,
    /// Gate, in standard deviations: the residual of a mean beyond it counts by its logarithm.
    pub(in crate::space::estimators) gate_sds: f64,
    /// Evaluations of the whisker's geometry per sample after which the searches pause, which bound the time of a step but for the
    /// mean in progress and a second fit. More in proportion if samples are more than 4 ms apart, so that a search takes the same
    /// time at low rates.
    pub(in crate::space::estimators) evaluations_per_step: usize,
    /// Standard deviation of the contact for deviations of the object from its model.
    pub(in crate::space::estimators) deviation_m: f64,
}

impl Config {
    /// Start and work of the searches, and the deviation, were chosen on random scenes in space that are not reported.
    pub(in crate::space::estimators) fn new(motion: MotionSettings) -> Self {
        Self {
            motion,
            hypotheses: 8,
            start_s: 0.3,
            modes: 8,
            kept_modes: 3,
            prune_share: 1e-2,
            gate_sds: 5.0,
            evaluations_per_step: 52,
            deviation_m: 2e-6,
        }
    }

    /// Settings of the filter with which a touch begins.
    pub(in crate::space::estimators) fn filter(&self, motion: MotionSettings) -> follower::Config {
        follower::Config { hypotheses: self.hypotheses, ..follower::Config::new(motion) }
    }
}

impl Settings for Config {
    fn validate(&self) -> Result<(), SettingsError> {
        within("start_s", self.start_s, 0.0..=1e3)?;
        within("modes", self.modes as f64, 1.0..=100.0)?;
        within("kept_modes", self.kept_modes as f64, 1.0..=100.0)?;
        within("prune_share", self.prune_share, 0.0..=0.5)?;
        within("gate_sds", self.gate_sds, 1.0..=1e6)?;
        within("evaluations_per_step", self.evaluations_per_step as f64, 1.0..=1e5)?;
        within("deviation_m", self.deviation_m, 0.0..=0.1)?;
        self.filter(self.motion).validate()
    }
}
