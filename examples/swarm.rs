//! An estimator in one file: a set of candidate contacts, each at rest in the world, weighted by their likelihood.

use std::sync::Arc;

use nalgebra::{Matrix2, Vector2};
use serde::{Deserialize, Serialize};
use serde_json::Value;
use whisker::estimators::{
    Estimate, EstimatorRow, Knowledge, Method, MethodClass, Sample, SettingsError, Touch, Tracker,
};
use whisker::frames::{Base, Point};
use whisker::sensor::{AlongAway, CalibratedFace};

/// The registry row.
pub(super) const ROW: EstimatorRow = EstimatorRow {
    name: "swarm",
    about: "candidate contacts at rest in the world, weighted by the readings",
    class: MethodClass::Recursive,
    sensor_model: None,
    defaults: || serde_json::to_value(Config::default()).expect("settings serialise"),
    build,
};

/// Difference of log-likelihood to the most probable candidate above which a candidate is dropped.
const HOPELESS: f64 = 30.0;

/// Log-likelihood of a reading for a candidate outside the calibrated domain: that of five standard deviations.
const OUTSIDE: f64 = -12.5;

/// Settings.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
struct Config {
    /// Number of candidates along the calibrated domain, and away from the undeflected whisker.
    nodes: usize,
}

impl Default for Config {
    fn default() -> Self {
        Self { nodes: 200 }
    }
}

fn build(config: &Value, knowledge: &Arc<Knowledge>) -> Result<Box<dyn Method>, SettingsError> {
    let config = Config::deserialize(config).map_err(|error| SettingsError::Parse(error.to_string()))?;
    if config.nodes < 2 {
        return Err(SettingsError::Range { key: "nodes", found: config.nodes as f64, expected: "2 or more".into() });
    }
    Ok(Box::new(Swarms { config, noise_sd_n_m: knowledge.noise_sd_n_m }))
}

/// The method: begins a set of candidates at each touch.
struct Swarms {
    config: Config,
    noise_sd_n_m: f64,
}

impl Method for Swarms {
    fn begin(&self, touch: &Touch<'_>) -> Box<dyn Tracker> {
        let (low_m, high_m) = touch.face.domain.arc_range_m();
        let nodes = self.config.nodes;
        let share = |i: usize| i as f64 / (nodes - 1) as f64;
        let places = (0..nodes).flat_map(|i| {
            let arc_m = low_m + share(i) * (high_m - low_m);
            let (lower_m, upper_m) = touch.face.domain.away_range_m(arc_m);
            (0..nodes)
                .map(move |j| touch.face.contact_at(AlongAway::new(arc_m, lower_m + share(j) * (upper_m - lower_m))))
        });
        Box::new(Swarm {
            face: touch.face.clone(),
            noise_sd_n_m: self.noise_sd_n_m,
            cell_m: (high_m - low_m) / (nodes - 1) as f64,
            places: places.map(|contact| Place { contact, log_weight: 0.0 }).collect(),
        })
    }
}

/// A candidate contact.
struct Place {
    contact: Point<Base>,
    log_weight: f64,
}

struct Swarm {
    face: Arc<CalibratedFace>,
    noise_sd_n_m: f64,
    /// Distance between neighbouring candidates along the whisker.
    cell_m: f64,
    places: Vec<Place>,
}

impl Swarm {
    /// Logarithm of the likelihood of a reading at a contact, up to a constant.
    fn log_likelihood(&self, contact: Point<Base>, reading_n_m: f64) -> f64 {
        let Some(expected) = self.face.predict(contact) else { return OUTSIDE };
        let variance_n2_m2 = self.noise_sd_n_m.powi(2) + self.face.model_variance_n2_m2(contact);
        -0.5 * ((reading_n_m - expected.reading_n_m).powi(2) / variance_n2_m2 + variance_n2_m2.ln())
            + self.noise_sd_n_m.ln()
    }
}

impl Tracker for Swarm {
    fn step(&mut self, sample: &Sample) -> Option<Estimate> {
        let mut places = std::mem::take(&mut self.places);
        for place in &mut places {
            place.contact = sample.motion.apply(place.contact);
            place.log_weight += self.log_likelihood(place.contact, sample.reading_n_m);
        }
        let best = places.iter().map(|place| place.log_weight).fold(f64::NEG_INFINITY, f64::max);
        places.retain(|place| place.log_weight > best - HOPELESS);
        self.places = places;

        let weights: Vec<f64> = self.places.iter().map(|place| (place.log_weight - best).exp()).collect();
        let total: f64 = weights.iter().sum();
        let weighed =
            || self.places.iter().zip(&weights).map(|(place, weight)| (place.contact.vector(), weight / total));
        let mean: Vector2<f64> = weighed().map(|(contact, weight)| contact * weight).sum();
        // A candidate represents its cell, over which the contact is uniformly distributed.
        let cell: Matrix2<f64> = Matrix2::identity() * (self.cell_m.powi(2) / 12.0);
        let spread: Matrix2<f64> =
            weighed().map(|(contact, weight)| (contact - mean) * (contact - mean).transpose() * weight).sum();
        let contact = Point::from_vector(mean);
        Some(Estimate {
            covariance_m2: Some(spread + cell),
            calibrated: self.face.predict(contact).is_some(),
            ..Estimate::at(contact, self.face.face)
        })
    }
}
