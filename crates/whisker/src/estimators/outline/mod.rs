//! The object's convex outline as the unknown.
//!
//! Filters whose state is the contact forget: on a polygon the contact rests at a corner, then runs along a side within a few samples, and what
//! the first stroke has told of the side is gone at the second. Here the state is the outline itself, at rest in a fixed frame: a convex
//! [`curve`]. Where a whisker with a known base touches it follows by geometry alone ([`contact`]), without a process model, so that every
//! reading since the first touch, over all strokes and lift-offs, speaks of the same few numbers. They are fitted to all readings at once
//! ([`fit`]) under a prior that expects the radius to stay but lets it jump ([`prior`]).
//!
//! [`recursive`] does so while the samples come in, never with a sample from later on; [`hindsight`] once more at the end of a touch.

mod contact;
mod curve;
mod fit;
mod hindsight;
mod object;
mod prior;
mod readings;
mod recursive;

use std::sync::Arc;

use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::{Knowledge, Method, Touch, Tracker};
use crate::settings::{Settings, SettingsError, parse, within};
use hindsight::Reviser;
use prior::Prior;
use recursive::Tracer;

/// Settings.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub(super) struct Config {
    /// What is believed of outlines before anything is touched.
    prior: Prior,
    /// A reading farther off than this, in standard deviations, counts by its logarithm only.
    gate_sds: f64,
    /// Standard deviation of the contact along the whisker at which a filter hands over to the outline.
    start_sd_m: f64,
}

impl Default for Config {
    fn default() -> Self {
        Self { prior: Prior::default(), gate_sds: 5.0, start_sd_m: 2e-3 }
    }
}

impl Settings for Config {
    fn validate(&self) -> Result<(), SettingsError> {
        self.prior.validate()?;
        within("gate_sds", self.gate_sds, 1.0..=1e6)?;
        within("start_sd_m", self.start_sd_m, 1e-6..=1.0)
    }
}

struct Recursive {
    config: Config,
    knowledge: Arc<Knowledge>,
}

struct Hindsight {
    config: Config,
    knowledge: Arc<Knowledge>,
}

/// The estimator that states at each sample what the samples so far tell.
pub(super) fn build_recursive(config: &Value, knowledge: &Arc<Knowledge>) -> Result<Box<dyn Method>, SettingsError> {
    Ok(Box::new(Recursive { config: parse(config)?, knowledge: knowledge.clone() }))
}

/// The estimator that looks back at the end of each touch.
pub(super) fn build_hindsight(config: &Value, knowledge: &Arc<Knowledge>) -> Result<Box<dyn Method>, SettingsError> {
    Ok(Box::new(Hindsight { config: parse(config)?, knowledge: knowledge.clone() }))
}

impl Method for Recursive {
    fn begin(&self, touch: &Touch<'_>) -> Box<dyn Tracker> {
        Box::new(Tracer::new(self.config, touch, &self.knowledge))
    }
}

impl Method for Hindsight {
    fn begin(&self, touch: &Touch<'_>) -> Box<dyn Tracker> {
        Box::new(Reviser::new(Tracer::new(self.config, touch, &self.knowledge)))
    }
}
