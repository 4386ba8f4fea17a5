//! Bayesian model averaging over models of the object, as in the plane ([`crate::estimators`]).
//!
//! Each candidate is a fit of an object to all readings. It gives its evidence, the marginal likelihood of the readings
//! under its model, by Laplace's approximation (Kass and Raftery, "Bayes factors", JASA 90(430), 1995); prior and evidence give its
//! posterior probability. Until the first fits have ended, the priors are the weights, and the estimate is that of a filter whose
//! contact slides along a rod: the filters with which the fits begin assume a contact at rest, and would be overconfident. The same
//! filter takes the place of fits whose readings do not determine the contact, for example of a base at rest. The
//! estimate is the mean and covariance of the mixture, so that the disagreement of probable candidates counts as uncertainty.
//! Surfaces of two curvatures, the most flexible objects, have the smallest prior. The models are in doubt if the innovations of
//! the mixture are too large, as in the plane, or if the readings contradict the fits with more than half of the probability.

use std::sync::Arc;

use filters::{Gaussian, Innovation};
use nalgebra::{Matrix1, Matrix3, Vector1, Vector3};
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};

use super::follower::{self, Tracker};
use super::motion::MotionSettings;
use super::{Direction, Estimate, Kind, Knowledge, Method, Radius, SPATIAL_ESTIMATORS, Sample, spatial_estimator};
use crate::candidates::{CANDIDATES, LEAST_KNOWN, check, refused, unknown};
use crate::doubt::{DoubtSettings, Doubtful};
use crate::estimators::{MOST_MODELS, ModelShares};
use crate::settings::{Settings, SettingsError, with_defaults, within};
use crate::space::sensor::CalibratedSpace;

/// Probability that the next touch is one of the same object, which keeps the probabilities of the candidates; those of another
/// object are the priors.
const SAME_OBJECT: f64 = 0.5;

/// Probability of the candidates whose contact is determined above which the innovations of the mixture count for the signal of
/// doubt.
const DETERMINED: f64 = 0.9;

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
    /// Whether the candidate is used only for real sensors ([`crate::space::sensor::CalibratedSpace::real_sensor`]).
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    real_sensors_only: bool,
}

/// Settings.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub(super) struct Config {
    /// The candidates.
    candidates: Vec<Candidate>,
    /// Filter whose estimate replaces those of candidates whose contact is not determined yet. Not used for real sensors, whose
    /// contact may stick. `null`: such candidates keep their own estimates, at first those of filters that assume a contact at
    /// rest.
    early: Option<follower::Config>,
    /// Power of the evidence: below 1 because the errors of neighbouring readings depend on one another, as those of a wrong
    /// model and of the ringing do.
    evidence_power: f64,
    /// Factor of the covariance, for errors that no candidate has.
    covariance_factor: f64,
    /// Probability of a candidate, relative to the largest, below which it does not count for the estimate.
    ignored_share: f64,
    /// Signal that the models are in doubt, by the innovations of the mixture.
    doubt: DoubtSettings,
    /// Standard deviations of a real sensor's mounting from that of its calibration, unused if the calibration states the
    /// deviation. `null` if the mounting is exact.
    mounting: Option<UnknownMounting>,
}

/// Standard deviations of a mounting that has not been learnt from touches at known places.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
struct UnknownMounting {
    /// Standard deviation of the position along each axis.
    place_sd_m: f64,
    /// Standard deviation of the rotation about each axis of Base.
    turn_sd_rad: f64,
}

impl Default for UnknownMounting {
    fn default() -> Self {
        Self { place_sd_m: 0.2e-3, turn_sd_rad: 6e-3 }
    }
}

impl UnknownMounting {
    /// Covariance (m2), 3x3, of a contact in the nominal Base, given its coordinates in the actual one.
    fn covariance_m2(&self, contact: &Vector3<f64>) -> Matrix3<f64> {
        // A small rotation w moves the contact by w x p.
        let turned = Matrix3::identity() * contact.norm_squared() - contact * contact.transpose();
        Matrix3::identity() * self.place_sd_m.powi(2) + turned * self.turn_sd_rad.powi(2)
    }
}

