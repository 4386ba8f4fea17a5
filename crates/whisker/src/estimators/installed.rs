//! Extended Kalman filter for a sensor whose gain and mounting may differ from the calibrated ones.

use std::sync::Arc;

use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::extended::Extended;
use super::gaussian::{self, Follower};
use super::motion::Installed;
use super::{Knowledge, Method, Touch, Tracker};
use crate::settings::{Settings, SettingsError, parse};

/// Settings.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub(super) struct Config {
    /// The filter.
    #[serde(with = "gaussian::without_motion")]
    filter: gaussian::Config<Extended>,
    /// Object, gain and mounting.
    sensor: Installed,
}

impl Default for Config {
    /// Hypotheses are dropped and merged earlier than by `round`, because those of a larger state take longer.
    fn default() -> Self {
        let filter = gaussian::Config { prune_share: 1e-3, merge_loss: 3e-2, ..gaussian::Config::round() };
        Self { filter, sensor: Installed::default() }
    }
}

impl Settings for Config {
    fn validate(&self) -> Result<(), SettingsError> {
        self.filter.validate()?;
        self.sensor.validate()
    }
}

struct OfInstalled {
    config: Config,
    knowledge: Arc<Knowledge>,
}

pub(super) fn build(config: &Value, knowledge: &Arc<Knowledge>) -> Result<Box<dyn Method>, SettingsError> {
    Ok(Box::new(OfInstalled { config: parse(config)?, knowledge: knowledge.clone() }))
}

impl Method for OfInstalled {
    fn begin(&self, touch: &Touch<'_>) -> Box<dyn Tracker> {
        let Config { filter, sensor } = self.config;
        Box::new(Follower::new(filter, sensor.beyond_pin(touch.face), touch, &self.knowledge))
    }
}
