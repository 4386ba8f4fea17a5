//! Several methods side by side, believed as far as their predictions deserve.
//!
//! Each candidate states before every reading what it expects, and so how probable the reading is, `N(y; 0, S)`. With a prior for each that gives
//! the probability of its being right (Bayes' theorem; Kass and Raftery, "Bayes factors", JASA 90(430), 1995): a candidate that is wrong
//! foretells badly, and one that could explain anything foretells vaguely. Before the readings tell them apart the priors decide.
//! What is stated is the mean and covariance of the mixture, not of the winner: while two are still probable, that they disagree is part of
//! what is not known.
//!
//! Objects may change, so the right candidate may: at a constant rate it is drawn anew from the priors. A candidate once refuted comes back within a
//! few times as many readings as it takes to refute the next, instead of never.

use std::sync::Arc;

use filters::imm::{Modes, Transition};
use filters::{Gaussian, Innovation};
use nalgebra::{Matrix1, Vector1, Vector2};
use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::settings::{Settings, SettingsError, parse, within};
use super::shares::{MOST_MODELS, ModelShares};
use super::{
    ESTIMATORS, Estimate, EstimatorRow, Knowledge, Method, MethodClass, OutlinePoint, Radius, Sample, Touch, Tracker,
    estimator,
};

/// One method among which is chosen.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Candidate {
    /// Its name in the registry; it runs with its defaults.
    pub name: String,
    /// Prior probability, relative to the others.
    pub weight: f64,
}

/// Settings.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub(super) struct Config {
    /// The candidates. The odds favour what assumes most: it foretells the readings least vaguely, and a contact at the start tells little.
    pub candidates: Vec<Candidate>,
    /// A reading farther off than this, in standard deviations, speaks against a candidate as if it lay there: a spike decides nothing.
    pub gate_sds: f64,
    /// Mean time after which the right candidate is another.
    pub sojourn_s: f64,
}

impl Default for Config {
    /// The more a candidate can explain, the longer the odds against it: `ukf` takes the object to be thin, the others do not. `outline` begins as `sliding` does, and goes
    /// before it where the readings do not tell the two apart. The odds were set on the pins and circles of the standard suite; they matter in the first tenths of a
    /// second, before the readings tell.
    fn default() -> Self {
        Self::among([("ukf", 300.0), ("sliding", 1.0), ("outline", 10.0)])
    }
}

impl Config {
    /// Among what looks back over the whole contact, with odds set in the same way. An outline that may bend anywhere is taken only where a constant radius is refuted.
    pub(super) fn hindsight() -> Self {
        Self::among([("batch", 300.0), ("batch-sliding", 1.0), ("outline-batch", 0.001)])
    }

    fn among<const COUNT: usize>(candidates: [(&str, f64); COUNT]) -> Self {
        let candidates = candidates.map(|(name, weight)| Candidate { name: name.into(), weight });
        Self { candidates: candidates.into(), gate_sds: 5.0, sojourn_s: 1000.0 }
    }
}

impl Settings for Config {
    fn validate(&self) -> Result<(), SettingsError> {
        within("candidates", self.candidates.len() as f64, 1.0..=MOST_MODELS as f64)?;
        for (place, candidate) in self.candidates.iter().enumerate() {
            within("candidates.weight", candidate.weight, 1e-9..=1e9)?;
            if self.candidates[..place].iter().any(|other| other.name == candidate.name) {
                return Err(refused(&candidate.name, "named twice, expected each once"));
            }
        }
        within("gate_sds", self.gate_sds, 1.0..=1e6)?;
        within("sojourn_s", self.sojourn_s, 1e-3..=1e9)
    }
}

fn refused(name: &str, why: &str) -> SettingsError {
    SettingsError::Parse(format!("`candidates`: `{name}` is {why}"))
}