impl Default for Config {
    /// The factor, the early filter and the weights of the objects along which a contact slides were chosen on random scenes in
    /// space that are not reported. Friction holds a real wire on thin objects: a contact that sticks is about four times as
    /// probable as one that slides. Sliding over a wide object is evident from the readings. The mounting has the standard
    /// deviations of `installed` in the plane.
    fn default() -> Self {
        let candidate = |(name, weight): (&str, f64)| Candidate {
            name: name.into(),
            settings: Map::new(),
            weight,
            real_sensors_only: name == "point-fit",
        };
        let weights =
            [("line-fit", 10.0), ("cone-fit", 10.0), ("sphere-fit", 5.0), ("patch-fit", 1.0), ("point-fit", 100.0)];
        Self {
            candidates: weights.map(candidate).into(),
            early: Some(follower::Config::new(MotionSettings::fitted_cylinder())),
            evidence_power: 0.5,
            covariance_factor: 1.2,
            ignored_share: 0.02,
            doubt: DoubtSettings::default(),
            mounting: Some(UnknownMounting::default()),
        }
    }
}

impl Settings for Config {
    fn validate(&self) -> Result<(), SettingsError> {
        let weighted = self.candidates.iter().map(|candidate| (candidate.name.as_str(), candidate.weight));
        check(&weighted.collect::<Vec<_>>(), MOST_MODELS)?;
        if self.candidates.iter().all(|candidate| candidate.real_sensors_only) {
            let names: Vec<&str> = self.candidates.iter().map(|candidate| candidate.name.as_str()).collect();
            let found = format!("only candidates for real sensors ({})", names.join(", "));
            return Err(SettingsError::Parse(format!(
                "`{CANDIDATES}`: found {found}, expected at least one for all sensors"
            )));
        }
        within("evidence_power", self.evidence_power, 1e-3..=1.0)?;
        within("covariance_factor", self.covariance_factor, 1.0..=100.0)?;
        self.doubt.validate()?;
        self.early.map_or(Ok(()), |early| early.validate())?;
        if let Some(UnknownMounting { place_sd_m, turn_sd_rad }) = self.mounting {
            within("mounting.place_sd_m", place_sd_m, 0.0..=0.1)?;
            within("mounting.turn_sd_rad", turn_sd_rad, 0.0..=1.0)?;
        }
        within("ignored_share", self.ignored_share, 0.0..=0.5)
    }
}

/// The average of several methods.
pub(super) struct ModelAveraging {
    config: Arc<Config>,
    /// Names in the registry and methods of the candidates.
    methods: Vec<(&'static str, Box<dyn Method>)>,
    /// Whether the estimates of a touch are revised when it has ended.
    looks_back: bool,
}

impl ModelAveraging {
    /// # Errors
    /// [`SettingsError`] if a candidate is unknown or no fit, or its settings are invalid.
    pub(super) fn new(config: Config, looks_back: bool) -> Result<Self, SettingsError> {
        let method = |candidate: &Candidate| {
            let row = spatial_estimator(&candidate.name)
                .ok_or_else(|| unknown(CANDIDATES, &candidate.name, SPATIAL_ESTIMATORS.iter().map(|row| row.name)))?;
            if !matches!(row.kind, Kind::Fit(_)) {
                return Err(refused(
                    CANDIDATES,
                    &candidate.name,
                    "a method without evidence for its model, expected a fit",
                ));
            }
            Ok((row.name, row.kind.method(&with_defaults(&candidate.settings, row.defaults()))?))
        };
        let methods = config.candidates.iter().map(method).collect::<Result<_, _>>()?;
        Ok(Self { config: Arc::new(config), methods, looks_back })
    }
}

impl Method for ModelAveraging {
    fn begin(&self, knowledge: &Arc<Knowledge>) -> Box<dyn Tracker> {
        let CalibratedSpace { real_sensor, mounting, .. } = *knowledge.calibrated;
        let counts = |candidate: &Candidate| real_sensor || !candidate.real_sensors_only;
        let candidates = self.config.candidates.iter().zip(&self.methods).filter(|(candidate, _)| counts(candidate));
        let (mut names, mut trackers, mut weights) = (Vec::new(), Vec::new(), Vec::new());
        for (candidate, (name, method)) in candidates {
            names.push(*name);
            trackers.push(method.begin(knowledge));
            weights.push(candidate.weight);
        }
        if self.looks_back {
            trackers.iter_mut().for_each(|tracker| tracker.remember());
        }
        let total: f64 = weights.iter().sum();
        let first: Vec<f64> = weights.iter().map(|weight| weight / total).collect();
        Box::new(Average {
            prior: first.clone(),
            before: vec![0.0; names.len()],
            names,
            trackers,
            early: self.config.early.filter(|_| !real_sensor).map(|early| early.begin(knowledge)),
            left: first.clone(),
            first,
            mounting: self.config.mounting.filter(|_| real_sensor && mounting.is_none()),
            is_free: false,
            is_expected: false,
            doubtful: Doubtful::default(),
            config: self.config.clone(),
        })
    }
}

/// The candidates on the contacts of a recording.
struct Average {
    config: Arc<Config>,
    names: Vec<&'static str>,
    trackers: Vec<Box<dyn Tracker>>,
    /// The early filter. It is reset while the contacts of all candidates are determined.
    early: Option<Box<dyn Tracker>>,
    /// Probabilities of the candidates at the first touch.
    first: Vec<f64>,
    mounting: Option<UnknownMounting>,
    /// Probabilities of the candidates at the touch, and the logarithm of their evidence before it.
    prior: Vec<f64>,
    before: Vec<f64>,
    /// Probabilities of the candidates at the end of the last touch.
    left: Vec<f64>,
    is_free: bool,
    /// Whether the whisker touched the known object at the last sample, at which no contact was detected.
    is_expected: bool,
    doubtful: Doubtful,
}

impl Average {
    /// Probabilities of the candidates. One without evidence has the smallest of the others. If the readings contradict all
    /// objects, differences of the log evidence are divided by the smallest excess, as for overdispersed data (Burnham and
    /// Anderson, "Model selection and multimodel inference", 2002, section 2.5).
    fn shares(&self) -> Vec<f64> {
        let trackers = self.trackers.iter().zip(&self.before);
        let evidence: Vec<_> = trackers.map(|(tracker, before)| Some(tracker.log_evidence()? - before)).collect();
        let least = evidence.iter().flatten().copied().fold(f64::INFINITY, f64::min);
        let most = evidence.iter().flatten().copied().fold(f64::NEG_INFINITY, f64::max);
        let excess = self.trackers.iter().filter_map(|tracker| tracker.excess()).reduce(f64::min).unwrap_or(1.0);
        let power = self.config.evidence_power / excess;
        let share = |(prior, evidence): (&f64, &Option<f64>)| {
            let behind = if most.is_finite() { evidence.unwrap_or(least) - most } else { 0.0 };
            prior * (power * behind).exp()
        };
        let shares: Vec<f64> = self.prior.iter().zip(&evidence).map(share).collect();
        let total: f64 = shares.iter().sum();
        shares.into_iter().map(|share| share / total).collect()
    }

