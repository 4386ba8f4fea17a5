//! Bayesian model averaging over several methods.
//!
//! Each candidate predicts every reading and so gives its likelihood, `N(y; 0, S)`. Prior and likelihood give the
//! posterior probability of each candidate (Bayes' theorem; Kass and Raftery, "Bayes factors", JASA 90(430), 1995): a
//! wrong model predicts poorly, an over-flexible one predicts diffusely. As long as the readings do not discriminate,
//! the priors decide. The estimate is the mean and covariance of the mixture, not of the most probable candidate, so
//! that the disagreement of probable candidates counts as uncertainty.
//!
//! A *considered* candidate, for example one that doubts the calibration, does not move the mean unless the evidence for it
//! is large. Its belief is part of the covariance about the stated mean, so that a possible systematic
//! error that the readings do not show counts as uncertainty and costs no accuracy. Its evidence against the others has a
//! power of its own: innovations hardly depend on errors of the calibration, and models that are slightly wrong
//! in the same way imitate them. For the mean, which needs a decision, the power is larger than for the covariance, and
//! evidence below a threshold does not count.
//!
//! The stated variance of the sensor model's error is an upper bound that depends on the place. Where the innovations are smaller
//! than stated, `ln det S` would favour the candidate whose contact has the smallest variance, whatever its residuals. In the
//! evidence, `S` is therefore multiplied by the running mean of the mixture's normalised innovations squared, if this is below 1.
//!
//! The object, and with it the right candidate, may change: transitions occur at a constant rate, into the candidates
//! in proportion to their priors. A rejected candidate can therefore recover within a small multiple of the number of
//! readings that reject the others.

use std::sync::Arc;

use filters::imm::{Modes, Transition};
use filters::{Gaussian, Innovation, product, robust};
use nalgebra::{Matrix1, Matrix2, Vector1, Vector2};
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};

use super::block::{BlockMean, BlockSettings, Blocks, Latecomers};
use super::gaussian::{KEPT_SHARE, ONSET_WAY_M};
use super::second::{Found, Second, SecondSettings};
use super::shares::{MOST_MODELS, ModelShares};
use super::systematic::SystematicSettings;
use super::touched::TouchedPlaces;
use super::{
    Ahead, ESTIMATORS, Estimate, EstimatorRow, FrictionCoefficient, Knowledge, Method, MethodClass, OutlinePoint,
    Radius, Sample, Touch, Tracker, Undetected, estimator,
};
use crate::candidates::{LEAST_KNOWN, check, refused, unknown};
use crate::doubt::{DoubtSettings, Doubtful};
use crate::elastica::Elastica;
use crate::frames::{Base, Point, Pose, Start};
use crate::sensor::CalibratedFace;
use crate::settings::{Settings, SettingsError, parse, with_defaults, within};

/// A method to average over.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Candidate {
    /// Name in the registry.
    pub name: String,
    /// Settings that differ from its default ones.
    #[serde(default, skip_serializing_if = "Map::is_empty")]
    pub settings: Map<String, Value>,
    /// Prior probability, relative to the others.
    pub weight: f64,
    /// Whether the candidate contributes to the covariance alone, unless the evidence for it is large.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub considered: bool,
}

impl Candidate {
    fn new(name: &str, weight: f64) -> Self {
        Self { name: name.into(), settings: Map::new(), weight, considered: false }
    }
}

/// Settings.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub(super) struct Config {
    /// The candidates. The prior odds favour the most restrictive ones, since a contact determines little at its start.
    pub candidates: Vec<Candidate>,
    /// Gate, in standard deviations: a larger innovation counts as evidence as if it lay at the gate, which bounds the
    /// influence of an outlier.
    pub gate_sds: f64,
    /// Power of the likelihoods by which candidates are weighted: below 1 if the errors of neighbouring readings depend on
    /// one another, as those of a wrong model do.
    pub evidence_power: f64,
    /// Power of the likelihoods of the considered candidates together and of the others together, by which the two groups
    /// are weighted.
    pub considered_power: f64,
    /// Power of the likelihoods by which the considered candidates together determine the mean.
    pub mean_power: f64,
    /// Logarithm of the likelihood ratio with this power at which half of the mean is theirs.
    pub mean_evidence: f64,
    /// Mean time between changes of the right candidate.
    pub sojourn_s: f64,
    /// Probability of a candidate below which it does not count for the estimate.
    pub ignored_share: f64,
    /// Largest distance outside of the calibrated domain at which an estimate is stated; up to there the distance is
    /// added to its standard deviation. Smoothed estimates are stated anywhere.
    pub farthest_m: f64,
    /// Signal that the models are in doubt.
    pub doubt: DoubtSettings,
    /// Signal that a second contact has taken load.
    pub second: SecondSettings,
    /// Blocks of samples of which the candidates take the mean.
    pub block: BlockSettings,
}

impl Default for Config {
    /// The more flexible a candidate, the smaller its prior: `ukf` assumes a thin object, `sliding` a constant radius of
    /// centimetres, `round` one of any size, `outline` only a convex object, `rubbing` also a contact with friction,
    /// `drifting` also an object that moves, whose velocity can explain errors of any other model; `installed` also doubts the
    /// calibration, with an even chance nearly, and is considered. Odds and powers were chosen on the training suite of random
    /// scenes and on the standard suite, those of `drifting` also on the suite `hollow`. Readings before a touch are averaged, so that
    /// its first step is short; the belief of an object is kept from touch to touch; all candidates correct the readings for
    /// inertia and leave out those at the tip: a candidate that used them would state a wrong contact there.
    fn default() -> Self {
        let mut average = Self::among([
            ("ukf", 20.0),
            ("round", 10.0),
            ("sliding", 3.0),
            ("outline", 10.0),
            ("rubbing", 0.01),
            ("drifting", 0.01),
        ]);
        for candidate in
            average.candidates.iter_mut().filter(|candidate| ["ukf", "sliding"].contains(&candidate.name.as_str()))
        {
            candidate.settings.insert("onset_way_m".into(), ONSET_WAY_M.into());
            candidate.settings.insert("kept_share".into(), KEPT_SHARE.into());
            candidate.settings.insert("corrected".into(), true.into());
        }
        let systematic = super::to_json(&SystematicSettings::EXPECTED);
        for candidate in average
            .candidates
            .iter_mut()
            .filter(|candidate| ["ukf", "round", "sliding"].contains(&candidate.name.as_str()))
        {
            candidate.settings.insert("systematic".into(), systematic.clone());
        }
        average.candidates.push(Candidate { considered: true, ..Candidate::new("installed", 30.0) });
        Self {
            ignored_share: 0.02,
            evidence_power: 0.5,
            considered_power: 0.01,
            second: SecondSettings::default(),
            ..average
        }
    }
}

impl Config {
    /// Average of the methods that smooth over the whole contact, with odds chosen in the same way. An outline of free
    /// curvature is used only where a constant radius is refuted.
    pub(super) fn hindsight() -> Self {
        let among = Self::among([("batch", 300.0), ("batch-sliding", 1.0), ("outline-batch", 0.001)]);
        Self { block: BlockSettings::single(), ..among }
    }

    fn among<const COUNT: usize>(candidates: [(&str, f64); COUNT]) -> Self {
        let candidates = candidates.map(|(name, weight)| Candidate::new(name, weight));
        Self {
            candidates: candidates.into(),
            gate_sds: 5.0,
            evidence_power: 1.0,
            considered_power: 1.0,
            mean_power: 0.3,
            mean_evidence: 4.0,
            sojourn_s: 1000.0,
            ignored_share: 0.0,
            farthest_m: 2e-3,
            doubt: DoubtSettings::default(),
            second: SecondSettings::NONE,
            block: BlockSettings::default(),
        }
    }
}

impl Settings for Config {
    fn validate(&self) -> Result<(), SettingsError> {
        let weighted = self.candidates.iter().map(|candidate| (candidate.name.as_str(), candidate.weight));
        check(&weighted.collect::<Vec<_>>(), MOST_MODELS)?;
        within("gate_sds", self.gate_sds, 1.0..=1e6)?;
        within("evidence_power", self.evidence_power, 1e-3..=1.0)?;
        within("considered_power", self.considered_power, 1e-6..=1.0)?;
        within("mean_power", self.mean_power, 1e-6..=1.0)?;
        within("mean_evidence", self.mean_evidence, 0.0..=1e3)?;
        self.doubt.validate()?;
        self.second.validate()?;
        self.block.validate()?;
        within("sojourn_s", self.sojourn_s, 1e-3..=1e9)?;
        within("ignored_share", self.ignored_share, 0.0..=0.5)?;
        within("farthest_m", self.farthest_m, 0.0..=1.0)
    }
}

