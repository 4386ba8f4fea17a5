//! Settings of a model average.

use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};

use super::alternative::AlternativeSettings;
use crate::candidates::check;
use crate::doubt::DoubtSettings;
use crate::estimators::block::BlockSettings;
use crate::estimators::gaussian::{KEPT_SHARE, ONSET_WAY_M};
use crate::estimators::second::SecondSettings;
use crate::estimators::shares::MOST_MODELS;
use crate::estimators::systematic::SystematicSettings;
use crate::settings::{Settings, SettingsError, to_json, within};

/// Largest `mean_evidence`. With it, the considered candidates determine the mean only where no other candidate has an estimate.
const MOST_MEAN_EVIDENCE: f64 = 1e3;

/// A method to average over.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(in crate::estimators) struct Candidate {
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
pub(in crate::estimators) struct Config {
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
    /// Probability of a candidate, relative to that of the most probable one, below which it does not count for the estimate.
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
    /// A further method, whose estimates take the place of the average once the evidence for it is decisive.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub alternative: Option<AlternativeSettings>,
}

impl Default for Config {
    /// The more flexible a candidate, the smaller its prior: `ukf` assumes a thin object, `sliding` a constant radius of
    /// centimetres, `round` one of any size, `outline` only a convex object, `rubbing` also a contact with friction, `drifting`
    /// also an object that moves, whose velocity can explain errors of any other model; `installed` also doubts the calibration,
    /// with an even chance nearly, and is considered. Odds and powers were chosen on the training suite of random scenes and on the
    /// standard suite, those of `rubbing` and `drifting` also on random contacts. The prior probabilities of these two, relative to
    /// the largest, are below `ignored_share`: at first they do not count for the estimate. Readings before a touch are averaged,
    /// so that its first step is short; the belief of an object is kept from touch to touch; all candidates correct the readings
    /// for inertia and leave out those at the tip: a candidate that used them would state a wrong contact there.
    fn default() -> Self {
        let mut average = Self::among([
            ("ukf", 20.0),
            ("round", 10.0),
            ("sliding", 3.0),
            ("outline", 10.0),
            ("rubbing", 0.3),
            ("drifting", 0.3),
        ]);
        for candidate in
            average.candidates.iter_mut().filter(|candidate| ["ukf", "sliding"].contains(&candidate.name.as_str()))
        {
            candidate.settings.insert("onset_way_m".into(), ONSET_WAY_M.into());
            candidate.settings.insert("kept_share".into(), KEPT_SHARE.into());
            candidate.settings.insert("corrected".into(), true.into());
        }
        let systematic = to_json(&SystematicSettings::EXPECTED);
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
            alternative: Some(AlternativeSettings::default()),
            ..average
        }
    }
}

impl Config {
    /// Average of the methods that smooth over the whole contact, with odds and power chosen in the same way, and on small circles
    /// along which the whisker rubs. The evidence is that of the forward filters of the smoothers. On small circles it favours the thin
    /// object, which has no radius to be found, although the smoothed contacts of a round one are better. The power is therefore small.
    /// `smoother-installed` adds to the covariance alone: its contacts are less accurate even if the sensor deviates.
    pub(in crate::estimators) fn hindsight() -> Self {
        let mut average = Self::among([("batch", 1.0), ("batch-sliding", 2.0), ("outline-batch", 1.0)]);
        average.candidates.push(Candidate { considered: true, ..Candidate::new("smoother-installed", 3.0) });
        Self {
            evidence_power: 0.1,
            considered_power: 0.01,
            mean_evidence: MOST_MEAN_EVIDENCE,
            block: BlockSettings::single(),
            ..average
        }
    }

    /// Whether considered candidates determine the mean if the evidence for them is large.
    pub(super) fn may_considered_lead(&self) -> bool {
        self.mean_evidence < MOST_MEAN_EVIDENCE
    }

    pub(super) fn among<const COUNT: usize>(candidates: [(&str, f64); COUNT]) -> Self {
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
            alternative: None,
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
        within("mean_evidence", self.mean_evidence, 0.0..=MOST_MEAN_EVIDENCE)?;
        self.doubt.validate()?;
        self.second.validate()?;
        self.block.validate()?;
        self.alternative.as_ref().map_or(Ok(()), AlternativeSettings::validate)?;
        within("sojourn_s", self.sojourn_s, 1e-3..=1e9)?;
        within("ignored_share", self.ignored_share, 0.0..=0.5)?;
        within("farthest_m", self.farthest_m, 0.0..=1.0)
    }
}