    /// Replaces the estimates of candidates whose contact is not determined by that of the early filter.
    fn replace_early(&mut self, sample: &Sample, estimates: &mut [Option<Estimate>]) {
        let Some(early) = &mut self.early else { return };
        if self.trackers.iter().all(|tracker| tracker.is_determined()) {
            return early.forget();
        }
        let Some(estimate) = early.step(sample) else { return };
        // The early filter models any object as a rod, whose direction and radius are therefore not stated.
        let estimate = Estimate { direction: None, radius: None, ..estimate };
        for (of_candidate, tracker) in estimates.iter_mut().zip(&self.trackers) {
            if !tracker.is_determined() && of_candidate.is_some() {
                *of_candidate = Some(estimate);
            }
        }
    }

    /// The estimate, with `model_doubtful` also set if the innovations of the mixture are too large.
    fn doubted(&self, estimate: Estimate) -> Estimate {
        let model_doubtful = estimate.model_doubtful.map(|contradicted| contradicted || self.doubtful.is_raised());
        Estimate { model_doubtful, ..estimate }
    }

    /// Whether another object is touched than before: the readings contradict the earlier one of the candidate that was the most
    /// probable at the touch.
    fn is_another(&self) -> bool {
        let likeliest = self.trackers.iter().zip(&self.prior).max_by(|a, b| a.1.total_cmp(b.1));
        likeliest.is_some_and(|(tracker, _)| tracker.is_another())
    }

