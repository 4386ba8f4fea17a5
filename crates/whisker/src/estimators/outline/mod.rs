//! The outline as the unknown.
pub(super) mod batch;
mod contact;
mod curve;
mod fit;
pub(super) mod online;

use serde::{Deserialize, Serialize};

use super::settings::{Settings, SettingsError, within};
use fit::Prior;

/// Settings.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub(super) struct Config {
    /// What is believed of outlines.
    pub prior: Prior,
    /// Gate.
    pub gate_sds: f64,
    /// Rough
    pub rough_cost: f64,
    pub sure_cost: f64,
    pub sure_least: f64,
    pub new_variance: f64,
    pub online_rough: usize,
    pub online_steps: usize,
    pub start_sd_m: f64,
    /// Most steps of the search.
    pub iterations: usize,
}

impl Default for Config {
    fn default() -> Self {
        Self {
            prior: Prior::default(),
            gate_sds: 5.0,
            rough_cost: 1.0,
            sure_cost: 1.0,
            sure_least: 0.03,
            new_variance: 0.01,
            online_rough: 6,
            online_steps: 3,
            start_sd_m: 2e-3,
            iterations: 40,
        }
    }
}

impl Settings for Config {
    fn validate(&self) -> Result<(), SettingsError> {
        within("gate_sds", self.gate_sds, 1.0..=1e6)?;
        within("iterations", self.iterations as f64, 1.0..=1000.0)?;
        self.prior.validate()
    }
}

impl Config {
    fn sure(&self) -> Prior {
        Prior { change_cost: self.sure_cost, change_least: self.sure_least, change_large: 100.0, ..self.prior }
    }

    fn rough(&self) -> Prior {
        Prior { change_cost: self.rough_cost, change_least: 3e-3, change_large: 100.0, ..self.prior }
    }
}