/// The registry's row of a candidate, which must not average itself and must smooth if and only if `looks_back`.
fn row_of(name: &str, looks_back: bool) -> Result<&'static EstimatorRow, SettingsError> {
    let row = estimator(name).ok_or_else(|| unknown(name, ESTIMATORS.iter().map(|row| row.name)))?;
    if (row.defaults)().get("candidates").is_some() {
        return Err(refused(name, "a model average itself, expected a single method"));
    }
    if row.sensor_model.is_some() {
        return Err(refused(name, "bound to its own sensor model, expected a method that uses the calibration's"));
    }
    match (row.class == MethodClass::Hindsight, looks_back) {
        (true, false) => Err(refused(name, "a hindsight method, expected a recursive one")),
        (false, true) => Err(refused(name, "a recursive method, expected a hindsight one")),
        _ => Ok(row),
    }
}

/// Averages methods whose estimates depend on the samples so far.
pub(super) fn build_recursive(config: &Value, knowledge: &Arc<Knowledge>) -> Result<Box<dyn Method>, SettingsError> {
    build(parse(config)?, knowledge, false)
}

/// Averages methods that smooth over the whole contact.
pub(super) fn build_hindsight(config: &Value, knowledge: &Arc<Knowledge>) -> Result<Box<dyn Method>, SettingsError> {
    // Settings that are not given are those of hindsight.
    let config = match config.as_object() {
        Some(own) => parse::<Config>(&with_defaults(own, super::to_json(&Config::hindsight())))?,
        None => parse(config)?,
    };
    // Revised estimates are those of single samples.
    within("block.samples", f64::from(config.block.samples), 1.0..=1.0)?;
    build(config, knowledge, true)
}

fn build(config: Config, knowledge: &Arc<Knowledge>, looks_back: bool) -> Result<Box<dyn Method>, SettingsError> {
    let candidate = |candidate: &Candidate| {
        let row = row_of(&candidate.name, looks_back)?;
        let settings = with_defaults(&candidate.settings, (row.defaults)());
        Ok((row.name, (row.build)(&settings, knowledge)?))
    };
    let methods = config.candidates.iter().map(candidate).collect::<Result<_, SettingsError>>()?;
    let noise_n2_m2 = knowledge.noise_sd_n_m.powi(2);
    let elastica = Elastica::new(&knowledge.whisker).ok().map(Arc::new);
    Ok(Box::new(ModelAveraging { config: Arc::new(config), methods, noise_n2_m2, elastica }))
}

/// Smallest factor of the innovation covariances in the evidence, so that after nearly exact readings one of ordinary size does not
/// decide between candidates.
const LEAST_FACTOR: f64 = 0.05;

/// Smallest probability, relative to that of the leading candidate, at which a candidate's outline is used. Where `ignored_share` is
/// smaller, it takes its place.
const CARRYING_SHARE: f64 = 1e-6;

/// Probability of a moving object, without the considered candidates, above which the models of objects at rest are in doubt. A contact
/// that jumps from corner to corner of an object at rest makes a moving object probable for an instant. Chosen on training suites.
const MOVING_SHARE: f64 = 1.0 - 1e-6;

/// Probability of a moving object at or below which this doubt ends.
const NO_LONGER_MOVING_SHARE: f64 = 0.9;

/// Probability of a moving object above which candidates for an object at rest discard their posterior at a new touch.
const LIKELY_MOVING_SHARE: f64 = 0.5;

/// Probability of a moving object above which the places that were touched may have moved too.
const MAY_MOVE_SHARE: f64 = 0.1;

/// Probability of friction above which a change of the readings is no evidence of a second contact: friction changes them as the motion
/// reverses.
const LIKELY_RUBBING_SHARE: f64 = 0.5;