/// The row of a candidate: one that can run beside the others, and looks back where they do.
fn row_of(name: &str, looks_back: bool) -> Result<&'static EstimatorRow, SettingsError> {
    let row = estimator(name).ok_or_else(|| {
        let known: Vec<_> = ESTIMATORS.iter().map(|row| row.name).collect();
        refused(name, &format!("unknown, expected one of: {}", known.join(", ")))
    })?;
    if (row.defaults)().get("candidates").is_some() {
        return Err(refused(name, "a choice itself, expected a method to choose"));
    }
    if row.sensor_model.is_some() {
        return Err(refused(name, "bound to a sensor model of its own, expected one that takes the calibration's"));
    }
    match (row.class == MethodClass::Hindsight, looks_back) {
        (true, false) => Err(refused(name, "one that looks back, expected one that only knows the samples so far")),
        (false, true) => Err(refused(name, "one that only knows the samples so far, expected one that looks back")),
        _ => Ok(row),
    }
}

/// The choice among methods that state at each sample what the samples so far tell.
pub(super) fn build_recursive(config: &Value, knowledge: &Arc<Knowledge>) -> Result<Box<dyn Method>, SettingsError> {
    build(config, knowledge, false)
}

/// The choice among methods that look back over the whole contact.
pub(super) fn build_hindsight(config: &Value, knowledge: &Arc<Knowledge>) -> Result<Box<dyn Method>, SettingsError> {
    build(config, knowledge, true)
}

fn build(config: &Value, knowledge: &Arc<Knowledge>, looks_back: bool) -> Result<Box<dyn Method>, SettingsError> {
    let config: Config = parse(config)?;
    let candidate = |candidate: &Candidate| {
        let row = row_of(&candidate.name, looks_back)?;
        Ok((row.name, (row.build)(&(row.defaults)(), knowledge)?))
    };
    let methods = config.candidates.iter().map(candidate).collect::<Result<_, SettingsError>>()?;
    Ok(Box::new(ModelAveraging { config, methods }))
}

