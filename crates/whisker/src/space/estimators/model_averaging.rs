//! Bayesian model averaging over models of the object, as in the plane ([`crate::estimators`]).
//!
//! Each candidate predicts every reading and so gives its likelihood `N(y; 0, S)`; prior and likelihood give its posterior
//! probability. The estimate is the mean and covariance of the mixture, so that the disagreement of probable candidates counts as
//! uncertainty. The more flexible a candidate, the smaller its prior.

use filters::imm::{Modes, Transition};
use filters::{Gaussian, Innovation};
use nalgebra::{Matrix1, Vector1, Vector3};
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};
use std::sync::Arc;

use super::follower::Tracker;
use super::{Direction, Estimate, Kind, Knowledge, Method, Radius, SPATIAL_ESTIMATORS, Sample, spatial_estimator};
use crate::settings::{Settings, SettingsError, within};

/// Largest number of candidates.
const MOST: usize = 16;

/// Least probability of the candidates with an estimate for which there is one of the mixture.
const LEAST_KNOWN: f64 = 0.5;

/// A method to average over.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Candidate {
    /// Name in the registry.
    name: String,
    /// Settings that differ from its default ones.
    #[serde(default, skip_serializing_if = "Map::is_empty")]
    settings: Map<String, Value>,
    /// Prior probability, relative to the others.
    weight: f64,
}

/// Settings.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub(super) struct Config {
    /// The candidates.
    candidates: Vec<Candidate>,
    /// Gate, in standard deviations: a larger innovation counts as evidence as if it lay at the gate.
    gate_sds: f64,
    /// Power of the likelihoods: below 1 because a fit follows the readings with a delay, so that the errors of neighbouring
    /// predictions depend on one another.
    evidence_power: f64,
    /// Factor of the covariance, for errors that no candidate has.
    covariance_factor: f64,
    /// Mean time between changes of the right candidate.
    sojourn_s: f64,
    /// Probability of a candidate, relative to the largest, below which it does not count for the estimate.
    ignored_share: f64,
}

impl Default for Config {
    fn default() -> Self {
        let candidate = |(name, weight): (&str, f64)| Candidate { name: name.into(), settings: Map::new(), weight };
        Self {
            candidates: [("line-fit", 20.0), ("cylinder-fit", 5.0), ("sphere-fit", 5.0), ("patch-fit", 1.0)]
                .map(candidate)
                .into(),
            gate_sds: 5.0,
            evidence_power: 0.3,
            covariance_factor: 1.2,
            sojourn_s: 1000.0,
            ignored_share: 0.02,
        }
    }
}

impl Settings for Config {
    fn validate(&self) -> Result<(), SettingsError> {
        within("candidates", self.candidates.len() as f64, 1.0..=MOST as f64)?;
        for (place, candidate) in self.candidates.iter().enumerate() {
            within("candidates.weight", candidate.weight, 1e-9..=1e9)?;
            if self.candidates[..place].iter().any(|other| other.name == candidate.name) {
                return Err(refused(&candidate.name, "named twice, expected each name once"));
            }
        }
        within("gate_sds", self.gate_sds, 1.0..=1e6)?;
        within("evidence_power", self.evidence_power, 1e-3..=1.0)?;
        within("covariance_factor", self.covariance_factor, 1.0..=100.0)?;
        within("sojourn_s", self.sojourn_s, 1e-3..=1e9)?;
        within("ignored_share", self.ignored_share, 0.0..=0.5)
    }
}

fn refused(name: &str, why: &str) -> SettingsError {
    SettingsError::Parse(format!("`candidates`: `{name}` is {why}"))
}

/// The average of several methods.
pub(super) struct ModelAveraging {
    config: Arc<Config>,
    methods: Vec<Box<dyn Method>>,
}

impl ModelAveraging {
    /// # Errors
    /// [`SettingsError`] if a candidate is unknown, itself an average, or its settings are invalid.
    pub(super) fn new(config: Config) -> Result<Self, SettingsError> {
        let method = |candidate: &Candidate| {
            let row = spatial_estimator(&candidate.name).ok_or_else(|| {
                let known: Vec<_> = SPATIAL_ESTIMATORS.iter().map(|row| row.name).collect();
                refused(&candidate.name, &format!("unknown, expected one of: {}", known.join(", ")))
            })?;
            if matches!(row.kind, Kind::Average) {
                return Err(refused(&candidate.name, "a model average itself, expected a single method"));
            }
            let mut settings = row.defaults();
            if let Some(all) = settings.as_object_mut() {
                all.extend(candidate.settings.clone());
            }
            row.kind.method(&settings)
        };
        let methods = config.candidates.iter().map(method).collect::<Result<_, _>>()?;
        Ok(Self { config: Arc::new(config), methods })
    }
}

impl Method for ModelAveraging {
    fn begin(&self, knowledge: &Arc<Knowledge>) -> Box<dyn Tracker> {
        let weights: Vec<f64> = self.config.candidates.iter().map(|candidate| candidate.weight).collect();
        Box::new(Average {
            config: self.config.clone(),
            trackers: self.methods.iter().map(|method| method.begin(knowledge)).collect(),
            right: Modes::new(weights.iter().copied()),
            weights,
        })
    }
}