/// Names and methods of the candidates.
type Methods = Arc<[(&'static str, Box<dyn Method>)]>;

struct ModelAveraging {
    config: Arc<Config>,
    methods: Methods,
    noise_n2_m2: f64,
    /// `None` if the parameters of the whisker are not valid.
    elastica: Option<Arc<Elastica>>,
}

impl Method for ModelAveraging {
    fn begin(&self, touch: &Touch<'_>) -> Box<dyn Tracker> {
        let weights: Vec<f64> = self.config.candidates.iter().map(|candidate| candidate.weight).collect();
        Box::new(AveragingTracker {
            config: self.config.clone(),
            considered: self.config.candidates.iter().map(|candidate| candidate.considered).collect(),
            face: touch.face.clone(),
            noise_n2_m2: self.noise_n2_m2,
            methods: self.methods.clone(),
            trackers: self.methods.iter().map(|(_, method)| method.begin(touch)).collect(),
            right: Modes::new(weights.iter().copied()),
            doubtful: Doubtful::default(),
            signals_motion: false,
            second: Second::default(),
            touched: TouchedPlaces::new(self.elastica.clone(), touch.face.face),
            has_returned: false,
            base: touch.before,
            last: None,
            blocks: Blocks::new(touch.before, touch.face.rest.length_m()),
            has_begun: false,
            late: None,
            stated: None,
            continues: false,
            weights,
        })
    }
}

/// A candidate's estimate in the mixture.
#[derive(Clone, Copy)]
struct Part<'a> {
    estimate: &'a Estimate,
    share: f64,
    considered: bool,
}

/// Whether the signal that the object moves is raised at the probability `share` of a moving object. The threshold is lower if it was
/// raised before.
fn signals_motion(was_raised: bool, share: f64) -> bool {
    share > if was_raised { NO_LONGER_MOVING_SHARE } else { MOVING_SHARE }
}

/// The candidates on one contact.
struct AveragingTracker {
    config: Arc<Config>,
    considered: Vec<bool>,
    face: Arc<CalibratedFace>,
    /// Variance of the noise of a reading.
    noise_n2_m2: f64,
    weights: Vec<f64>,
    methods: Methods,
    trackers: Vec<Box<dyn Tracker>>,
    /// Probabilities of the candidates.
    right: Modes,
    doubtful: Doubtful,
    /// Whether the signal that the object moves is raised.
    signals_motion: bool,
    second: Second,
    touched: TouchedPlaces,
    /// Whether the whisker bears on a place that was touched before.
    has_returned: bool,
    base: Pose<Base, Start>,
    /// The last stated contact and its covariance (m2).
    last: Option<(Point<Start>, Matrix2<f64>)>,
    blocks: Blocks,
    /// Whether the candidates have taken the first sample of the touch.
    has_begun: bool,
    /// At the onset of a touch, the candidates that are improbable.
    late: Option<Latecomers>,
    /// Estimate at the mean of the last block.
    stated: Option<Estimate>,
    /// Whether the readings show a contact with the object of the last touch while none is detected.
    continues: bool,
}

impl AveragingTracker {
    fn names(&self) -> impl Iterator<Item = &'static str> {
        self.methods.iter().map(|(name, _)| *name)
    }

    /// Logarithm of the likelihood of a candidate's innovation, bounded by the gate. Its covariance is multiplied by the running
    /// mean of the mixture's normalised innovations squared, if that is below 1.
    fn log_evidence(&self, innovation: &Innovation<1>) -> f64 {
        robust::log_likelihood(&innovation.scaled(self.noise_factor()), self.config.gate_sds)
    }

    /// Factor of the covariances of innovations in the evidence.
    fn noise_factor(&self) -> f64 {
        self.doubtful.mean_nis().clamp(LEAST_FACTOR, 1.0)
    }

    /// The evidence with its powers: within the group of a candidate, considered or not, and that of the group as a whole.
    fn tempered(&self, evidence: &[Option<f64>]) -> Vec<Option<f64>> {
        let largest = evidence.iter().flatten().copied().fold(f64::NEG_INFINITY, f64::max);
        // Logarithm of the mean likelihood of a group with a power.
        let of_group = |considered: bool, power: f64| {
            let members = || self.considered.iter().zip(self.right.probabilities().iter().zip(evidence));
            let (mut share, mut likelihood) = (0.0, 0.0);
            for (_, (probability, log)) in members().filter(|(is_considered, _)| **is_considered == considered) {
                let Some(log) = log else { continue };
                share += probability;
                likelihood += probability * (power * (log - largest)).exp();
            }
            if likelihood > 0.0 { (likelihood / share).ln() } else { 0.0 }
        };
        let of_groups = [false, true].map(|considered| {
            self.config.considered_power * of_group(considered, 1.0) - of_group(considered, self.config.evidence_power)
        });
        let of_candidate = |(log, considered): (&Option<f64>, &bool)| {
            Some(self.config.evidence_power * ((*log)? - largest) + of_groups[usize::from(*considered)])
        };
        evidence.iter().zip(&self.considered).map(of_candidate).collect()
    }

    /// Evidence of all candidates. One without has the mean likelihood of the others, weighted by their probabilities, so that its
    /// own probability does not change.
    fn completed(&self, evidence: &[Option<f64>]) -> Vec<Option<f64>> {
        let mean = self.mean_evidence(evidence);
        evidence.iter().map(|log| Some(log.unwrap_or(mean))).collect()
    }

    /// Logarithm of the mean likelihood of the candidates that have one, weighted by their probabilities.
    fn mean_evidence(&self, evidence: &[Option<f64>]) -> f64 {
        let known =
            || evidence.iter().zip(self.right.probabilities()).filter_map(|(log, share)| Some(((*log)?, *share)));
        let largest = known().map(|(log, _)| log).fold(f64::NEG_INFINITY, f64::max);
        let (likelihood, total) = known().fold((0.0, 0.0), |(likelihood, total), (log, share)| {
            (likelihood + share * (log - largest).exp(), total + share)
        });
        if likelihood > 0.0 { largest + (likelihood / total).ln() } else { largest }
    }

    /// Updates the candidates' probabilities and returns the innovation of the mixture.
    fn weigh(&mut self, sample: &Sample, count: f64, estimates: &[Option<Estimate>]) -> Option<Innovation<1>> {
        let sojourns_s = vec![self.config.sojourn_s; self.methods.len()];
        self.right.predict(&Transition::from_sojourns(sample.dt_s, &sojourns_s, &self.weights));
        let innovations: Vec<_> = estimates.iter().map(|estimate| estimate.as_ref()?.innovation).collect();
        let known = innovations.iter().zip(self.right.probabilities());
        let innovation = Innovation::of_mixture(known.filter_map(|(found, share)| Some(((*found)?, *share))))?;
        let mut evidence: Vec<_> = innovations.iter().map(|found| Some(self.log_evidence(found.as_ref()?))).collect();
        if !self.shows_motion(estimates) {
            let of_moving = evidence.iter_mut().zip(&self.trackers).filter(|(_, tracker)| tracker.assumes_motion());
            of_moving.for_each(|(evidence, _)| *evidence = None);
        }
        let evidence = self.discounted(&self.tempered(&evidence), count);
        self.right.reweight(&self.completed(&evidence))?;
        Some(innovation)
    }

    /// The evidence with that of moving objects, relative to the mean of all, multiplied by the noise's share of the variance of
    /// the mean of `count` readings. The rest is the sensor model's error. It recurs at the same place and varies slowly along the
    /// whisker, as the effect of a motion does, so that many readings with it count as one.
    fn discounted(&self, evidence: &[Option<f64>], count: f64) -> Vec<Option<f64>> {
        let Some(contact) = self.stated.map(|stated| stated.contact) else { return evidence.to_vec() };
        let noise_n2_m2 = self.noise_n2_m2 / count;
        let share = noise_n2_m2 / (noise_n2_m2 + self.face.model_variance_n2_m2(contact));
        let mean = self.mean_evidence(evidence);
        let discounted = evidence.iter().zip(&self.trackers).map(|(log, tracker)| {
            let log = (*log)?;
            Some(if tracker.assumes_motion() { mean + share * (log - mean) } else { log })
        });
        discounted.collect()
    }

    /// Whether readings can tell a moving object from one at rest: whether the more probable candidates at rest have their contacts
    /// in the calibrated domain. Where a tip slides over an object, the reading may be constant, as if the object moved along.
    fn shows_motion(&self, estimates: &[Option<Estimate>]) -> bool {
        let known = self.trackers.iter().zip(&self.considered).zip(self.right.probabilities()).zip(estimates);
        let (mut calibrated, mut total) = (0.0, 0.0);
        for (((tracker, considered), share), estimate) in known {
            if !considered && !tracker.assumes_motion() {
                calibrated += if estimate.is_some_and(|estimate| estimate.calibrated) { *share } else { 0.0 };
                total += share;
            }
        }
        2.0 * calibrated >= total
    }

    /// The estimate with systematic errors in its covariance: the mean over the candidates that follow them and have an estimate.
    fn with_systematic(&self, estimate: Estimate, estimates: &[Option<Estimate>]) -> Estimate {
        let known = self.trackers.iter().zip(self.right.probabilities()).zip(estimates);
        let (total, sum_m2) = known
            .filter(|(_, estimate)| estimate.is_some())
            .filter_map(|((tracker, share), _)| Some((share, tracker.systematic_m2()? * *share)))
            .fold((0.0, Matrix2::zeros()), |(total, sum_m2), (share, added_m2)| (total + share, sum_m2 + added_m2));
        let added_m2 = if total > 0.0 { sum_m2 / total } else { Matrix2::zeros() };
        Estimate { covariance_m2: estimate.covariance_m2.map(|covariance_m2| covariance_m2 + added_m2), ..estimate }
    }

    /// The estimate with the distance from the calibrated domain in its covariance. `None` if it is too far away.
    fn near_the_domain(&self, estimate: Estimate) -> Option<Estimate> {
        let outside_m = self.face.nearest_calibrated(estimate.contact).distance(&estimate.contact);
        let added_m2 = Matrix2::identity() * outside_m.powi(2);
        let covariance_m2 = estimate.covariance_m2.map(|covariance| covariance + added_m2);
        (outside_m <= self.config.farthest_m).then_some(Estimate { covariance_m2, ..estimate })
    }

    /// Weight of the considered candidates together in the mean: with the log-likelihood ratio `L` of them to the others, the logistic
    /// function of `mean_power L - mean_evidence`.
    fn lead_of_considered(&self) -> f64 {
        let sum = |values: &[f64], of: bool| -> f64 {
            values.iter().zip(&self.considered).filter(|(_, is)| **is == of).map(|(value, _)| value).sum()
        };
        let [now, prior] = [self.right.probabilities(), self.weights.as_slice()]
            .map(|shares| sum(shares, true).ln() - sum(shares, false).ln());
        let evidence = (now - prior) / self.config.considered_power;
        let lead = 1.0 / (1.0 + (self.config.mean_evidence - self.config.mean_power * evidence).exp());
        if lead < self.config.ignored_share { 0.0 } else { lead }
    }

    /// Weights of the candidates in the mean; their sum is one.
    fn leads(&self, parts: &[Part<'_>]) -> Vec<f64> {
        let total = |of: bool| parts.iter().filter(|part| part.considered == of).map(|part| part.share).sum::<f64>();
        let [others, considered] = [false, true].map(total);
        let lead = match (others > 0.0, considered > 0.0) {
            (true, true) => self.lead_of_considered(),
            (false, _) => 1.0,
            (true, false) => 0.0,
        };
        let weight = |part: &Part<'_>| {
            if part.considered { lead * part.share / considered } else { (1.0 - lead) * part.share / others }
        };
        parts.iter().map(weight).collect()
    }

    /// Weights of the candidates in the covariance. What the mean leaves out because of the evidence is no uncertainty either.
    fn spreads(parts: &[Part<'_>], leads: &[f64]) -> Vec<f64> {
        let known: f64 = parts.iter().map(|part| part.share).sum();
        let considered: f64 = parts.iter().filter(|part| part.considered).map(|part| part.share).sum();
        let lead: f64 = parts.iter().zip(leads).filter(|(part, _)| part.considered).map(|(_, lead)| lead).sum();
        let spread = |part: &Part<'_>| {
            if part.considered {
                part.share / considered * lead.max(considered / known)
            } else {
                part.share / (known - considered) * (1.0 - lead).min(1.0 - considered / known)
            }
        };
        parts.iter().map(spread).collect()
    }

    /// Estimate of the mixture. `None` if no candidate has an estimate.
    fn together<'a>(&self, estimates: &'a [Option<Estimate>], innovation: Option<Innovation<1>>) -> Option<Estimate> {
        let shares = self.right.probabilities();
        let stated = estimates.iter().zip(shares).zip(&self.considered);
        let part = |((estimate, share), considered): ((&'a Option<Estimate>, &f64), &bool)| {
            Some(Part { estimate: estimate.as_ref()?, share: *share, considered: *considered })
        };
        let parts: Vec<Part<'_>> = stated.filter_map(part).collect();
        let most = parts.iter().map(|part| part.share).fold(0.0, f64::max);
        let parts: Vec<_> = parts.into_iter().filter(|part| part.share >= self.config.ignored_share * most).collect();
        let known: f64 = parts.iter().map(|part| part.share).sum();
        // The more probable candidates may have none because the contact is at the tip.
        if known < LEAST_KNOWN * self.present_share() {
            return None;
        }
        let leads = self.leads(&parts);
        let moving = || parts.iter().zip(&leads).map(|(part, lead)| (part, *lead)).filter(|(_, lead)| *lead > 0.0);
        let leading = moving().max_by(|a, b| a.1.total_cmp(&b.1))?.0.estimate;
        // Relative to the leading candidate's contact, so that no digits are lost to rounding if its probability is nearly
        // one.
        let offset = |part: &Part<'_>| part.estimate.contact.vector() - leading.contact.vector();
        let shift = moving().map(|(part, lead)| offset(part) * lead).sum::<Vector2<f64>>();
        let spreads = Self::spreads(&parts, &leads);
        let place = |(part, spread): (&Part<'_>, &f64)| {
            Some((Gaussian::new(offset(part), part.estimate.covariance_m2?), *spread))
        };
        let size = |(part, lead): (&Part<'_>, f64)| {
            let Radius { radius_m, sd_m } = part.estimate.radius?;
            Some((Gaussian::new(Vector1::new(radius_m), Matrix1::new(sd_m * sd_m)), lead))
        };
        let rubs = |(part, lead): (&Part<'_>, f64)| {
            let FrictionCoefficient { coefficient, sd } = part.estimate.friction?;
            Some((Gaussian::new(Vector1::new(coefficient), Matrix1::new(sd * sd)), lead))
        };
        let places: Option<Vec<_>> =
            parts.iter().zip(&spreads).filter(|(_, spread)| **spread > 0.0).map(place).collect();
        // The candidate for thin objects states no radius. If others state one, the radius is the mean over those that do.
        let size = Gaussian::of_mixture(moving().filter_map(size));
        // Likewise, the candidates without friction state no coefficient.
        let friction = Gaussian::of_mixture(moving().filter_map(rubs));
        let about_shift = |places: Gaussian<2>| {
            let apart = places.mean - shift;
            places.covariance + apart * apart.transpose()
        };
        let covariance_m2 = places.and_then(Gaussian::of_mixture).map(about_shift);
        Some(Estimate {
            contact: leading.contact.shifted(shift),
            covariance_m2,
            radius: size.map(|size| Radius { radius_m: size.mean[0], sd_m: size.covariance[0].sqrt() }),
            friction: friction.map(|friction| FrictionCoefficient {
                coefficient: friction.mean[0],
                sd: friction.covariance[0].sqrt(),
            }),
            innovation,
            models: Some(ModelShares::new(self.names().zip(shares.iter().copied()))),
            model_doubtful: false,
            second_contact: false,
            ..*leading
        })
    }
}