/// The candidates, and what each is called.
type Methods = Arc<[(&'static str, Box<dyn Method>)]>;

struct ModelAveraging {
    config: Config,
    methods: Methods,
}

impl Method for ModelAveraging {
    fn begin(&self, touch: &Touch<'_>) -> Box<dyn Tracker> {
        let weights: Vec<f64> = self.config.candidates.iter().map(|candidate| candidate.weight).collect();
        Box::new(AveragingTracker {
            gate_sds: self.config.gate_sds,
            sojourn_s: self.config.sojourn_s,
            methods: self.methods.clone(),
            trackers: self.methods.iter().map(|(_, method)| method.begin(touch)).collect(),
            right: Modes::new(weights.iter().copied()),
            weights,
        })
    }
}

/// The candidates on one contact.
struct AveragingTracker {
    gate_sds: f64,
    sojourn_s: f64,
    weights: Vec<f64>,
    methods: Methods,
    trackers: Vec<Box<dyn Tracker>>,
    /// Which of them is right.
    right: Modes,
}

impl AveragingTracker {
    fn names(&self) -> impl Iterator<Item = &'static str> {
        self.methods.iter().map(|(name, _)| *name)
    }

    /// Logarithm of the evidence that a candidate's innovation is, bounded.
    fn log_evidence(&self, innovation: &Innovation<1>) -> f64 {
        innovation.log_likelihood() + 0.5 * (innovation.nis - self.gate_sds.powi(2)).max(0.0)
    }

    /// Weighs the candidates, and returns the innovation of all together.
    fn weigh(&mut self, sample: &Sample, estimates: &[Option<Estimate>]) -> Option<Innovation<1>> {
        let sojourns_s = vec![self.sojourn_s; self.methods.len()];
        self.right.predict(&Transition::from_sojourns(sample.dt_s, &sojourns_s, &self.weights));
        let innovations: Vec<_> = estimates.iter().map(|estimate| estimate.as_ref()?.innovation).collect();
        let known = innovations.iter().zip(self.right.probabilities());
        let innovation = Innovation::of_mixture(known.filter_map(|(found, share)| Some(((*found)?, *share))))?;
        let evidence: Vec<_> = innovations.iter().map(|found| Some(self.log_evidence(found.as_ref()?))).collect();
        // One that foretells nothing is no better than the worst of those that do.
        let least = evidence.iter().flatten().copied().fold(f64::INFINITY, f64::min);
        let evidence: Vec<_> = evidence.iter().map(|found| Some(found.unwrap_or(least))).collect();
        self.right.reweight(&evidence)?;
        Some(innovation)
    }

    /// What the candidates say together; nothing where none says anything.
    fn together(&self, estimates: &[Option<Estimate>], innovation: Option<Innovation<1>>) -> Option<Estimate> {
        let shares = self.right.probabilities();
        let parts: Vec<(&Estimate, f64)> =
            estimates.iter().zip(shares).filter_map(|(estimate, share)| Some((estimate.as_ref()?, *share))).collect();
        let (leading, _) = *parts.iter().max_by(|a, b| a.1.total_cmp(&b.1))?;
        let known: f64 = parts.iter().map(|(_, share)| share).sum();
        // Counted from the leading candidate's contact: where that is all but sure nothing of it is lost to rounding.
        let offset = |estimate: &Estimate| estimate.contact.vector() - leading.contact.vector();
        let shift = parts.iter().map(|(estimate, share)| offset(estimate) * (share / known)).sum::<Vector2<f64>>();
        let place = |(estimate, share): &(&Estimate, f64)| {
            Some((Gaussian::new(offset(estimate), estimate.covariance_m2?), *share))
        };
        let size = |(estimate, share): &(&Estimate, f64)| {
            let Radius { radius_m, sd_m } = estimate.radius?;
            Some((Gaussian::new(Vector1::new(radius_m), Matrix1::new(sd_m * sd_m)), *share))
        };
        let places: Option<Vec<_>> = parts.iter().map(place).collect();
        let size = Gaussian::of_mixture(parts.iter().filter_map(size)).filter(|_| leading.radius.is_some());
        Some(Estimate {
            contact: leading.contact.shifted(shift),
            covariance_m2: places.and_then(Gaussian::of_mixture).map(|places| places.covariance),
            radius: size.map(|size| Radius { radius_m: size.mean[0], sd_m: size.covariance[0].sqrt() }),
            innovation,
            models: Some(ModelShares::new(self.names().zip(shares.iter().copied()))),
            ..*leading
        })
    }
}

impl Tracker for AveragingTracker {
    fn step(&mut self, sample: &Sample) -> Option<Estimate> {
        let estimates: Vec<_> = self.trackers.iter_mut().map(|tracker| tracker.step(sample)).collect();
        let innovation = self.weigh(sample, &estimates);
        self.together(&estimates, innovation)
    }

    /// All that was read tells which candidate is right, so its share at the end counts for every instant.
    fn hindsight(&mut self) -> Option<Vec<Option<Estimate>>> {
        let revised: Vec<_> = self.trackers.iter_mut().map(|tracker| tracker.hindsight()).collect();
        let count = revised.iter().flatten().map(Vec::len).min()?;
        let at = |i: usize| revised.iter().map(|said| said.as_ref()?[i]).collect::<Vec<_>>();
        Some((0..count).map(|i| self.together(&at(i), None)).collect())
    }

    /// Candidates that remember nothing begin anew. The object may be the last one or another, the one as likely as the other: half of what is believed
    /// of the candidates is what was, half the priors.
    fn resume(&mut self, touch: &Touch<'_>) -> bool {
        for (tracker, (_, method)) in self.trackers.iter_mut().zip(&*self.methods) {
            if !tracker.resume(touch) {
                *tracker = method.begin(touch);
            }
        }
        let total: f64 = self.weights.iter().sum();
        let halves = self.right.probabilities().iter().zip(&self.weights).map(|(share, weight)| share + weight / total);
        self.right = Modes::new(halves.collect::<Vec<_>>());
        true
    }

    fn outline(&self) -> Option<Vec<OutlinePoint>> {
        let shares = self.right.probabilities();
        let leading = shares.iter().zip(&self.trackers).max_by(|a, b| a.0.total_cmp(b.0))?;
        leading.1.outline()
    }
}
