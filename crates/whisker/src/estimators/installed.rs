//! Extended Kalman filter, and smoother, for a sensor whose gain and mounting may differ from the calibrated ones.

use std::sync::Arc;

use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::extended::Extended;
use super::gaussian::{self, Follower, GaussianFilter};
use super::iterated::Iterated;
use super::motion::Installed;
use super::smoother::{self, Recorder};
use super::{Knowledge, Method, Touch, Tracker};
use crate::settings::{Settings, SettingsError, parse, to_json, with_defaults};

/// Settings.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields, bound = "Filter: GaussianFilter")]
pub(super) struct Config<Filter> {
    /// The filter.
    #[serde(with = "gaussian::without_motion")]
    filter: gaussian::Config<Filter>,
    /// Object, gain and mounting.
    sensor: Installed,
}

impl<Filter: GaussianFilter> Config<Filter> {
    /// Hypotheses are dropped and merged earlier than by the same filter without gain and mounting, because those of a larger state
    /// take longer.
    fn with(filter: gaussian::Config<Filter>) -> Self {
        Self {
            filter: gaussian::Config { prune_share: 1e-3, merge_loss: 3e-2, ..filter },
            sensor: Installed::default(),
        }
    }
}

impl Config<Extended> {
    /// Settings of the filter.
    pub(super) fn recursive() -> Self {
        Self::default()
    }
}

impl Config<Iterated> {
    /// Settings of the smoother: each touch begins anew, and the contact is not searched for at another place.
    pub(super) fn hindsight() -> Self {
        Self::with(gaussian::Config { evidence_power: 0.7, corrected: true, ..gaussian::Config::default() })
    }
}

impl<Filter: GaussianFilter> Default for Config<Filter> {
    fn default() -> Self {
        Self::with(gaussian::Config::round())
    }
}

impl<Filter: GaussianFilter> Settings for Config<Filter> {
    fn validate(&self) -> Result<(), SettingsError> {
        self.filter.validate()?;
        self.sensor.validate()
    }
}

struct OfInstalled {
    config: Config<Extended>,
    knowledge: Arc<Knowledge>,
}

pub(super) fn build_recursive(config: &Value, knowledge: &Arc<Knowledge>) -> Result<Box<dyn Method>, SettingsError> {
    Ok(Box::new(OfInstalled { config: parse(config)?, knowledge: knowledge.clone() }))
}

impl Method for OfInstalled {
    fn begin(&self, touch: &Touch<'_>) -> Box<dyn Tracker> {
        let Config { filter, sensor } = self.config;
        Box::new(Follower::new(filter, sensor.beyond_pin(touch.face), touch, &self.knowledge))
    }
}

struct SmootherOfInstalled {
    config: Config<Iterated>,
    knowledge: Arc<Knowledge>,
}

pub(super) fn build_hindsight(config: &Value, knowledge: &Arc<Knowledge>) -> Result<Box<dyn Method>, SettingsError> {
    // Settings that are not given are those of hindsight.
    let config = match config.as_object() {
        Some(own) => parse::<Config<Iterated>>(&with_defaults(own, to_json(&Config::hindsight())))?,
        None => parse(config)?,
    };
    smoother::check_used(&config.filter)?;
    Ok(Box::new(SmootherOfInstalled { config, knowledge: knowledge.clone() }))
}

impl Method for SmootherOfInstalled {
    fn begin(&self, touch: &Touch<'_>) -> Box<dyn Tracker> {
        let Config { filter, sensor } = self.config;
        let follower = Follower::new(filter, sensor.beyond_pin(touch.face), touch, &self.knowledge);
        Box::new(Recorder::new(follower))
    }
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;
    use crate::estimators::testing::knowledge;

    #[test]
    fn verif_settings_in_part_leave_the_others_of_the_smoother() {
        let knowledge = Arc::new(knowledge());
        for part in [json!({}), json!({"sensor": {"gain_sd": 0.02}})] {
            assert!(build_hindsight(&part, &knowledge).is_ok(), "{part}");
        }
        let kept = json!({"filter": {"kept_share": 0.5}});
        assert!(build_hindsight(&kept, &knowledge).err().unwrap().to_string().contains("kept_share"));
    }
}