impl AveragingTracker {
    /// Probability of a moving object, without the considered candidates.
    fn moving_share(&self) -> f64 {
        self.deciding_share(|tracker| tracker.assumes_motion())
    }

    /// Probability of friction, without the considered candidates.
    fn rubbing_share(&self) -> f64 {
        self.deciding_share(|tracker| tracker.assumes_friction())
    }

    /// Probability of the candidates that this is true of, without the considered ones.
    fn deciding_share(&self, is_true: impl Fn(&dyn Tracker) -> bool) -> f64 {
        let candidates = self.trackers.iter().zip(self.right.probabilities()).zip(&self.considered);
        let deciding = || candidates.clone().filter(|(_, considered)| !**considered).map(|(candidate, _)| candidate);
        let total: f64 = deciding().map(|(_, share)| share).sum();
        let known: f64 = deciding().filter(|(tracker, _)| is_true(tracker.as_ref())).map(|(_, share)| share).sum();
        if total > 0.0 { known / total } else { 0.0 }
    }

    /// The candidates with their probabilities, the most probable first.
    fn ranked(&self) -> Vec<(f64, &dyn Tracker)> {
        let trackers = self.trackers.iter().map(|tracker| tracker.as_ref());
        let mut ranked: Vec<_> = self.right.probabilities().iter().copied().zip(trackers).collect();
        ranked.sort_by(|a, b| b.0.total_cmp(&a.0));
        ranked
    }

    /// Begins a new touch at the present sample: the contact may be the last one or another, anywhere along the whisker.
    fn begin_again(&mut self) {
        let face = self.face.clone();
        self.begin_again_with(&Touch {
            face: &face,
            history: &[],
            free_s: 0.0,
            before: self.base,
            contact_prior: None,
            seed: 0,
        });
        self.blocks.alert(&self.config.block);
        (self.has_begun, self.late) = (false, None);
    }

    /// Begins a new touch. A candidate restarts from its prior if it keeps no posterior of the object, or if it assumes an object at rest
    /// and the object probably moves.
    fn begin_again_with(&mut self, touch: &Touch<'_>) {
        let moves = self.moving_share() > LIKELY_MOVING_SHARE;
        for (tracker, (_, method)) in self.trackers.iter_mut().zip(&*self.methods) {
            let may_resume = tracker.assumes_motion() || !moves;
            if !(may_resume && tracker.resume(touch)) {
                *tracker = method.begin(touch);
            }
        }
    }

    /// Points of an outline with the last stated variance across it, at the point nearest to the contact, in their covariances.
    fn widened(&self, points: Vec<OutlinePoint>) -> Vec<OutlinePoint> {
        let Some((contact, covariance_m2)) = self.last else { return points };
        let distance_m = |point: &OutlinePoint| point.surface.distance(&contact);
        let nearest = points.iter().min_by(|a, b| distance_m(a).total_cmp(&distance_m(b)));
        let across_m2 = nearest.map_or(0.0, |point| point.normal.dot(&product(&covariance_m2, &point.normal)));
        let widen = |point: OutlinePoint| OutlinePoint {
            covariance_m2: point.covariance_m2 + point.normal * point.normal.transpose() * across_m2,
            ..point
        };
        points.into_iter().map(widen).collect()
    }
}

impl AveragingTracker {
    /// Predicts a sample, with the motion and the time from the last block's mean to it, by the leading candidate.
    fn look_ahead(&self, since: &Sample) -> Ahead {
        let candidates = self.right.probabilities().iter().zip(&self.considered).zip(&self.trackers);
        let leading = candidates.filter(|((_, considered), _)| !**considered);
        leading
            .max_by(|((a, _), _), ((b, _), _)| a.total_cmp(b))
            .map_or_else(Ahead::default, |(_, tracker)| tracker.look_ahead(since))
    }

    /// The estimate of the last block's mean, carried along by the motion of the base to a sample: the contact rests but for its slip
    /// over the object.
    fn carried(&self, since: &Sample, slip_m: Vector2<f64>) -> Option<Estimate> {
        let stated = self.stated?;
        Some(Estimate {
            contact: since.motion.apply(stated.contact).shifted(slip_m),
            covariance_m2: stated.covariance_m2.map(|covariance_m2| since.motion.turn(covariance_m2)),
            ..stated
        })
    }

    /// Takes a block of samples.
    fn take(&mut self, block: &BlockMean) {
        let now = std::mem::replace(&mut self.base, block.base);
        self.stated = self.step_mean_of(&block.sample, block.count);
        self.base = now;
        let nis = self.stated.and_then(|stated| stated.innovation).map(|innovation| innovation.nis);
        if nis.is_some_and(|nis| nis > self.config.block.alert_nis) {
            self.blocks.alert(&self.config.block);
        }
    }

    /// The innovations of the mean of `count` readings, for the test for a second contact at the estimate of the mixture.
    fn found(&self, count: f64, estimates: &[Option<Estimate>], together: &Estimate) -> Option<Found> {
        let known = self.trackers.iter().zip(self.right.probabilities()).zip(estimates);
        let of_moving = known.filter(|((tracker, _), _)| tracker.assumes_motion());
        let of_moving = of_moving.filter_map(|((_, share), estimate)| Some((estimate.as_ref()?.innovation?, *share)));
        Some(Found {
            mixture: together.innovation?,
            moving: Innovation::of_mixture(of_moving),
            count,
            variance_n2_m2: self.noise_n2_m2 / count + self.face.model_variance_n2_m2(together.contact),
        })
    }

