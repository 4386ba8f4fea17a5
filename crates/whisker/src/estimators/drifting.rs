//! Extended Kalman filter for an object in uniform motion.

use std::sync::Arc;

use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::extended::Extended;
use super::gaussian::{self, Follower};
use super::motion::Drifting;
use super::{Knowledge, Method, Touch, Tracker};
use crate::settings::{Settings, SettingsError, parse};

/// Settings.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub(super) struct Config {
    /// The filter.
    #[serde(with = "gaussian::without_motion")]
    filter: gaussian::Config<Extended>,
    /// Object and velocity.
    object: Drifting,
}

impl Default for Config {
    /// Hypotheses are dropped and merged earlier than by `round`, because those of a larger state take longer.
    fn default() -> Self {
        let filter = gaussian::Config { prune_share: 1e-3, merge_loss: 3e-2, ..gaussian::Config::round() };
        Self { filter, object: Drifting::default() }
    }
}

impl Settings for Config {
    fn validate(&self) -> Result<(), SettingsError> {
        self.filter.validate()?;
        self.object.validate()
    }
}

struct OfDrifting {
    config: Config,
    knowledge: Arc<Knowledge>,
}

pub(super) fn build(config: &Value, knowledge: &Arc<Knowledge>) -> Result<Box<dyn Method>, SettingsError> {
    Ok(Box::new(OfDrifting { config: parse(config)?, knowledge: knowledge.clone() }))
}

impl Method for OfDrifting {
    fn begin(&self, touch: &Touch<'_>) -> Box<dyn Tracker> {
        let Config { filter, object } = self.config;
        let middle_m = 0.5 * touch.face.rest.length_m();
        let object = object.beyond_pin(touch.face).after(touch.history, middle_m);
        Box::new(Follower::new(filter, object, touch, &self.knowledge))
    }
}