/// The candidates on one contact.
struct Average {
    config: Arc<Config>,
    trackers: Vec<Box<dyn Tracker>>,
    right: Modes,
    weights: Vec<f64>,
}

impl Average {
    /// Logarithm of the likelihood of an innovation, bounded by the gate.
    fn log_evidence(&self, innovation: &Innovation<2>) -> f64 {
        innovation.log_likelihood() + 0.5 * (innovation.nis - self.config.gate_sds.powi(2)).max(0.0)
    }

    /// Updates the candidates' probabilities and returns the innovation of the mixture.
    fn weigh(&mut self, dt_s: f64, estimates: &[Option<Estimate>]) -> Option<Innovation<2>> {
        let sojourns_s = vec![self.config.sojourn_s; self.trackers.len()];
        self.right.predict(&Transition::from_sojourns(dt_s, &sojourns_s, &self.weights));
        let innovations: Vec<_> = estimates.iter().map(|estimate| estimate.as_ref()?.innovation).collect();
        let known = innovations.iter().zip(self.right.probabilities());
        let innovation = Innovation::of_mixture(known.filter_map(|(found, share)| Some(((*found)?, *share))))?;
        let evidence: Vec<_> = innovations.iter().map(|found| Some(self.log_evidence(found.as_ref()?))).collect();
        // A candidate without a prediction gets the smallest likelihood of the others.
        let least = evidence.iter().flatten().copied().fold(f64::INFINITY, f64::min);
        let tempered: Vec<_> =
            evidence.iter().map(|found| Some(self.config.evidence_power * found.unwrap_or(least))).collect();
        self.right.reweight(&tempered)?;
        Some(innovation)
    }

    /// Estimate of the mixture. `None` if the probable candidates have none.
    fn together(&self, estimates: &[Option<Estimate>], innovation: Option<Innovation<2>>) -> Option<Estimate> {
        let shares = self.right.probabilities();
        let most = shares.iter().copied().fold(0.0, f64::max);
        let stated = estimates.iter().zip(shares).filter_map(|(estimate, share)| Some((estimate.as_ref()?, *share)));
        let parts: Vec<(&Estimate, f64)> =
            stated.filter(|(_, share)| *share >= self.config.ignored_share * most).collect();
        let known: f64 = parts.iter().map(|(_, share)| share).sum();
        if known < LEAST_KNOWN {
            return None;
        }
        let (leading, _) = *parts.iter().max_by(|a, b| a.1.total_cmp(&b.1))?;
        let about = |vector: fn(&Estimate) -> Vector3<f64>, covariance: fn(&Estimate) -> nalgebra::Matrix3<f64>| {
            let part = |(estimate, share): &(&Estimate, f64)| {
                (Gaussian::new(vector(estimate) - vector(leading), covariance(estimate)), *share)
            };
            Gaussian::of_mixture(parts.iter().map(part))
        };
        let place = about(|estimate| estimate.contact.vector(), |estimate| estimate.covariance_m2)?;
        let normal = about(|estimate| estimate.normal, |estimate| estimate.normal_covariance)?;
        let sizes = parts.iter().filter_map(|(estimate, share)| {
            let Radius { radius_m, sd_m } = estimate.radius?;
            Some((Gaussian::new(Vector1::new(radius_m), Matrix1::new(sd_m * sd_m)), *share))
        });
        let radius = Gaussian::of_mixture(sizes.collect::<Vec<_>>());
        Some(Estimate {
            contact: leading.contact.shifted(place.mean),
            covariance_m2: place.covariance * self.config.covariance_factor,
            normal: (leading.normal + normal.mean).normalize(),
            normal_covariance: normal.covariance * self.config.covariance_factor,
            direction: direction(&parts),
            radius: radius.map(|size| Radius { radius_m: size.mean[0], sd_m: size.covariance[0].sqrt() }),
            innovation,
            ..*leading
        })
    }
}

/// Direction of the mixture, over the candidates that state one. `None` if they have less than half of the probability.
fn direction(parts: &[(&Estimate, f64)]) -> Option<Direction> {
    let total: f64 = parts.iter().map(|(_, share)| share).sum();
    let stated: Vec<(Direction, f64)> =
        parts.iter().filter_map(|(estimate, share)| Some((estimate.direction?, *share))).collect();
    let known: f64 = stated.iter().map(|(_, share)| share).sum();
    let (leading, _) = *stated.iter().max_by(|a, b| a.1.total_cmp(&b.1))?;
    let signed = |one: &Direction| one.along * one.along.dot(&leading.along).signum();
    let along = stated.iter().map(|(one, share)| signed(one) * *share).sum::<Vector3<f64>>().normalize();
    let spread =
        |(one, share): &(Direction, f64)| share / known * (one.sd_rad.powi(2) + (signed(one) - along).norm_squared());
    (known >= 0.5 * total).then(|| Direction { along, sd_rad: stated.iter().map(spread).sum::<f64>().sqrt() })
}

impl Tracker for Average {
    fn step(&mut self, sample: &Sample) -> Option<Estimate> {
        let estimates: Vec<_> = self.trackers.iter_mut().map(|tracker| tracker.step(sample)).collect();
        let innovation = self.weigh(sample.dt_s, &estimates);
        self.together(&estimates, innovation)
    }
}