    /// Whether a change of the readings at this estimate is evidence of a second contact: whether the contact is known, and neither a
    /// moving object nor friction is probable.
    fn is_known(&self, sd_m: f64) -> bool {
        sd_m <= self.config.second.known_m
            && self.moving_share() <= MAY_MOVE_SHARE
            && self.rubbing_share() <= LIKELY_RUBBING_SHARE
    }

    /// A place that was touched before and on which the whisker with this contact bears.
    fn returned(&mut self, dt_s: f64, estimate: Option<(Point<Base>, f64)>) -> Option<Point<Base>> {
        let settings = Some(self.config.second).filter(|settings| settings.past_m > 0.0)?;
        let Some((contact, sd_m)) = estimate else {
            self.touched.interrupt();
            return None;
        };
        if self.moving_share() > MAY_MOVE_SHARE {
            self.touched.forget();
        } else if self.second.is_raised() {
            self.touched.forget_latest();
        }
        let (past_m, place) = self.touched.advance(dt_s, &self.base, contact, sd_m)?;
        self.second.bears(&settings, past_m).then_some(place)
    }

    /// Advances the tests for a second contact. Returns whether the innovations raise the signal.
    fn seek_second(
        &mut self,
        dt_s: f64,
        count: f64,
        estimates: &[Option<Estimate>],
        together: Option<&Estimate>,
    ) -> bool {
        let largest_sd_m = |covariance_m2: Matrix2<f64>| covariance_m2.symmetric_eigenvalues().max().sqrt();
        let known = together.and_then(|estimate| Some((estimate.contact, estimate.covariance_m2.map(largest_sd_m)?)));
        let known = known.filter(|(_, sd_m)| sd_m.is_finite());
        let found = together.and_then(|together| self.found(count, estimates, together));
        let is_known = known.is_some_and(|(_, sd_m)| self.is_known(sd_m));
        let is_second = self.second.advance(&self.config.second, dt_s, found, is_known);
        let place = self.returned(dt_s, known);
        let had_returned = std::mem::replace(&mut self.has_returned, place.is_some());
        if let Some(place) = place {
            if self.rubbing_share() <= LIKELY_RUBBING_SHARE {
                self.second.raise(&self.config.second);
            }
            if !had_returned {
                self.trackers.iter_mut().for_each(|tracker| tracker.expect_return(place));
            }
        }
        is_second
    }

    /// Whether each candidate's probability is too small to count for the mean.
    fn improbable(&self) -> Vec<bool> {
        let shares = self.right.probabilities();
        let most = shares.iter().copied().fold(0.0, f64::max);
        let leads = self.considered.contains(&true) && self.lead_of_considered() > 0.0;
        let is_improbable = |(share, considered): (&f64, &bool)| {
            if *considered { !leads } else { *share < self.config.ignored_share * most }
        };
        shares.iter().zip(&self.considered).map(is_improbable).collect()
    }

    /// Probability of the candidates that are not late.
    fn present_share(&self) -> f64 {
        let is_late = |candidate: usize| self.late.as_ref().is_some_and(|late| late.contain(candidate));
        self.right.probabilities().iter().enumerate().filter(|(i, _)| !is_late(*i)).map(|(_, share)| share).sum()
    }

    /// The candidates that are late at the onset of a touch: those that are improbable, those that do as another one does, and those
    /// that are considered, to which the covariance of a contact that is hardly known yet owes little.
    fn latecomers(&self) -> Option<Latecomers> {
        let settings = &self.config.block;
        let does_as_another =
            |tracker: &dyn Tracker| tracker.follows_as().is_some_and(|other| self.names().any(|name| name == other));
        let candidates = self.improbable().into_iter().zip(&self.trackers);
        let is_late: Vec<_> =
            candidates.map(|(improbable, tracker)| improbable || does_as_another(&**tracker)).collect();
        let has_any = settings.samples > 1 && is_late.contains(&true) && is_late.contains(&false);
        has_any.then(|| Latecomers::new(is_late, settings, self.base, self.face.rest.length_m()))
    }

    /// The candidates' estimates after a sample that is the mean of `count`. `None` also for those that are late.
    fn estimates(&mut self, sample: &Sample, count: f64) -> Vec<Option<Estimate>> {
        if !std::mem::replace(&mut self.has_begun, true) {
            let estimates = self.trackers.iter_mut().map(|tracker| tracker.step_mean(sample, count)).collect();
            self.late = self.latecomers();
            return estimates;
        }
        let Some(mut late) = self.late.take() else {
            return self.trackers.iter_mut().map(|tracker| tracker.step_mean(sample, count)).collect();
        };
        let is_onset = late.wait(count);
        let (block, after) = if is_onset {
            (late.take(&self.base, sample), None)
        } else {
            let (rest, after) = late.end(&self.base, sample);
            (rest, Some(after))
        };
        let advance = |(candidate, tracker): (usize, &mut Box<dyn Tracker>)| {
            if !late.contain(candidate) {
                return tracker.step_mean(sample, count);
            }
            if let Some(block) = &block {
                tracker.step_mean(&block.sample, block.count);
            }
            tracker.step_mean(&after?, count)
        };
        let estimates = self.trackers.iter_mut().enumerate().map(advance).collect();
        self.late = Some(late).filter(|_| is_onset);
        estimates
    }

    /// Takes the mean of `count` samples, with the base at the mean pose.
    fn step_mean_of(&mut self, sample: &Sample, count: f64) -> Option<Estimate> {
        let estimates = self.estimates(sample, count);
        let jumps = self.trackers.iter().any(|tracker| tracker.refutes_convexity());
        self.trackers.iter_mut().for_each(|tracker| tracker.expect_jumps(jumps));
        let innovation = self.weigh(sample, count, &estimates);
        self.doubtful.advance(&self.config.doubt, sample.dt_s, innovation);
        if innovation.is_some() && self.shows_motion(&estimates) {
            self.signals_motion = signals_motion(self.signals_motion, self.moving_share());
        }
        let model_doubtful = self.doubtful.is_raised() || self.signals_motion;
        let together = self.together(&estimates, innovation).map(|estimate| self.with_systematic(estimate, &estimates));
        let is_second = self.seek_second(sample.dt_s, count, &estimates, together.as_ref());
        let second_contact = self.second.is_raised();
        if is_second && self.config.second.begins_touch {
            self.begin_again();
        }
        let stated = self.near_the_domain(Estimate { model_doubtful, second_contact, ..together? })?;
        let in_start = |covariance_m2| (self.base.apply(stated.contact), self.base.turn(covariance_m2));
        self.last = stated.covariance_m2.map(in_start).or(self.last);
        Some(stated)
    }
}

impl Tracker for AveragingTracker {
    fn step(&mut self, sample: &Sample) -> Option<Estimate> {
        self.base = sample.motion.inverse().then(&self.base);
        let settings = self.config.block;
        if settings.samples == 1 {
            self.stated = self.step_mean_of(sample, 1.0);
            return self.stated;
        }
        let mut since = self.blocks.since_mean(&self.base, sample);
        let mut ahead = if self.blocks.is_calm(sample) { self.look_ahead(&since) } else { Ahead::default() };
        if ahead.nis.is_some_and(|nis| nis > settings.sample_nis) {
            // The samples collected so far belong to the contact before the jump.
            if let Some(block) = self.blocks.end() {
                self.take(&block);
                since = self.blocks.since_mean(&self.base, sample);
                ahead = self.look_ahead(&since);
            }
            self.blocks.alert(&settings);
        }
        let Some(block) = self.blocks.take(&settings, &self.base, sample) else {
            self.trackers.iter_mut().for_each(|tracker| tracker.work());
            // The innovation is that of the block.
            return self.carried(&since, ahead.slip_m).map(|estimate| Estimate { innovation: None, ..estimate });
        };
        self.take(&block);
        if block.count == 1.0 {
            return self.stated;
        }
        let since = self.blocks.since_mean(&self.base, &Sample { dt_s: 0.0, ..*sample });
        self.carried(&since, self.look_ahead(&since).slip_m)
    }

