//! The object's convex outline as the state.
//!
//! Filters whose state is the contact have a short memory: on a polygon the contact rests at a corner, then moves along
//! a side within a few samples, and the information about the side from the first stroke is lost at the second. Here
//! the state is the outline itself, at rest in a fixed frame: a convex [`curve`]. The contact of a whisker with a known
//! base follows by geometry alone ([`contact`]), without a process model, so that every reading since the first touch,
//! over all strokes and lift-offs, informs the same state. It is fitted to all [`readings`] at once ([`fit`]) under a
//! prior of constant radius with jumps ([`prior`]), by a [`search`] over several steps.
//!
//! [`recursive`] updates the outline at each sample, from the samples so far; [`hindsight`] once more at the end of a
//! touch.

mod contact;
mod curve;
mod fit;
mod hindsight;
mod object;
mod prior;
mod readings;
mod recursive;
mod search;

use std::sync::Arc;

use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::doubt::Search;
use super::{Knowledge, Method, Touch, Tracker};
use crate::settings::{Settings, SettingsError, parse, within};
use hindsight::Reviser;
use prior::Prior;
use recursive::Tracer;

/// Settings.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub(super) struct Config {
    /// Prior of the outline.
    prior: Prior,
    /// Gate, in standard deviations, beyond which the cost of a residual grows logarithmically.
    gate_sds: f64,
    /// Search for another object if the readings refute the known one.
    search: Search,
    /// Standard deviation of the contact along the whisker at which the outline replaces the filter.
    start_sd_m: f64,
}

impl Default for Config {
    fn default() -> Self {
        Self {
            prior: Prior::default(),
            gate_sds: 5.0,
            search: Search { window: 25.0, nis: 6.0, share: 0.5, pause_s: 0.2 },
            start_sd_m: 2e-3,
        }
    }
}

impl Settings for Config {
    fn validate(&self) -> Result<(), SettingsError> {
        self.prior.validate()?;
        within("gate_sds", self.gate_sds, 1.0..=1e6)?;
        self.search.validate()?;
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

/// The estimator whose estimates depend on the samples so far.
pub(super) fn build_recursive(config: &Value, knowledge: &Arc<Knowledge>) -> Result<Box<dyn Method>, SettingsError> {
    Ok(Box::new(Recursive { config: parse(config)?, knowledge: knowledge.clone() }))
}

/// The estimator that revises its estimates at the end of each touch.
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
