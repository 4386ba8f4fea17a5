//! Settings of the filters with Gaussian hypotheses.

use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::GaussianFilter;
use crate::estimators::doubt::Search;
use crate::estimators::motion::{MotionSettings, Round};
use crate::estimators::start::Start;
use crate::estimators::systematic::SystematicSettings;
use crate::settings::{Settings, SettingsError, to_json, within};

/// Way of the base over which the methods of `recommended` average the readings before a touch: a reading hardly deviates
/// from a linear function over such a way.
pub(in crate::estimators) const ONSET_WAY_M: f64 = 0.3e-3;

/// Probability, in the methods of `recommended`, that a new touch is one of the same object. Chosen on the training suite of random
/// scenes.
pub(in crate::estimators) const KEPT_SHARE: f64 = 0.8;

/// Default of `return_rate` (1/s) in the methods of `recommended`.
const RETURN_RATE: f64 = 10.0;

/// Settings of a filter with Gaussian hypotheses.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields, bound = "Filter: GaussianFilter")]
pub(in crate::estimators) struct Config<Filter> {
    /// Initial hypotheses: one Gaussian, or several along the whisker.
    pub start: Start,
    /// Way of the base over which the readings before a touch are averaged, which shortens the first step of a touch;
    /// with 0 each reading counts by itself.
    pub onset_way_m: f64,
    /// Model of the contact's motion.
    pub motion: MotionSettings,
    /// Fading memory: factor of the prior covariance at each step.
    pub fading: f64,
    /// Gate, in standard deviations: the noise of a reading with a larger innovation is inflated until the innovation
    /// lies at the gate.
    pub gate_sds: f64,
    /// Weight of a hypothesis, relative to the heaviest, below which it is dropped.
    pub prune_share: f64,
    /// Divergence between the beliefs before and after below which two hypotheses are merged.
    pub merge_loss: f64,
    /// Weight of a hypothesis below which it does not count for the estimate.
    pub ignored_share: f64,
    /// Search for the contact at another place.
    pub search: Search,
    /// Power of the likelihoods by which hypotheses are weighted: below 1 if the errors of neighbouring readings depend
    /// on one another, as those of a motion model do.
    pub evidence_power: f64,
    /// Whether readings are corrected for the inertia of the wire, uncertain outside of the calibrated domain, and left
    /// out at the tip once the contact was certain to be on the side.
    pub corrected: bool,
    /// Probability that a new touch is one of the same object, whose belief is then kept. 0: each touch begins anew.
    pub kept_share: f64,
    /// Prior rate (1/s) at which the contact returns to a place that it has left. Without effect until
    /// [`expect_jumps`](crate::estimators::Tracker::expect_jumps) is called; requires `kept_share` and `search`. 0: the contact
    /// does not return, neither to such a place nor to that of [`expect_return`](crate::estimators::Tracker::expect_return).
    pub return_rate: f64,
    /// Systematic errors of readings and poses for [`systematic_m2`](crate::estimators::Tracker::systematic_m2); the filter itself
    /// has none.
    pub systematic: SystematicSettings,
    /// Settings of this filter alone.
    pub filter: Filter,
}

impl<Filter: GaussianFilter> Default for Config<Filter> {
    fn default() -> Self {
        Self {
            start: Start::Hypotheses { count: 16 },
            onset_way_m: 0.0,
            motion: MotionSettings::Round(Round::default()),
            fading: 1.0,
            gate_sds: 5.0,
            prune_share: 1e-4,
            merge_loss: 1e-2,
            ignored_share: 0.0,
            search: Search::NONE,
            evidence_power: 1.0,
            corrected: false,
            kept_share: 0.0,
            return_rate: 0.0,
            systematic: SystematicSettings::NONE,
            filter: Filter::default(),
        }
    }
}

impl<Filter: GaussianFilter> Config<Filter> {
    /// Settings for contacts that slide around objects of any size.
    pub(in crate::estimators) fn sliding() -> Self {
        Self { motion: MotionSettings::Round(Round::of_any_size()), ..Self::default() }
    }

    /// Settings for objects of constant radius, from a thin object to a plane.
    pub(in crate::estimators) fn round() -> Self {
        let motion = MotionSettings::Round(Round::of_any_scale());
        Self {
            onset_way_m: ONSET_WAY_M,
            motion,
            ignored_share: 1e-3,
            search: Search::default(),
            evidence_power: 0.7,
            corrected: true,
            kept_share: KEPT_SHARE,
            return_rate: RETURN_RATE,
            ..Self::default()
        }
    }
}

/// Serialisation of the filter's settings in a method with its own model of the contact's motion: without `motion`, which would
/// have no effect.
pub(in crate::estimators) mod without_motion {
    use serde::de::{Deserializer, Error};
    use serde::ser::Serializer;
    use serde_json::Map;

    use super::*;

    pub(in crate::estimators) fn serialize<Filter: GaussianFilter, S: Serializer>(
        config: &Config<Filter>,
        serializer: S,
    ) -> Result<S::Ok, S::Error> {
        let mut settings = to_json(config);
        if let Some(all) = settings.as_object_mut() {
            all.remove("motion");
        }
        settings.serialize(serializer)
    }

    pub(in crate::estimators) fn deserialize<'de, Filter: GaussianFilter, D: Deserializer<'de>>(
        deserializer: D,
    ) -> Result<Config<Filter>, D::Error> {
        let settings = Map::deserialize(deserializer)?;
        if settings.contains_key("motion") {
            return Err(Error::custom(
                "`filter.motion`: found a model of motion, expected none, since the method has its own",
            ));
        }
        Config::deserialize(&Value::Object(settings)).map_err(Error::custom)
    }
}

impl<Filter: GaussianFilter> Settings for Config<Filter> {
    fn validate(&self) -> Result<(), SettingsError> {
        self.start.validate()?;
        self.motion.validate()?;
        within("onset_way_m", self.onset_way_m, 0.0..=1e-2)?;
        within("fading", self.fading, 1.0..=2.0)?;
        within("gate_sds", self.gate_sds, 1.0..=1e6)?;
        within("prune_share", self.prune_share, 0.0..=0.5)?;
        within("merge_loss", self.merge_loss, 0.0..=1.0)?;
        within("ignored_share", self.ignored_share, 0.0..=0.5)?;
        within("evidence_power", self.evidence_power, 1e-3..=1.0)?;
        within("kept_share", self.kept_share, 0.0..=0.99)?;
        within("return_rate", self.return_rate, 0.0..=1e3)?;
        self.search.validate()?;
        self.systematic.validate()?;
        self.filter.validate()
    }
}