    /// All readings together determine the candidates' probabilities, so those at the end apply to every instant.
    fn hindsight(&mut self) -> Option<Vec<Option<Estimate>>> {
        let revised: Vec<_> = self.trackers.iter_mut().map(|tracker| tracker.hindsight()).collect();
        let count = revised.iter().flatten().map(Vec::len).min()?;
        let at = |i: usize| revised.iter().map(|smoothed| smoothed.as_ref()?[i]).collect::<Vec<_>>();
        Some((0..count).map(|i| self.together(&at(i), None)).collect())
    }

    /// None if the object probably moves.
    fn expect_touch(&mut self, undetected: &Undetected) -> Option<Estimate> {
        // The candidates have not taken the samples of a block that has not ended.
        let undetected = Undetected { free_s: undetected.free_s + self.blocks.pending_s(), ..*undetected };
        let estimates: Vec<_> = self.trackers.iter_mut().map(|tracker| tracker.expect_touch(&undetected)).collect();
        self.continues = false;
        if self.moving_share() > LIKELY_MOVING_SHARE {
            return None;
        }
        let together = self.together(&estimates, None).map(|estimate| self.with_systematic(estimate, &estimates));
        self.continues = together.is_some();
        self.near_the_domain(together?)
    }

    /// The object may be the last one or another with equal probability: the candidates' probabilities are the mean of those at
    /// the release and the priors. If the readings showed the last one before the touch was detected, they remain those at the release.
    fn resume(&mut self, touch: &Touch<'_>) -> bool {
        // The candidates have not taken the samples of a block that has not ended.
        let touch = &Touch { free_s: touch.free_s + self.blocks.pending_s(), ..*touch };
        self.face = touch.face.clone();
        self.base = touch.before;
        self.blocks = Blocks::new(touch.before, touch.face.rest.length_m());
        (self.has_begun, self.late) = (false, None);
        self.stated = None;
        self.second.resume();
        self.touched.resume(touch.face.face);
        self.has_returned = false;
        self.doubtful.resume();
        self.signals_motion = false;
        self.begin_again_with(touch);
        if std::mem::take(&mut self.continues) {
            return true;
        }
        let total: f64 = self.weights.iter().sum();
        let halves = self.right.probabilities().iter().zip(&self.weights).map(|(share, weight)| share + weight / total);
        self.right = Modes::new(halves.collect::<Vec<_>>());
        true
    }

    /// Outline of the leading candidate or, if it has none, of the most probable candidate that has one and whose relative probability
    /// is at least [`CARRYING_SHARE`]. The band of an outline that does not lead contains the variance of the mixture across it.
    fn outline(&self) -> Option<Vec<OutlinePoint>> {
        let ranked = self.ranked();
        let most = ranked.first()?.0;
        let least = most * self.config.ignored_share.min(CARRYING_SHARE);
        let counting = ranked.iter().filter(|(share, _)| *share >= least);
        let points = counting.into_iter().find_map(|(_, tracker)| tracker.outline())?;
        Some(if self.outline_leads() { points } else { self.widened(points) })
    }