    /// Estimate of the mixture, given the probabilities of the candidates. `None` if the probable ones have none.
    fn together(&self, shares: &[f64], estimates: &[Option<Estimate>]) -> Option<Estimate> {
        let most = shares.iter().copied().fold(0.0, f64::max);
        let stated = estimates.iter().zip(shares).filter_map(|(estimate, share)| Some((estimate.as_ref()?, *share)));
        let parts: Vec<(&Estimate, f64)> =
            stated.filter(|(_, share)| *share >= self.config.ignored_share * most).collect();
        let known: f64 = parts.iter().map(|(_, share)| share).sum();
        if known < LEAST_KNOWN {
            return None;
        }
        let (leading, _) = *parts.iter().max_by(|a, b| a.1.total_cmp(&b.1))?;
        let about = |vector: fn(&Estimate) -> Vector3<f64>, covariance: fn(&Estimate) -> Matrix3<f64>| {
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
        let radius = Gaussian::of_mixture(sizes);
        let innovations = parts.iter().filter_map(|(estimate, share)| Some((estimate.innovation?, *share)));
        let innovation = Innovation::of_mixture(innovations);
        let is_contradicted = |(estimate, _): &&(&Estimate, f64)| estimate.model_doubtful == Some(true);
        let contradicted: f64 = parts.iter().filter(is_contradicted).map(|(_, share)| share).sum();
        let contact = leading.contact.shifted(place.mean);
        let mean_normal = (leading.normal + normal.mean).normalize();
        let mut direction = direction(&parts);
        let [mut covariance_m2, mut normal_covariance] =
            [place.covariance, normal.covariance].map(|covariance| covariance * self.config.covariance_factor);
        if let Some(mounting) = &self.mounting {
            covariance_m2 += mounting.covariance_m2(&contact.vector());
            let across = Matrix3::identity() - mean_normal * mean_normal.transpose();
            normal_covariance += across * mounting.turn_sd_rad.powi(2);
            direction = direction.map(|one| Direction { sd_rad: one.sd_rad.hypot(mounting.turn_sd_rad), ..one });
        }
        Some(Estimate {
            contact,
            covariance_m2,
            normal: mean_normal,
            normal_covariance,
            direction,
            radius: radius.map(|size| Radius { radius_m: size.mean[0], sd_m: size.covariance[0].sqrt() }),
            innovation,
            models: Some(ModelShares::new(self.names.iter().copied().zip(shares.iter().copied()))),
            model_doubtful: Some(contradicted > 0.5 * known),
            ..*leading
        })
    }
}

/// Direction of the mixture, over the candidates that state one. `None` if they have less than [`LEAST_KNOWN`] of the
/// probability.
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
    (known >= LEAST_KNOWN * total).then(|| Direction { along, sd_rad: stated.iter().map(spread).sum::<f64>().sqrt() })
}

impl Tracker for Average {
    fn step(&mut self, sample: &Sample) -> Option<Estimate> {
        self.is_free = false;
        if std::mem::take(&mut self.is_expected) {
            self.prior.clone_from(&self.left);
        }
        let mut estimates: Vec<_> = self.trackers.iter_mut().map(|tracker| tracker.step(sample)).collect();
        self.replace_early(sample, &mut estimates);
        let of_all = self.trackers.iter().filter(|tracker| !tracker.has_begun_anew());
        let least_excess = of_all.filter_map(|tracker| tracker.excess()).fold(f64::INFINITY, f64::min);
        self.trackers.iter_mut().for_each(|tracker| tracker.compare(least_excess));
        let together = self.together(&self.shares(), &estimates);
        if self.is_another() {
            self.forget();
        }
        let together = together?;
        let shares = self.trackers.iter().zip(self.shares());
        let determined: f64 = shares.filter(|(tracker, _)| tracker.is_determined()).map(|(_, share)| share).sum();
        self.doubtful.advance(&self.config.doubt, sample.dt_s, together.innovation.filter(|_| determined > DETERMINED));
        Some(self.doubted(together))
    }

    fn hindsight(&mut self) -> Option<Vec<Option<Estimate>>> {
        let of_each: Vec<_> = self.trackers.iter_mut().map(|tracker| tracker.hindsight()).collect::<Option<_>>()?;
        let (samples, shares) = (of_each.iter().map(Vec::len).min()?, self.shares());
        let of_sample = |sample: usize| {
            let estimates: Vec<_> = of_each.iter().map(|estimates| estimates[sample]).collect();
            self.together(&shares, &estimates).map(|together| self.doubted(together))
        };
        Some((0..samples).map(of_sample).collect())
    }

    fn release(&mut self, sample: &Sample) {
        if !self.is_free {
            self.left = self.shares();
            let both = self.left.iter().zip(&self.first);
            self.prior = both.map(|(share, prior)| SAME_OBJECT * share + (1.0 - SAME_OBJECT) * prior).collect();
            self.doubtful.resume();
        }
        self.is_free = true;
        self.early.iter_mut().for_each(|early| early.release(sample));
        for (tracker, before) in self.trackers.iter_mut().zip(&mut self.before) {
            tracker.release(sample);
            *before = tracker.log_evidence().unwrap_or_default();
        }
    }

    fn expect_touch(&mut self, sample: &Sample) -> Option<Estimate> {
        let estimates: Vec<_> = self.trackers.iter_mut().map(|tracker| tracker.expect_touch(sample)).collect();
        let together = self.together(&self.left, &estimates);
        self.is_expected = together.is_some();
        together.map(|together| self.doubted(together))
    }

    fn forget(&mut self) {
        self.is_expected = false;
        self.trackers.iter_mut().chain(&mut self.early).for_each(|tracker| tracker.forget());
        self.prior.clone_from(&self.first);
        self.before.fill(0.0);
        self.doubtful.resume();
    }
}
