//! What the filters with a Gaussian belief share: they differ in their two verbs only.

use std::sync::Arc;

use filters::{Gaussian, Innovation, Skipped};
use serde_json::Value;

use super::model::{ContactReading, StaticContact, hold, start};
use super::settings::{ContactSettings, Settings, SettingsError, parse};
use super::{Estimate, Knowledge, Method, Sample, Tracker};
use crate::sensor::CalibratedFace;

/// A filter with a Gaussian belief; the type holds its settings.
pub(super) trait GaussianFilter: Settings + Copy + Send + Sync + 'static {
    /// Memory, wander and start.
    fn contact(&self) -> ContactSettings;

    /// Carries the belief through the process.
    fn predict(&self, belief: &mut Gaussian<2>, process: &StaticContact<'_>) -> Result<(), Skipped>;

    /// Conditions the belief on a reading.
    fn update(
        &self,
        belief: &mut Gaussian<2>,
        measurement: &ContactReading<'_>,
        reading_n_m: f64,
    ) -> Result<Innovation<1>, Skipped>;
}

struct GaussianMethod<Filter> {
    filter: Filter,
    knowledge: Arc<Knowledge>,
}

pub(super) fn build<Filter: GaussianFilter>(
    config: &Value,
    knowledge: &Arc<Knowledge>,
) -> Result<Box<dyn Method>, SettingsError> {
    Ok(Box::new(GaussianMethod::<Filter> { filter: parse(config)?, knowledge: knowledge.clone() }))
}

impl<Filter: GaussianFilter> Method for GaussianMethod<Filter> {
    fn begin(&self, face: &Arc<CalibratedFace>, _seed: u64) -> Box<dyn Tracker> {
        Box::new(GaussianTracker {
            filter: self.filter,
            noise_sd_n_m: self.knowledge.noise_sd_n_m,
            belief: start(face, self.filter.contact().start_away_sd_m),
            face: face.clone(),
        })
    }
}

struct GaussianTracker<Filter> {
    filter: Filter,
    noise_sd_n_m: f64,
    face: Arc<CalibratedFace>,
    belief: Gaussian<2>,
}

impl<Filter: GaussianFilter> Tracker for GaussianTracker<Filter> {
    fn step(&mut self, sample: &Sample) -> Option<Estimate> {
        let process = StaticContact::new(&self.face, sample, self.filter.contact().wander_m_sqrt_s);
        // A belief whose covariance has lost its definiteness says nothing any more.
        self.filter.predict(&mut self.belief, &process).ok()?;
        self.belief.fade(self.filter.contact().fading);
        let measurement = ContactReading::new(&self.face, self.noise_sd_n_m);
        let innovation = self.filter.update(&mut self.belief, &measurement, sample.reading_n_m).ok();
        Some(hold(&mut self.belief, &self.face, innovation))
    }
}