    /// A refuted outline does not lead: since the refutation it is that of the last place alone, whereas the contacts are those of all.
    fn outline_leads(&self) -> bool {
        let leads = |tracker: &dyn Tracker| tracker.outline().is_some() && tracker.outline_leads();
        self.ranked().first().is_some_and(|(_, tracker)| leads(*tracker) && !tracker.refutes_convexity())
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Mutex;

    use super::*;
    use crate::estimators::side::Side;
    use crate::estimators::testing::knowledge;
    use crate::sensor::AlongAway;

    /// A tracker of two candidates, of which the second is considered, with these probabilities.
    fn tracker(shares: [f64; 2], face: &Arc<CalibratedFace>) -> AveragingTracker {
        let config = Config { evidence_power: 0.5, considered_power: 1e-6, ignored_share: 0.02, ..Config::among([]) };
        AveragingTracker {
            config: Arc::new(config),
            considered: vec![false, true],
            face: face.clone(),
            noise_n2_m2: 1e-10,
            weights: shares.to_vec(),
            methods: Arc::new([]),
            trackers: Vec::new(),
            right: Modes::new(shares),
            doubtful: Doubtful::default(),
            signals_motion: false,
            second: Second::default(),
            touched: TouchedPlaces::new(None, face.face),
            has_returned: false,
            base: Pose::new(0.0, 0.0, 0.0),
            last: None,
            blocks: Blocks::new(Pose::new(0.0, 0.0, 0.0), 0.08),
            has_begun: false,
            late: None,
            stated: None,
            continues: false,
        }
    }

    #[test]
    fn verif_a_considered_candidate_widens_the_covariance_and_moves_the_mean_only_if_it_leads() {
        let knowledge = knowledge();
        let side = Side::new(&knowledge.faces[0], &knowledge);
        let at = |x_m: f64| Some(side.estimate_at(Point::new(x_m, 0.0), true, Matrix2::identity() * 1e-8, None));
        let estimates = [at(0.05), at(0.051)];
        let stated = |shares| tracker(shares, &knowledge.faces[0]).together(&estimates, None).unwrap();
        let led = stated([0.6, 0.4]);
        assert_eq!(led.contact, Point::new(0.05, 0.0));
        let covariance_m2 = led.covariance_m2.unwrap();
        assert!((covariance_m2[(0, 0)] - (1e-8 + 0.4 * 1e-6)).abs() < 1e-14, "{covariance_m2}");
        assert!((covariance_m2[(1, 1)] - 1e-8).abs() < 1e-14, "{covariance_m2}");
        let mut led = tracker([0.4, 0.6], &knowledge.faces[0]);
        led.weights = vec![0.6, 0.4];
        let moved = led.together(&estimates, None).unwrap();
        assert!((moved.contact.x() - 0.051).abs() < 1e-12, "{moved:?}");
    }

    /// A candidate with this outline.
    struct Carrier(Option<Vec<OutlinePoint>>);

    /// A candidate whose filter has diverged: it has no estimate, and its systematic error is not a number.
    struct Diverged;

    impl Tracker for Diverged {
        fn step(&mut self, _: &Sample) -> Option<Estimate> {
            None
        }

        fn systematic_m2(&self) -> Option<Matrix2<f64>> {
            Some(Matrix2::repeat(f64::NAN))
        }
    }

    #[test]
    fn robust_a_candidate_without_an_estimate_adds_no_systematic_error() {
        let knowledge = knowledge();
        let side = Side::new(&knowledge.faces[0], &knowledge);
        let stated = side.estimate_at(Point::new(0.05, 0.0), true, Matrix2::identity() * 1e-8, None);
        let mut tracker = tracker([0.999, 0.001], &knowledge.faces[0]);
        tracker.trackers = vec![Box::new(Carrier(None)), Box::new(Diverged)];
        assert_eq!(tracker.with_systematic(stated, &[Some(stated), None]).covariance_m2, stated.covariance_m2);
    }

    /// A candidate with an outline that readings have contradicted.
    struct Refuted(Carrier);

    impl Tracker for Refuted {
        fn step(&mut self, _: &Sample) -> Option<Estimate> {
            None
        }

        fn outline(&self) -> Option<Vec<OutlinePoint>> {
            self.0.outline()
        }

        fn refutes_convexity(&self) -> bool {
            true
        }
    }

    #[test]
    fn verif_a_refuted_outline_does_not_lead() {
        let knowledge = knowledge();
        let leads = |leading: Box<dyn Tracker>| {
            let mut tracker = tracker([0.9, 0.1], &knowledge.faces[0]);
            tracker.trackers = vec![leading, Box::new(Carrier(None))];
            tracker.outline_leads()
        };
        let carrier = || Carrier(Some(Vec::new()));
        assert!(leads(Box::new(carrier())) && !leads(Box::new(Refuted(carrier()))));
    }

    impl Tracker for Carrier {
        fn step(&mut self, _: &Sample) -> Option<Estimate> {
            None
        }

        fn outline(&self) -> Option<Vec<OutlinePoint>> {
            self.0.clone()
        }
    }

    /// A candidate whose object moves.
    struct Mover;

    impl Tracker for Mover {
        fn step(&mut self, _: &Sample) -> Option<Estimate> {
            None
        }

        fn assumes_motion(&self) -> bool {
            true
        }
    }

    #[test]
    fn verif_considered_candidates_do_not_count_for_the_probability_of_motion() {
        let knowledge = knowledge();
        let share = |shares: [f64; 3]| {
            let mut tracker = tracker([0.5, 0.5], &knowledge.faces[0]);
            tracker.right = Modes::new(shares);
            tracker.considered = vec![false, false, true];
            tracker.trackers = vec![Box::new(Carrier(None)), Box::new(Mover), Box::new(Carrier(None))];
            tracker.moving_share()
        };
        // The last candidate is considered.
        assert!((share([0.125, 0.375, 0.5]) - 0.75).abs() < 1e-12 && share([0.0, 0.5, 0.5]) == 1.0);
    }

    #[test]
    fn verif_the_signal_of_motion_lasts_until_a_lower_probability() {
        let mut is_raised = false;
        let mut advance = |share: f64| {
            is_raised = signals_motion(is_raised, share);
            is_raised
        };
        assert!(!advance(0.9999) && advance(1.0 - 1e-7) && advance(0.95) && !advance(0.5) && !advance(0.95));
    }

    /// A candidate that keeps its posterior from touch to touch.
    struct Keeper;

    impl Tracker for Keeper {
        fn step(&mut self, _: &Sample) -> Option<Estimate> {
            None
        }

        fn resume(&mut self, _: &Touch<'_>) -> bool {
            true
        }
    }

    /// A method whose candidates have an outline, which shows that they have begun anew.
    struct Anew;

    impl Method for Anew {
        fn begin(&self, _: &Touch<'_>) -> Box<dyn Tracker> {
            Box::new(Carrier(Some(Vec::new())))
        }
    }

    #[test]
    fn verif_candidates_at_rest_restart_at_a_new_touch_if_the_object_probably_moves() {
        let knowledge = knowledge();
        let has_restarted = |shares: [f64; 2]| {
            let mut tracker = tracker(shares, &knowledge.faces[0]);
            tracker.considered = vec![false, false];
            tracker.methods = Arc::new([("keeper", Box::new(Anew)), ("mover", Box::new(Anew))]);
            tracker.trackers = vec![Box::new(Keeper), Box::new(Mover)];
            tracker.begin_again();
            tracker.trackers[0].outline().is_some()
        };
        assert!(has_restarted([0.4, 0.6]) && !has_restarted([0.6, 0.4]));
    }

    /// A candidate that shows a contact with the object of the last touch.
    struct Expects(Option<Estimate>);

    impl Tracker for Expects {
        fn step(&mut self, _: &Sample) -> Option<Estimate> {
            None
        }

        fn expect_touch(&mut self, _: &Undetected) -> Option<Estimate> {
            self.0
        }
    }

    #[test]
    fn verif_a_touch_that_was_expected_keeps_the_probabilities() {
        let knowledge = knowledge();
        let face = &knowledge.faces[0];
        let side = Side::new(face, &knowledge);
        let contact = face.contact_at(AlongAway::new(0.055, 3e-3));
        let known = Some(side.estimate_at(contact, true, Matrix2::identity() * 1e-8, None));
        let shares = |expected: Option<Estimate>| {
            let mut tracker = tracker([0.5, 0.5], face);
            tracker.right = Modes::new([0.9, 0.1]);
            tracker.considered = vec![false, false];
            tracker.methods = Arc::new([("one", Box::new(Anew)), ("other", Box::new(Anew))]);
            tracker.trackers = vec![Box::new(Expects(expected)), Box::new(Expects(None))];
            let base = Pose::new(0.0, 0.0, 0.0);
            let stated = tracker.expect_touch(&Undetected { base, free_s: 0.1, dt_s: 4e-3, reading_n_m: 1e-5 });
            assert_eq!(stated.map(|estimate| estimate.contact), expected.map(|_| contact));
            let touch = Touch { face, history: &[], free_s: 0.1, before: base, contact_prior: None, seed: 0 };
            assert!(tracker.resume(&touch));
            tracker.right.probabilities()[0]
        };
        assert_eq!((shares(known), shares(None)), (0.9, 0.7));
    }

    #[test]
    fn verif_motion_shows_where_candidates_at_rest_are_calibrated() {
        let knowledge = knowledge();
        let side = Side::new(&knowledge.faces[0], &knowledge);
        let mut tracker = tracker([0.5, 0.5], &knowledge.faces[0]);
        tracker.right = Modes::new([0.1, 0.9]);
        tracker.considered = vec![false, false];
        tracker.trackers = vec![Box::new(Carrier(None)), Box::new(Mover)];
        let calibrated = side.estimate_at(Point::new(0.05, 0.0), true, Matrix2::identity() * 1e-8, None);
        let outside = Estimate { calibrated: false, ..calibrated };
        assert!(tracker.shows_motion(&[Some(calibrated), None]));
        assert!(!tracker.shows_motion(&[Some(outside), Some(calibrated)]));
        // At the tip there is no estimate.
        assert!(!tracker.shows_motion(&[None, Some(calibrated)]));
    }

    #[test]
    fn verif_the_outline_is_that_of_the_most_probable_candidate_that_carries_one() {
        let knowledge = knowledge();
        let point = OutlinePoint {
            surface: Point::new(0.05, 0.0),
            normal: Vector2::y(),
            covariance_m2: Matrix2::identity() * 1e-10,
        };
        let carried = |shares| {
            let mut tracker = tracker(shares, &knowledge.faces[0]);
            tracker.trackers = vec![Box::new(Carrier(None)), Box::new(Carrier(Some(vec![point])))];
            tracker.last = Some((Point::new(0.05, 1e-3), Matrix2::new(1e-4, 0.0, 0.0, 1e-8)));
            (tracker.outline(), tracker.outline_leads())
        };
        assert_eq!(carried([0.4, 0.6]), (Some(vec![point]), true));
        // The band of another candidate's outline contains the variance of the mixture across the outline, not that along it.
        let (outline, leads) = carried([0.6, 0.4]);
        let covariance_m2 = outline.unwrap()[0].covariance_m2;
        assert!(!leads && (covariance_m2 - Matrix2::new(1e-10, 0.0, 0.0, 1.01e-8)).norm() < 1e-16, "{covariance_m2}");
        // A candidate that does not count for the estimate may give the outline, one that is refuted does not.
        assert!(carried([0.99, 0.01]).0.is_some());
        assert_eq!(carried([1.0 - 1e-7, 1e-7]), (None, false));
    }

    #[test]
    fn verif_radius_and_friction_are_those_of_the_candidates_that_estimate_them() {
        let knowledge = knowledge();
        let side = Side::new(&knowledge.faces[0], &knowledge);
        let thin = side.estimate_at(Point::new(0.05, 0.0), true, Matrix2::identity() * 1e-8, None);
        let friction = Some(FrictionCoefficient { coefficient: 0.3, sd: 0.05 });
        let round = Estimate { radius: Some(Radius { radius_m: 0.01, sd_m: 1e-3 }), friction, ..thin };
        let mut tracker = tracker([0.9, 0.1], &knowledge.faces[0]);
        tracker.considered = vec![false, false];
        let stated = tracker.together(&[Some(thin), Some(round)], None).unwrap();
        let (radius, found) = (stated.radius.unwrap(), stated.friction.unwrap());
        assert!((found.coefficient - 0.3).abs() < 1e-12 && (found.sd - 0.05).abs() < 1e-12, "{found:?}");
        assert!((radius.radius_m - 0.01).abs() < 1e-12 && (radius.sd_m - 1e-3).abs() < 1e-12, "{radius:?}");
        assert_eq!(tracker.together(&[Some(thin), Some(thin)], None).unwrap().radius, None);
    }

    #[test]
    fn verif_the_mean_is_shared_at_the_stated_evidence() {
        let knowledge = knowledge();
        let side = Side::new(&knowledge.faces[0], &knowledge);
        let at = |x_m: f64| Some(side.estimate_at(Point::new(x_m, 0.0), true, Matrix2::identity() * 1e-8, None));
        let estimates = [at(0.05), at(0.051)];
        let mut tracker = tracker([0.5, 0.5], &knowledge.faces[0]);
        let config =
            Config { considered_power: 0.01, mean_power: 0.5, mean_evidence: 4.0, ..(*tracker.config).clone() };
        // Log-likelihood ratio at which the two have equal parts.
        let evidence = config.mean_evidence / config.mean_power;
        tracker.right = Modes::new([1.0, (config.considered_power * evidence).exp()]);
        tracker.config = Arc::new(config);
        let stated = tracker.together(&estimates, None).unwrap();
        assert!((stated.contact.x() - 0.0505).abs() < 1e-12, "{stated:?}");
    }

    #[test]
    fn verif_evidence_has_its_power_within_a_group_and_another_between_them() {
        let knowledge = knowledge();
        let mut tracker = tracker([0.6, 0.4], &knowledge.faces[0]);
        tracker.considered = vec![false, false, true];
        tracker.right = Modes::new([0.3, 0.3, 0.4]);
        let tempered = tracker.tempered(&[Some(0.0), Some(-2.0), Some(5.0)]);
        tracker.right.reweight(&tempered);
        let shares = tracker.right.probabilities();
        assert!((shares[2] - 0.4).abs() < 1e-5, "{shares:?}");
        assert!((shares[0] / shares[1] - 1.0_f64.exp()).abs() < 1e-9, "{shares:?}");
    }

    /// At residuals of the mean size, a slightly different variance makes no difference to first order.
    #[test]
    fn verif_overstated_variances_are_no_evidence() {
        let knowledge = knowledge();
        let mut tracker = tracker([0.6, 0.4], &knowledge.faces[0]);
        let innovation = |factor: f64| Innovation::of(Vector1::new(0.5), Matrix1::new(factor)).unwrap();
        for _ in 0..10_000 {
            tracker.doubtful.advance(&tracker.config.doubt, 0.01, Some(innovation(1.0)));
        }
        let gained = tracker.log_evidence(&innovation(0.99)) - tracker.log_evidence(&innovation(1.01));
        assert!(gained.abs() < 1e-5, "{gained}");
    }

    /// A candidate that states a contact at one place in Base, records the means that it takes, and is surprised by negative readings.
    struct Recorder(Arc<Mutex<Vec<(f64, f64)>>>, Estimate);

    impl Tracker for Recorder {
        fn step(&mut self, _: &Sample) -> Option<Estimate> {
            None
        }

        fn step_mean(&mut self, sample: &Sample, count: f64) -> Option<Estimate> {
            self.0.lock().unwrap().push((count, sample.reading_n_m));
            let innovation = Innovation::of(Vector1::new(0.5), Matrix1::new(1.0));
            Some(Estimate { innovation, ..self.1 })
        }

        fn look_ahead(&self, sample: &Sample) -> Ahead {
            Ahead { nis: Some(if sample.reading_n_m < 0.0 { 100.0 } else { 1.0 }), ..Ahead::default() }
        }
    }

    /// Feeds samples of a base that moves by `WAY_M` a sample until three are collected in a block, and then one that surprises.
    /// Returns the blocks that this ends, the estimates of the last two samples, and the place of the recorded contact.
    fn blocks_at_a_surprise(alert_s: f64) -> (Vec<(f64, f64)>, [Estimate; 2], Point<Base>) {
        let knowledge = Arc::new(knowledge());
        let side = Side::new(&knowledge.faces[0], &knowledge);
        let contact = knowledge.faces[0].contact_at(AlongAway::new(0.055, 3e-3));
        let at = side.estimate_at(contact, true, Matrix2::identity() * 1e-8, None);
        let row = estimator("ekf").unwrap();
        let taken = Arc::new(Mutex::new(Vec::new()));
        let mut tracker = tracker([0.5, 0.5], &knowledge.faces[0]);
        let block = BlockSettings { samples: 8, alert_s, ..BlockSettings::default() };
        tracker.config = Arc::new(Config { block, ..(*tracker.config).clone() });
        (tracker.considered, tracker.weights, tracker.right) = (vec![false], vec![1.0], Modes::new([1.0]));
        tracker.methods = Arc::new([("ekf", (row.build)(&(row.defaults)(), &knowledge).unwrap())]);
        tracker.trackers = vec![Box::new(Recorder(taken.clone(), at))];
        let sample = |reading_n_m| Sample { motion: Pose::new(-WAY_M, 0.0, 0.0), dt_s: 4e-3, reading_n_m };
        let collected = |fed: u32| f64::from(fed) - taken.lock().unwrap().iter().map(|(count, _)| count).sum::<f64>();
        let mut fed = 0;
        let mut before = None;
        while fed < 60 || collected(fed) < 3.0 {
            before = tracker.step(&sample(1.0));
            fed += 1;
        }
        taken.lock().unwrap().clear();
        let after = tracker.step(&sample(-1.0));
        let taken = taken.lock().unwrap().clone();
        (taken, [before.unwrap(), after.unwrap()], contact)
    }

    const WAY_M: f64 = 1e-5;

    #[test]
    fn verif_an_improbable_candidate_takes_the_onset_in_blocks() {
        let knowledge = Arc::new(knowledge());
        let side = Side::new(&knowledge.faces[0], &knowledge);
        let contact = knowledge.faces[0].contact_at(AlongAway::new(0.055, 3e-3));
        let at = side.estimate_at(contact, true, Matrix2::identity() * 1e-8, None);
        let mut tracker = tracker([0.999, 0.001], &knowledge.faces[0]);
        let block = BlockSettings { samples: 4, alert_s: 0.022, ..BlockSettings::default() };
        let config = Config { block, second: SecondSettings::NONE, ..(*tracker.config).clone() };
        (tracker.config, tracker.considered) = (Arc::new(config), vec![false, false]);
        let taken = [(); 2].map(|()| Arc::new(Mutex::new(Vec::new())));
        let recorders = taken.each_ref().map(|taken| Recorder(taken.clone(), at));
        tracker.trackers = recorders.into_iter().map(|recorder| Box::new(recorder) as Box<dyn Tracker>).collect();
        tracker.methods = Arc::new([("one", Box::new(Anew)), ("other", Box::new(Anew))]);
        let sample = Sample { motion: Pose::new(-WAY_M, 0.0, 0.0), dt_s: 4e-3, reading_n_m: 1.0 };
        (0..10).for_each(|_| _ = tracker.step(&sample));
        let counts = taken.map(|taken| taken.lock().unwrap().iter().map(|(count, _)| *count).collect::<Vec<_>>());
        assert_eq!(counts, [vec![1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 4.0], vec![1.0, 5.0, 4.0]]);
    }

    #[test]
    fn verif_a_surprising_sample_ends_the_block_before_it() {
        let (taken, [before, after], contact) = blocks_at_a_surprise(0.1);
        assert_eq!(taken, [(3.0, 1.0), (1.0, -1.0)]);
        // The innovation is that of a block, at its end.
        assert!(before.innovation.is_none() && after.innovation.is_some());
        assert_eq!(after.contact, contact);
    }

    #[test]
    fn verif_within_a_block_the_contact_moves_with_the_base_since_the_last_mean() {
        let (taken, [_, after], contact) = blocks_at_a_surprise(0.0);
        assert_eq!(taken, [(3.0, 1.0)]);
        // The mean of three samples lies two samples before the surprising one.
        assert!((after.contact.x() - (contact.x() - 2.0 * WAY_M)).abs() < 1e-12, "{after:?}");
    }

    #[test]
    fn robust_methods_that_smooth_take_no_blocks() {
        let knowledge = Arc::new(knowledge());
        let config = |samples| {
            let block = BlockSettings { samples, ..BlockSettings::default() };
            serde_json::to_value(Config { block, ..Config::hindsight() }).unwrap()
        };
        assert!(build_hindsight(&config(1), &knowledge).is_ok());
        let refused = build_hindsight(&config(2), &knowledge).err().unwrap().to_string();
        assert!(refused.contains("block.samples"), "{refused}");
        // Settings in part leave the others at the defaults of hindsight.
        let in_part = serde_json::json!({"candidates": [{"name": "batch", "weight": 1.0}]});
        assert!(build_hindsight(&in_part, &knowledge).is_ok());
    }

    #[test]
    fn verif_a_candidate_without_evidence_keeps_its_probability() {
        let knowledge = knowledge();
        let mut tracker = tracker([0.6, 0.4], &knowledge.faces[0]);
        tracker.considered = vec![false, false, false, true];
        tracker.right = Modes::new([0.3, 0.2, 0.1, 0.4]);
        tracker.right.reweight(&tracker.completed(&tracker.tempered(&[None, Some(1.0), Some(3.0), Some(5.0)])));
        let shares = tracker.right.probabilities();
        assert!((shares[0] - 0.3).abs() < 1e-12, "{shares:?}");
        assert!((shares[1] / shares[2] - 2.0 * (-1.0_f64).exp()).abs() < 1e-9, "{shares:?}");
    }
}
