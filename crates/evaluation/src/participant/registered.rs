//! Registered estimators as participants.

use std::sync::Arc;

use serde_json::Value;
use testbed::replay::{self, Replay};
use testbed::results::RunEstimator;
use testbed::settings::merged_of;
use whisker::estimators::{EstimatorRow, Knowledge};

use super::{Participant, Task};

/// Registered estimator with its settings.
pub struct Registered {
    row: &'static EstimatorRow,
    config: Value,
}

impl Registered {
    /// Estimator with this name, with settings that override its defaults.
    ///
    /// # Errors
    /// If the name is unknown or the settings are not a JSON object.
    pub fn new(name: &str, overrides: &Value) -> anyhow::Result<Self> {
        let row = replay::registered(name)?;
        let config = merged_of(name, (row.defaults)(), overrides)?;
        Ok(Self { row, config })
    }
}

impl Participant for Registered {
    fn describe(&self) -> RunEstimator {
        RunEstimator {
            name: self.row.name.into(),
            about: self.row.about.into(),
            class: self.row.class,
            sensor_model: self.row.sensor_model.map(Into::into),
            config: self.config.clone(),
        }
    }

    fn sensor_model(&self) -> Option<&'static str> {
        self.row.sensor_model
    }

    fn check(&self, knowledge: &Arc<Knowledge>) -> anyhow::Result<()> {
        replay::method(self.row, &self.config, knowledge).map(drop)
    }

    fn replay(&self, task: &Task<'_>) -> anyhow::Result<Replay> {
        let &Task { knowledge, samples, touched, trace, seed } = task;
        let mut runner = replay::runner(self.row, &self.config, knowledge, trace, seed)?;
        Ok(replay::replay(&mut runner, samples, touched))
    }
}
