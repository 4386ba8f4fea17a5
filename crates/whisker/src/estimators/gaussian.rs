//! Common part of the filters with Gaussian hypotheses, which differ in prediction and update only.

use std::fmt::Debug;
use std::sync::Arc;

use filters::{Bank, Gaussian, Innovation, Measurement, Process, Update, UpdateError, product, robust};
use nalgebra::{Matrix1, Matrix2, SMatrix, SVector, Vector1, Vector2};
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::doubt::{Doubt, Search};
use super::inertia::Inertia;
use super::motion::{AnyMotion, Motion, MotionSettings, Round};
use super::odds::Odds;
use super::regained::{Regained, Unknown};
use super::side::{ContactReading, Side};
use super::start::{Earlier, EarlierReading, Start, earlier, is_free};
use super::systematic::{Systematic, SystematicSettings};
use super::{Ahead, ContactPrior, Estimate, Knowledge, Method, Sample, Touch, Tracker, Undetected, to_json};
use crate::frames::{Base, Point, Pose, Start as FirstBase};
use crate::sensor::AlongAway;
use crate::settings::{Settings, SettingsError, parse, within};

/// Prediction and update of a filter whose belief is Gaussian; the type holds the filter's own settings.
pub(super) trait GaussianFilter:
    Copy + Debug + Default + Serialize + DeserializeOwned + Send + Sync + 'static
{
    /// Checks every value.
    fn validate(&self) -> Result<(), SettingsError> {
        Ok(())
    }

    /// Propagates the belief through the process. Returns the process's Jacobian at the mean, `None` if the filter has none.
    fn predict<const N: usize>(
        &self,
        belief: &mut Gaussian<N>,
        process: &impl Process<N>,
    ) -> Result<Option<SMatrix<f64, N, N>>, UpdateError>;

    /// Conditions the belief on a reading.
    fn update<const N: usize>(
        &self,
        belief: &mut Gaussian<N>,
        measurement: &impl Measurement<N, 1>,
        z: &Vector1<f64>,
    ) -> Result<Innovation<1>, UpdateError>;
}

/// Way of the base over which the methods of `recommended` average the readings before a touch: a reading hardly deviates
/// from a linear function over such a way.
pub(super) const ONSET_WAY_M: f64 = 0.3e-3;

/// Probability, in the methods of `recommended`, that a new touch is one of the same object. Chosen on the training suite of random
/// scenes.
pub(super) const KEPT_SHARE: f64 = 0.8;

/// Default of `return_rate` (1/s) in the methods of `recommended`.
const RETURN_RATE: f64 = 10.0;

/// Settings of a filter with Gaussian hypotheses.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields, bound = "Filter: GaussianFilter")]
pub(super) struct Config<Filter> {
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
    /// [`Tracker::expect_jumps`] is called; requires `kept_share` and `search`. 0: the contact does not return, neither to such
    /// a place nor to that of [`Tracker::expect_return`].
    pub return_rate: f64,
    /// Systematic errors of readings and poses for [`Tracker::systematic_m2`]; the filter itself has none.
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
    pub(super) fn sliding() -> Self {
        Self { motion: MotionSettings::Round(Round::of_any_size()), ..Self::default() }
    }

    /// Settings for objects of constant radius, from a thin object to a plane.
    pub(super) fn round() -> Self {
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

/// Serialisation of the filter's settings in a method with its own model of the contact's motion: without `motion`, which would have no
/// effect.
pub(super) mod without_motion {
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
        Config::deserialize(Value::Object(settings)).map_err(Error::custom)
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

/// The method that runs a filter with these settings.
pub(super) fn build<Filter: GaussianFilter>(
    config: &Value,
    knowledge: &Arc<Knowledge>,
) -> Result<Box<dyn Method>, SettingsError> {
    let config: Config<Filter> = parse(config)?;
    Ok(Box::new(Filtering { config, knowledge: knowledge.clone() }))
}

struct Filtering<Filter> {
    config: Config<Filter>,
    knowledge: Arc<Knowledge>,
}

impl<Filter: GaussianFilter> Method for Filtering<Filter> {
    fn begin(&self, touch: &Touch<'_>) -> Box<dyn Tracker> {
        self.config.motion.begin(self, touch)
    }

    fn is_of_fixed_size(&self) -> bool {
        !self.config.search.is_on()
    }
}

impl<Filter: GaussianFilter> AnyMotion for Filtering<Filter> {
    fn begin_with<Model: Motion<N>, const N: usize>(&self, motion: Model, touch: &Touch<'_>) -> Box<dyn Tracker> {
        Box::new(Follower::new(self.config, motion, touch, &self.knowledge))
    }
}

/// Follows one contact with a bank of hypotheses.
pub(super) struct Follower<Filter, Model, const N: usize> {
    config: Config<Filter>,
    pub(super) motion: Model,
    pub(super) side: Side,
    noise_sd_n_m: f64,
    contact_prior: Option<ContactPrior>,
    /// Samples before the touch, until the first step.
    history: Vec<Sample>,
    /// `None` before the first step.
    bank: Option<Bank<N>>,
    /// Pose of the base at the last sample.
    base: Pose<Base, FirstBase>,
    /// Time of the last sample.
    time_s: f64,
    /// Banks stored during the touch, the newer one first. A new touch of the same object begins with the older one, because
    /// readings between a release and its detection contradict the belief.
    recent: Option<Kept<N>>,
    settled: Option<Kept<N>>,
    /// Places that the contact has left, the latest one last.
    left: Vec<Left<N>>,
    /// Whether the contact may jump from one place of the object to another.
    jumps: bool,
    /// Place to which the contact may have returned at the last sample.
    returned: Option<Point<Base>>,
    doubt: Doubt,
    inertia: Inertia,
    systematic: Systematic<N>,
    /// Whether the contact was lost at the tip.
    is_lost: bool,
    /// Whether a contact that was lost, or has passed the tip, is on the side again.
    regained: Regained,
    /// Whether the readings showed a contact with the known object before this touch was detected.
    continues: bool,
    /// Whether the contact was certain to be on the whisker's side during this touch. Until then readings at the tip are not left
    /// out: the first belief may lie beyond the whisker's end only because it is wide.
    was_on_side: bool,
    /// Whether the whole belief has moved beyond the end of the loaded whisker during this touch: the tip itself rests on the
    /// object, at a place that the belief does not describe.
    is_past_tip: bool,
    /// Belief at the last estimate.
    stated: Option<Gaussian<N>>,
}

impl<Filter: GaussianFilter, Model: Motion<N>, const N: usize> Follower<Filter, Model, N> {
    pub(super) fn new(config: Config<Filter>, motion: Model, touch: &Touch<'_>, knowledge: &Knowledge) -> Self {
        Self {
            config,
            motion,
            side: Side::new(touch.face, knowledge),
            noise_sd_n_m: knowledge.noise_sd_n_m,
            contact_prior: touch.contact_prior,
            history: touch.history.to_vec(),
            bank: None,
            base: touch.before,
            time_s: 0.0,
            recent: None,
            settled: None,
            left: Vec::with_capacity(MOST_LEFT),
            jumps: false,
            returned: None,
            doubt: Doubt::default(),
            inertia: Inertia::new(&knowledge.whisker),
            systematic: Systematic::new(touch.face.largest_reading_n_m),
            is_lost: false,
            regained: Regained::default(),
            continues: false,
            was_on_side: false,
            is_past_tip: false,
            stated: None,
        }
    }

    /// Gate of the readings, in standard deviations.
    pub(super) fn gate_sds(&self) -> f64 {
        self.config.gate_sds
    }

    /// The measurement model.
    pub(super) fn reading(&self) -> ContactReading<'_> {
        ContactReading::new(&self.side, Model::INDICES)
    }

    /// The bank at the touch: the initial hypotheses, conditioned on the readings before the touch.
    fn begin(&self, touch: &Sample) -> Bank<N> {
        let mut bank = Bank::new(self.anywhere(touch, self.contact_prior));
        if let Some(kept) = self.kept_until(touch) {
            let share =
                if self.continues { self.config.kept_share.max(CONTINUED_SHARE) } else { self.config.kept_share };
            bank.add(kept.hypotheses().iter().map(|one| (one.belief, one.weight().ln())), share);
        }
        let way_m = self.config.onset_way_m;
        for Earlier { sample, count, .. } in earlier(&self.history, touch, self.noise_sd_n_m, way_m) {
            let back = self.motion.step(&self.side, &sample);
            // A reading of a free whisker is equally probable under every hypothesis.
            if way_m > 0.0 && bank.hypotheses().iter().all(|one| is_free(&back, &one.belief)) {
                continue;
            }
            let reading = EarlierReading { back, reading: self.reading().of_mean(count) };
            // A reading without a valid update leaves the bank as it is.
            let _ = self.condition(&mut bank, &reading, sample.reading_n_m);
        }
        bank
    }

    /// Stores the bank every [`SETTLING_S`]. Allocates at most twice per touch.
    fn keep(&mut self) {
        let is_due = self.recent.as_ref().is_none_or(|recent| self.time_s - recent.time_s >= SETTLING_S);
        let Some(bank) = self.bank.as_ref().filter(|_| self.config.kept_share > 0.0 && is_due) else { return };
        let (base, time_s) = (self.base, self.time_s);
        let oldest = if self.recent.is_some() { self.settled.take() } else { None };
        let kept = match oldest {
            Some(Kept { bank: mut buffer, .. }) => {
                buffer.copy_from(bank);
                Kept { bank: buffer, base, time_s }
            }
            None => Kept { bank: bank.clone(), base, time_s },
        };
        if let Some(recent) = self.recent.replace(kept) {
            self.settled = Some(recent);
        }
    }

    /// The kept bank at the touch, conditioned on its reading. `None` if there is none, or none that touches.
    fn kept_until(&self, touch: &Sample) -> Option<Bank<N>> {
        let kept = self.settled.as_ref()?;
        let mut bank = kept.bank.clone();
        self.predict(&mut bank, &self.since(kept));
        self.condition(&mut bank, &self.reading(), touch.reading_n_m).ok()?;
        (!bank.hypotheses().is_empty()).then_some(bank)
    }

    /// Motion and time since a bank was stored, as a sample without a reading.
    fn since(&self, kept: &Kept<N>) -> Sample {
        Sample { motion: kept.base.then(&self.base.inverse()), dt_s: self.time_s - kept.time_s, reading_n_m: 0.0 }
    }

    /// Propagates a bank to a sample. Returns the Jacobian of the process at the most probable hypothesis, `None` without systematic
    /// errors.
    fn predict(&self, bank: &mut Bank<N>, sample: &Sample) -> Option<SMatrix<f64, N, N>> {
        let process = self.motion.step(&self.side, sample);
        let most = bank.most_probable().filter(|_| self.config.systematic.is_on()).map(|most| most.belief.mean);
        let mut transition = None;
        bank.predict(|belief| {
            let before = belief.mean;
            let jacobian = self.config.filter.predict(belief, &process)?;
            belief.fade(self.config.fading);
            if most == Some(before) {
                transition = jacobian;
            }
            Ok(())
        });
        most.map(|mean| transition.unwrap_or_else(|| process.jacobian(&mean)))
    }

    /// The initial hypotheses with the logarithms of their weights, from the reading of a sample.
    fn anywhere(&self, touch: &Sample, contact_prior: Option<ContactPrior>) -> Vec<(Gaussian<N>, f64)> {
        let places = self.config.start.beliefs(&self.side, touch.reading_n_m, contact_prior);
        let parts = |(place, log_weight): &(Gaussian<2>, f64)| {
            let log_weight = *log_weight;
            self.motion.parts(place).into_iter().map(move |(belief, log_part)| (belief, log_weight + log_part))
        };
        places.iter().flat_map(parts).collect()
    }

    /// Hypotheses for a contact that has jumped to another place of the object, with the logarithms of their weights: at each place one
    /// with the prior of the object, that of a thin one such as a corner, and one for which everything but the place is as believed.
    fn elsewhere(&self, sample: &Sample, belief: &Gaussian<N>) -> Vec<(Gaussian<N>, f64)> {
        let places = self.config.start.coarser().beliefs(&self.side, sample.reading_n_m, None);
        let parts = |(place, log_weight): &(Gaussian<2>, f64)| {
            [self.motion.belief(place), moved_to(belief, place)].map(|part| (part, *log_weight))
        };
        places.iter().flat_map(parts).collect()
    }

    fn condition<Reading: Measurement<N, 1>>(
        &self,
        bank: &mut Bank<N>,
        reading: &Reading,
        z_n_m: f64,
    ) -> Result<Innovation<1>, UpdateError> {
        let (filter, z) = (&self.config.filter, Vector1::new(z_n_m));
        let innovation = bank.update(|belief| -> Result<Update<1>, UpdateError> {
            let update = robust::update(belief, reading, self.config.gate_sds, &z, |belief, reading, z| {
                filter.update(belief, reading, z)
            })?;
            Ok(Update { log_evidence: self.config.evidence_power * update.log_evidence, ..update })
        });
        bank.prune(self.config.prune_share);
        bank.merge(self.config.merge_loss);
        bank.map(|belief| self.side.hold(&mut belief.mean));
        innovation
    }

    /// Takes a sample and returns the moments of the whole mixture before and after its reading.
    pub(super) fn advance(&mut self, sample: &Sample) -> Option<Advance<N>> {
        self.advance_mean(sample, 1.0)
    }

    /// The same for the mean of `count` samples.
    pub(super) fn advance_mean(&mut self, sample: &Sample, count: f64) -> Option<Advance<N>> {
        self.base = sample.motion.inverse().then(&self.base);
        self.time_s += sample.dt_s;
        self.carry_left(sample);
        let returned = self.returned.take().map(|place| sample.motion.apply(place));
        let Some(mut bank) = self.bank.take() else {
            let bank = self.begin(sample);
            // If all hypotheses are lost later on, these samples are too old for a new start.
            self.history.clear();
            self.contact_prior = None;
            let belief = bank.moments()?;
            if let Some(most) = bank.most_probable().filter(|_| self.config.systematic.is_on()) {
                self.systematic.begin(&most.belief, &ContactReading::new(&self.side, Model::INDICES));
            }
            self.bank = Some(bank);
            return Some(Advance { predicted: belief, filtered: belief, innovation: None });
        };
        self.inertia.advance(sample);
        let transition = self.predict(&mut bank, sample);
        let predicted = bank.moments()?;
        let leading = bank.most_probable()?.belief;
        let at = AlongAway::of_state(&leading.mean);
        if self.config.corrected && self.has_passed(&leading, &predicted, sample, count) {
            self.systematic.wait(sample.dt_s);
            self.bank = Some(bank);
            return Some(Advance { predicted, filtered: predicted, innovation: None });
        }
        let inertia_n_m = self.inertia_n_m(at);
        let error_sd_n_m = self.error_sd_n_m(AlongAway::of_state(&predicted.mean), inertia_n_m);
        let reading = ContactReading::new(&self.side, Model::INDICES).with_error(error_sd_n_m).of_mean(count);
        let corrected = Sample { reading_n_m: sample.reading_n_m - inertia_n_m, ..*sample };
        let followed = transition.map(|transition| {
            let (z_n_m, gate_sds) = (corrected.reading_n_m, self.config.gate_sds);
            self.systematic.advance(sample.dt_s, &transition, &leading, &reading, z_n_m, gate_sds)
        });
        let innovation = self.condition(&mut bank, &reading, corrected.reading_n_m).ok();
        // Before the contact was certain to be on the side, a reading at the tip is no evidence about the object.
        let counts = self.was_on_side || !self.config.corrected || !self.side.is_tip(at);
        if counts {
            self.return_to(returned, &mut bank, &corrected, &reading);
            let mut left = std::mem::take(&mut self.left);
            self.go_back(&mut left, &mut bank, &corrected, &reading, innovation);
            self.left = left;
            if self.must_search(&bank, sample, innovation) {
                self.leave();
                bank.add(self.elsewhere(sample, &predicted), self.config.search.share);
            }
        }
        // The sensitivities are those of one hypothesis; those of another begin as at a touch.
        if let (Some(followed), Some(most)) = (followed, bank.most_probable())
            && !is_same_place(&followed, &most.belief.mean)
        {
            self.systematic.begin(&most.belief, &ContactReading::new(&self.side, Model::INDICES));
        }
        let filtered = bank.moments_above(self.config.ignored_share)?;
        self.bank = Some(bank);
        if counts {
            self.keep();
        }
        Some(Advance { predicted, filtered, innovation })
    }

    /// Whether the contact has reached the tip, so that the mean reading of `count` samples is left out.
    fn has_passed(&mut self, leading: &Gaussian<N>, predicted: &Gaussian<N>, sample: &Sample, count: f64) -> bool {
        let at = AlongAway::of_state(&leading.mean);
        if self.is_lost || self.is_past_tip {
            if !self.is_regained(leading, sample, count) {
                return true;
            }
            (self.is_lost, self.is_past_tip) = (false, false);
            (self.regained, self.doubt) = (Regained::default(), Doubt::default());
        }
        let length_m = self.side.face.rest.length_m();
        let mean = AlongAway::of_state(&predicted.mean);
        let (arc_m, sd_m) = (self.side.bent_arc_m(mean), predicted.covariance[(0, 0)].max(0.0).sqrt());
        if !self.side.is_tip(at) {
            self.was_on_side |= arc_m + SIDE_SDS * sd_m < length_m;
            return false;
        }
        // From here on the belief cannot follow, and a return that it predicts would be a wrong contact. After a release, without
        // deflection, the belief may drift beyond the end too.
        let is_loaded = sample.reading_n_m.abs() > LOADED_SDS * self.side.variance_n2_m2(at).sqrt();
        self.is_past_tip = self.was_on_side && is_loaded && mean.away_m > 0.0 && arc_m - TIP_SDS * sd_m >= length_m;
        self.regained = Regained::default();
        self.was_on_side
    }

    /// Whether a contact that was lost is where the belief predicts it, by the mean reading of `count` samples.
    fn is_regained(&mut self, belief: &Gaussian<N>, sample: &Sample, count: f64) -> bool {
        let at = AlongAway::of_state(&belief.mean);
        let reading = self.reading().with_error(self.error_sd_n_m(at, 0.0)).of_mean(count);
        let is_beside = self.side.is_beside(at);
        let residual =
            is_beside.then(|| residual(&reading, &belief.mean, &belief.covariance, sample.reading_n_m)).flatten();
        let innovation =
            residual.and_then(|(residual_n_m, variance)| Innovation::of(Vector1::new(residual_n_m), variance));
        let unknown = Unknown::new(&self.side, self.noise_sd_n_m.powi(2) / count);
        self.regained.next(sample.dt_s, sample.reading_n_m, innovation.as_ref(), &unknown)
    }

    /// Part of the reading that is caused by the inertia of the wire.
    fn inertia_n_m(&self, at: AlongAway) -> f64 {
        // Accelerations from noisy poses would be noisier than the effect is large.
        if self.config.corrected && self.side.base_noise.is_none() {
            self.inertia.moment_n_m(&self.side, at)
        } else {
            0.0
        }
    }

    /// Whether the innovations are larger than stated, so that hypotheses at other places are due. If the contact may then lie beyond
    /// the calibrated arc lengths near the tip (mean plus [`TIP_SDS`] standard deviations), it is taken to have slipped off the tip: no
    /// other place is searched until the next touch.
    fn must_search(&mut self, bank: &Bank<N>, sample: &Sample, innovation: Option<Innovation<1>>) -> bool {
        let Some(Innovation { nis, .. }) = innovation.filter(|_| self.config.search.is_on()) else { return false };
        if !self.doubt.next(&self.config.search, sample.dt_s, nis.min(self.config.gate_sds.powi(2))) {
            return false;
        }
        let Some(belief) = bank.moments_above(self.config.ignored_share) else { return false };
        let sd_m = belief.covariance[(0, 0)].max(0.0).sqrt();
        let reach_m = self.side.bent_arc_m(AlongAway::of_state(&belief.mean)) + TIP_SDS * sd_m;
        let slipping_m = self.side.face.domain.arc_range_m().1.max(NEAR_TIP_SHARE * self.side.face.rest.length_m());
        self.is_lost |= self.config.corrected && sd_m < SETTLED_SD_M && reach_m >= slipping_m;
        self.regained = Regained::default();
        !self.is_lost
    }

    /// Remembers the place of the contact from before the readings contradicted it, if it was known.
    fn leave(&mut self) {
        let Some(kept) = self.settled.as_ref().filter(|_| self.config.return_rate > 0.0) else { return };
        let Some(most) = kept.bank.most_probable() else { return };
        let mut belief = most.belief;
        if most.weight() < 0.5 || belief.covariance[(0, 0)] > LEFT_SD_M.powi(2) {
            return;
        }
        let process = self.motion.step(&self.side, &self.since(kept));
        if self.config.filter.predict(&mut belief, &process).is_err() {
            return;
        }
        self.left.retain(|left| !is_same_place(&left.belief.mean, &belief.mean));
        if self.left.len() == MOST_LEFT {
            self.left.remove(0);
        }
        self.left.push(Left { belief, odds: Odds::default() });
    }

    /// Propagates the places that the contact has left to a sample.
    fn carry_left(&mut self, sample: &Sample) {
        if self.left.is_empty() {
            return;
        }
        let (process, filter) = (self.motion.step(&self.side, sample), &self.config.filter);
        self.left.retain_mut(|left| filter.predict(&mut left.belief, &process).is_ok() && left.belief.is_finite());
    }

    /// Adds hypotheses at the place to which the contact may have returned, conditioned on the sample's reading.
    fn return_to(&self, place: Option<Point<Base>>, bank: &mut Bank<N>, sample: &Sample, reading: &ContactReading<'_>) {
        let Some(place) = place else { return };
        let mean = self.side.face.along_and_away(place).vector();
        let variances_m2 = Vector2::new(RETURNED_ALONG_SD_M, RETURNED_AWAY_SD_M).map(|sd_m| sd_m.powi(2));
        let place = Gaussian { mean, covariance: Matrix2::from_diagonal(&variances_m2) };
        let conditioned = |(there, log_weight)| {
            let (there, found) = self.conditioned(there, reading, sample.reading_n_m)?;
            Some((there, log_weight + self.log_evidence(&found)))
        };
        let parts: Vec<_> = self.motion.parts(&place).into_iter().filter_map(conditioned).collect();
        if !parts.is_empty() {
            bank.add(parts, RETURN_SHARE);
        }
    }

    /// The belief conditioned on a reading, with its innovation. `None` without a valid update.
    fn conditioned(
        &self,
        mut belief: Gaussian<N>,
        reading: &ContactReading<'_>,
        z_n_m: f64,
    ) -> Option<(Gaussian<N>, Innovation<1>)> {
        let found = self.config.filter.update(&mut belief, reading, &Vector1::new(z_n_m)).ok()?;
        self.side.hold(&mut belief.mean);
        belief.is_finite().then_some((belief, found))
    }

    /// Evidence of an innovation for a hypothesis, bounded at the gate.
    fn log_evidence(&self, found: &Innovation<1>) -> f64 {
        self.config.evidence_power * robust::log_likelihood(found, self.config.gate_sds)
    }

    /// Adds remembered places to which a return is more probable than none. The likelihood of a reading for a contact at the place,
    /// divided by that of the bank, is raised to `evidence_power`. The innovations of the bank alone detect a return late: where the
    /// base goes back the way that it came, the bank explains the readings by a displaced contact.
    fn go_back(
        &self,
        left: &mut [Left<N>],
        bank: &mut Bank<N>,
        sample: &Sample,
        reading: &ContactReading<'_>,
        innovation: Option<Innovation<1>>,
    ) {
        let Some(found) = innovation.filter(|_| self.jumps) else { return };
        let Some(most) = bank.most_probable().map(|most| most.belief) else { return };
        let of_bank = self.log_evidence(&found);
        for Left { belief, odds } in left {
            let conditioned = self.conditioned(*belief, reading, sample.reading_n_m);
            let Some((there, found)) = conditioned.filter(|_| !is_same_place(&belief.mean, &most.mean)) else {
                *odds = Odds::default();
                continue;
            };
            odds.advance(self.config.return_rate * sample.dt_s, (self.log_evidence(&found) - of_bank).exp());
            if odds.are_favourable() {
                bank.add([(there, 0.0)], RETURN_SHARE);
                *odds = Odds::default();
            }
        }
    }

    /// Predicts a further sample from a belief, whose covariance is used without propagation: the process noise of a block is small
    /// beside that of the reading.
    pub(super) fn look_ahead_from(&self, belief: &Gaussian<N>, sample: &Sample) -> Ahead {
        let moved = self.motion.step(&self.side, sample).predict(&belief.mean);
        let place = |x| self.side.face.contact_at(AlongAway::of_state(x));
        let slip_m = place(&moved).vector() - sample.motion.apply(place(&belief.mean)).vector();
        let at = AlongAway::of_state(&moved);
        let inertia_n_m = self.inertia_n_m(at);
        let reading = self.reading().with_error(self.error_sd_n_m(at, inertia_n_m));
        let residual = residual(&reading, &moved, &belief.covariance, sample.reading_n_m - inertia_n_m);
        Ahead { slip_m, nis: residual.map(|(residual_n_m, variance)| residual_n_m.powi(2) / variance.x) }
    }

    /// Standard deviation of the errors of a reading beside those of sensor and calibration: of its correction for inertia, and of
    /// the extrapolation of the sensor model.
    fn error_sd_n_m(&self, at: AlongAway, inertia_n_m: f64) -> f64 {
        let extrapolation_sd_n_m = if self.config.corrected { self.side.extrapolation_sd_n_m(at) } else { 0.0 };
        (INERTIA_SD * inertia_n_m).hypot(extrapolation_sd_n_m)
    }

    /// Whether the belief has no valid covariance, or one so large that the contact may be anywhere on the whisker and beyond.
    fn has_diverged(&self, belief: &Gaussian<N>) -> bool {
        let [along_m2, away_m2] = [0, 1].map(|i| belief.covariance[(i, i)]);
        let most_m2 = self.side.face.rest.length_m().powi(2);
        !(along_m2 > 0.0 && away_m2 > 0.0 && along_m2 + away_m2 < most_m2)
    }

    /// Whether the contact is at the tip or past it, so that there is no estimate.
    pub(super) fn is_at_tip(&self, belief: &Gaussian<N>) -> bool {
        self.config.corrected
            && (self.is_lost || self.is_past_tip || self.side.is_tip(AlongAway::of_state(&belief.mean)))
    }
}

/// Probability that a touch is one of the same object if the readings showed a contact with that object before it was detected.
const CONTINUED_SHARE: f64 = 0.99;

/// Residual of a reading for a contact (N m), and its variance (N2 m2) with the covariance of the contact. `None` without a prediction.
fn residual<const N: usize>(
    reading: &ContactReading<'_>,
    x: &SVector<f64, N>,
    covariance: &SMatrix<f64, N, N>,
    z_n_m: f64,
) -> Option<(f64, Matrix1<f64>)> {
    let (expected, h, noise) = reading.linearised_with_noise(x)?;
    Some((z_n_m - expected.x, product(&product(&h, covariance), &h.transpose()) + noise))
}

/// A place that the contact has left.
struct Left<const N: usize> {
    /// Belief of a contact there at the present pose of the base.
    belief: Gaussian<N>,
    /// Odds that the contact has returned.
    odds: Odds,
}

/// Largest number of places that are remembered.
const MOST_LEFT: usize = 4;

/// Largest standard deviation along the whisker of a place that is remembered.
const LEFT_SD_M: f64 = 1e-3;

/// Distance below which two places are the same.
const SAME_PLACE_M: f64 = 1e-3;

/// Standard deviations of a place to which the contact has returned, along the whisker and away from it.
const RETURNED_ALONG_SD_M: f64 = 1e-3;
const RETURNED_AWAY_SD_M: f64 = 0.2e-3;

/// Probability of a place to which the contact may have returned.
const RETURN_SHARE: f64 = 0.5;

/// A belief of which the contact is at another place.
fn moved_to<const N: usize>(belief: &Gaussian<N>, place: &Gaussian<2>) -> Gaussian<N> {
    let Gaussian { mut mean, mut covariance } = *belief;
    mean.fixed_rows_mut::<2>(0).copy_from(&place.mean);
    covariance.fixed_rows_mut::<2>(0).fill(0.0);
    covariance.fixed_columns_mut::<2>(0).fill(0.0);
    covariance.fixed_view_mut::<2, 2>(0, 0).copy_from(&place.covariance);
    Gaussian::new(mean, covariance)
}

/// Whether two states have their contacts at the same place.
fn is_same_place<const N: usize>(one: &SVector<f64, N>, other: &SVector<f64, N>) -> bool {
    AlongAway::of_state(one).vector().metric_distance(&AlongAway::of_state(other).vector()) < SAME_PLACE_M
}

/// Relative standard deviation of the moment by the wire's inertia.
const INERTIA_SD: f64 = 0.3;

/// Standard deviation along the whisker below which a contact counts as located, and the standard deviations within
/// which it may be at the tip.
const SETTLED_SD_M: f64 = 3e-3;
const TIP_SDS: f64 = 4.0;

/// Smallest arc length, relative to the whisker's length, from which a contact that the readings contradict has slipped off the tip.
const NEAR_TIP_SHARE: f64 = 0.9;

/// Distance of a contact from the whisker's end, in its standard deviations, above which it is certain to be on the side.
const SIDE_SDS: f64 = 3.0;

/// Smallest reading of a loaded whisker, in standard deviations of noise and model error.
const LOADED_SDS: f64 = 5.0;

/// A bank with the pose of the base and the time to which it belongs.
#[derive(Clone)]
struct Kept<const N: usize> {
    bank: Bank<N>,
    base: Pose<Base, FirstBase>,
    time_s: f64,
}

/// Time between two stored banks, within which a release is detected.
const SETTLING_S: f64 = 0.05;

/// Result of one step.
pub(super) struct Advance<const N: usize> {
    /// Prior: the belief before the reading.
    pub(super) predicted: Gaussian<N>,
    /// Posterior: the belief after the reading.
    pub(super) filtered: Gaussian<N>,
    pub(super) innovation: Option<Innovation<1>>,
}

impl<Filter: GaussianFilter, Model: Motion<N>, const N: usize> Tracker for Follower<Filter, Model, N> {
    fn step(&mut self, sample: &Sample) -> Option<Estimate> {
        self.step_mean(sample, 1.0)
    }

    fn assumes_motion(&self) -> bool {
        Model::OBJECT_MOVES
    }

    fn assumes_friction(&self) -> bool {
        Model::INDICES.friction.is_some()
    }

    fn look_ahead(&self, sample: &Sample) -> Ahead {
        self.stated.map_or_else(Ahead::default, |belief| self.look_ahead_from(&belief, sample))
    }

    fn step_mean(&mut self, sample: &Sample, count: f64) -> Option<Estimate> {
        self.stated = None;
        let Advance { filtered, innovation, .. } = self.advance_mean(sample, count)?;
        self.stated = Some(filtered);
        if self.is_at_tip(&filtered) || self.has_diverged(&filtered) {
            return None;
        }
        let estimate = self.side.estimate(self.motion.radius(), &filtered, innovation);
        Some(self.motion.place(&self.side, &filtered, estimate))
    }

    fn expect_jumps(&mut self, expected: bool) {
        self.jumps = expected;
    }

    fn expect_return(&mut self, place: Point<Base>) {
        self.returned = Some(place).filter(|_| self.jumps && self.config.return_rate > 0.0);
    }

    fn systematic_m2(&self) -> Option<Matrix2<f64>> {
        let settings = Some(&self.config.systematic).filter(|settings| settings.is_on())?;
        let jacobian = self.side.contact_jacobian(&self.bank.as_ref()?.most_probable()?.belief.mean);
        Some(jacobian * self.systematic.of_place_m2(settings) * jacobian.transpose())
    }

    /// The belief is one of before the release, as at a new touch.
    fn expect_touch(&mut self, undetected: &Undetected) -> Option<Estimate> {
        let kept = self.settled.as_ref().filter(|_| self.config.kept_share > 0.0 && !self.is_lost)?;
        let mut belief = kept.bank.most_probable().filter(|most| most.weight() >= 0.5)?.belief;
        let motion = kept.base.then(&undetected.base.inverse());
        let since = Sample { motion, dt_s: self.time_s - kept.time_s + undetected.free_s, reading_n_m: 0.0 };
        self.config.filter.predict(&mut belief, &self.motion.step(&self.side, &since)).ok()?;
        let sample = Sample { motion, dt_s: undetected.dt_s, reading_n_m: undetected.reading_n_m };
        if !belief.is_finite() || !self.is_regained(&belief, &sample, 1.0) {
            return None;
        }
        let estimate = self.side.estimate(self.motion.radius(), &belief, None);
        Some(self.motion.place(&self.side, &belief, estimate))
    }

    /// Keeps the belief of the object beside that of a new one; the readings decide. A contact that was lost at the tip has left
    /// the whisker's side, and the belief describes no object.
    fn resume(&mut self, touch: &Touch<'_>) -> bool {
        self.returned = None;
        self.continues = std::mem::take(&mut self.regained).is_there();
        if self.config.kept_share == 0.0 || self.is_lost || touch.face.face != self.side.face.face {
            return false;
        }
        self.bank = None;
        self.recent = None;
        let motion = self.base.then(&touch.before.inverse());
        self.carry_left(&Sample { motion, dt_s: touch.free_s, reading_n_m: 0.0 });
        self.left.iter_mut().for_each(|left| left.odds = Odds::default());
        self.time_s += touch.free_s;
        self.systematic.wait(touch.free_s);
        self.base = touch.before;
        self.history = touch.history.to_vec();
        self.contact_prior = touch.contact_prior;
        self.doubt = Doubt::default();
        // The belief kept from before the tip does describe the object.
        self.was_on_side = false;
        self.is_past_tip = false;
        self.inertia = Inertia::new(&self.side.whisker);
        true
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::elastica::{Circle, Elastica};
    use crate::estimators::extended::Extended;
    use crate::estimators::testing::knowledge;
    use crate::frames::{Point, World};
    use crate::sensor::Face;

    #[test]
    fn verif_a_contact_elsewhere_is_one_of_the_same_object_and_sensor() {
        let covariance = SMatrix::<f64, 4, 4>::from_fn(|i, j| if i == j { 2.0 } else { 0.5 });
        let belief = Gaussian::new(SVector::from([0.05, 1e-3, 4e-3, 0.7]), covariance);
        let place = Gaussian::new(Vector2::new(0.03, 2e-3), Matrix2::new(3.0, 0.1, 0.1, 4.0));
        let moved = moved_to(&belief, &place);
        assert_eq!(moved.mean, SVector::from([0.03, 2e-3, 4e-3, 0.7]));
        assert_eq!(moved.covariance.fixed_view::<2, 2>(0, 0), place.covariance);
        assert_eq!(moved.covariance.fixed_view::<2, 2>(2, 2), covariance.fixed_view::<2, 2>(2, 2));
        assert_eq!(moved.covariance.fixed_view::<2, 2>(0, 2), Matrix2::zeros());
        assert_eq!(moved.covariance.fixed_view::<2, 2>(2, 0), Matrix2::zeros());
    }

    /// The first touch of the left face.
    fn touch(knowledge: &Knowledge, before: Pose<Base, FirstBase>) -> Touch<'_> {
        Touch { face: &knowledge.faces[0], history: &[], free_s: 0.0, before, contact_prior: None, seed: 0 }
    }

    /// A follower of any round object.
    type AnyRound = Follower<Extended, Round, 4>;

    /// The follower at its first touch.
    fn begun(knowledge: &Knowledge) -> AnyRound {
        let touch = touch(knowledge, Pose::new(0.0, 0.0, 0.0));
        let motion = Round::of_any_scale().beyond_pin(touch.face);
        Follower::new(Config::<Extended>::round(), motion, &touch, knowledge)
    }

    /// A thin object that deflects the whisker at an arc length.
    fn thin(knowledge: &Knowledge, arc_m: f64) -> Circle {
        Circle { center: Point::from_vector(knowledge.rest.beside(arc_m, -4e-3).vector()), radius_m: 1e-4 }
    }

    /// A base that moves to and fro.
    fn base(i: usize) -> Pose<Base, World> {
        let t = i as f64 / 15.0;
        Pose::new(2e-3 * (t.cos() - 1.0), 1.5e-3 * t.sin(), 0.02 * (2.0 * t).sin())
    }

    fn noise_n_m(knowledge: &Knowledge, i: usize) -> f64 {
        knowledge.noise_sd_n_m * [0.6, -1.2, 0.1, 1.5, -0.4, -0.9, 1.0, -0.7][i % 8]
    }

    /// Errors of a contact that jumps from one thin object to another after 150 samples and back after 300. With `told`, the follower
    /// learns at the first jump where the contact has gone.
    fn errors_m(jumps: bool, told: bool) -> Vec<f64> {
        let knowledge = knowledge();
        let elastica = Elastica::new(&knowledge.whisker).unwrap();
        let (one, other) = (thin(&knowledge, 0.058), thin(&knowledge, 0.045));
        let mut follower = begun(&knowledge);
        if jumps {
            follower.expect_jumps(true);
        }
        let step = |i: usize| {
            let circle = if (150..300).contains(&i) { &other } else { &one };
            let exact = elastica.against(circle, &base(i), Face::Left).unwrap().unwrap().deflection;
            let motion = base(i.saturating_sub(1)).then(&base(i).inverse());
            let sample = Sample { motion, dt_s: 4e-3, reading_n_m: exact.moment_n_m + noise_n_m(&knowledge, i) };
            if told && i == 150 {
                follower.expect_return(motion.inverse().apply(exact.point));
            }
            follower.step(&sample).map_or(f64::INFINITY, |estimate| estimate.contact.distance(&exact.point))
        };
        (0..330).map(step).collect()
    }

    fn worst_m(errors_m: &[f64]) -> f64 {
        errors_m.iter().copied().fold(0.0, f64::max)
    }

    #[test]
    fn verif_a_place_of_which_the_follower_is_told_is_a_hypothesis_only_if_jumps_are_expected() {
        let [told, sought] = [true, false].map(|told| errors_m(true, told));
        assert_eq!(told[..150], sought[..150]);
        assert!(worst_m(&told[155..300]) < 0.5e-3, "{:?}", &told[150..170]);
        assert!(worst_m(&sought[155..300]) > 1e-3, "{:?}", &sought[150..170]);
        assert_eq!(errors_m(false, true), errors_m(false, false));
    }

    #[test]
    fn verif_a_return_to_a_place_that_was_left_is_found_within_a_few_samples() {
        let [found, sought] = [true, false].map(|jumps| errors_m(jumps, false));
        assert!(worst_m(&found[140..150]) < 0.2e-3, "{:?}", &found[140..150]);
        assert!(worst_m(&found[290..300]) < 0.2e-3, "{:?}", &found[290..300]);
        // The first jump leads to a place that is not known.
        assert_eq!(found[..300], sought[..300]);
        assert!(worst_m(&found[310..]) < 0.3e-3, "{:?}", &found[300..]);
        assert!(worst_m(&sought[310..]) > 1e-3, "{:?}", &sought[300..]);
    }

    /// Samples of a thin object on which the whisker slides while the base retreats by `way_m` along the whisker's tangent and
    /// returns. Beyond the tip the reading stays constant, as where the tip itself rests on an object.
    fn drawn_back(knowledge: &Knowledge, way_m: f64, count: usize) -> Vec<Sample> {
        let elastica = Elastica::new(&knowledge.whisker).unwrap();
        let thin = thin(knowledge, 0.062);
        let share = |i: usize| 1.0 - (2.0 * i as f64 / count as f64 - 1.0).abs();
        let back = -knowledge.rest.tangent(0.07);
        let base = |i: usize| -> Pose<Base, World> {
            let at = back * (way_m * share(i));
            Pose::new(at.x, at.y, 0.0)
        };
        let mut reading_n_m = 0.0;
        let mut sample = |i: usize| {
            if let Ok(Some(exact)) = elastica.against(&thin, &base(i), Face::Left) {
                reading_n_m = exact.deflection.moment_n_m;
            }
            Sample { motion: base(i.saturating_sub(1)).then(&base(i).inverse()), dt_s: 4e-3, reading_n_m }
        };
        (0..count).map(&mut sample).collect()
    }

    #[test]
    fn verif_past_the_tip_there_is_no_estimate_until_the_contact_is_on_the_side_again() {
        let knowledge = knowledge();
        let mut follower = begun(&knowledge);
        let samples = drawn_back(&knowledge, 40e-3, 400);
        let stated: Vec<bool> = samples.iter().map(|sample| follower.step(sample).is_some()).collect();
        assert!(stated[..80].iter().all(|&is| is), "{stated:?}");
        // The tip is reached after 84 samples; the base turns back after 200, and the contact is on the side again after 316.
        assert!(stated[100..316].iter().all(|&is| !is) && stated[330..].iter().all(|&is| is), "{stated:?}");
    }

    #[test]
    fn verif_past_the_tip_a_reading_that_contradicts_the_belief_gives_no_estimate_until_the_next_touch() {
        let knowledge = knowledge();
        let mut follower = begun(&knowledge);
        let samples = drawn_back(&knowledge, 40e-3, 400);
        // The tip rests on the object all the way back, with another reading than a contact on the side would have.
        let beyond_n_m = 0.5 * samples[200].reading_n_m;
        let held = |(i, sample): (usize, &Sample)| Sample {
            reading_n_m: if i < 200 { sample.reading_n_m } else { beyond_n_m },
            ..*sample
        };
        let stated: Vec<bool> =
            samples.iter().enumerate().map(|sample| follower.step(&held(sample)).is_some()).collect();
        let last = stated.iter().rposition(|&is| is).unwrap();
        assert!((80..100).contains(&last) && follower.is_past_tip, "{last}");
        // By then the belief predicts a contact on the side again.
        let belief = follower.bank.as_ref().unwrap().most_probable().unwrap().belief;
        assert!(!follower.side.is_tip(AlongAway::of_state(&belief.mean)));
        assert!(follower.resume(&touch(&knowledge, follower.base)) && !follower.is_past_tip);
        assert!(follower.step(&samples[0]).is_some());
    }

    /// A follower of the contact with a thin object at rest after 150 samples, and the contacts and readings at all samples.
    fn settled(knowledge: &Knowledge) -> (AnyRound, impl Fn(usize) -> (Point<Base>, f64)) {
        let (elastica, thin) = (Elastica::new(&knowledge.whisker).unwrap(), thin(knowledge, 0.058));
        let exact = move |i: usize| {
            let found = elastica.against(&thin, &base(i), Face::Left).unwrap().unwrap().deflection;
            (found.point, found.moment_n_m)
        };
        let mut follower = begun(knowledge);
        for i in 0..=150_usize {
            let motion = base(i.saturating_sub(1)).then(&base(i).inverse());
            follower.step(&Sample { motion, dt_s: 4e-3, reading_n_m: exact(i).1 });
        }
        (follower, exact)
    }

    /// The pose in the frame of the start, which is that of World here.
    fn in_start(pose: Pose<Base, World>) -> Pose<Base, FirstBase> {
        Pose::new(pose.origin().x(), pose.origin().y(), pose.yaw_rad())
    }

    #[test]
    fn verif_a_touch_of_the_known_object_is_expected_before_it_is_detected() {
        let knowledge = knowledge();
        let (mut follower, exact) = settled(&knowledge);
        let mut expected = |pose: Pose<Base, World>, free_s: f64, reading_n_m: f64| {
            follower.expect_touch(&Undetected { base: in_start(pose), free_s, dt_s: 4e-3, reading_n_m })
        };
        let noise_n_m = |i| noise_n_m(&knowledge, i);
        // The whisker is in front of the object, at a distance of a millimetre.
        let in_front = Pose::new(0.0, -5e-3, 0.0);
        assert!((0..50).all(|i| expected(in_front, 4e-3 * i as f64, noise_n_m(i)).is_none()));
        // The object is not there any more.
        assert!((0..50).all(|i| expected(base(i), 0.2, noise_n_m(i)).is_none()));
        let touches: Vec<_> =
            (151..180).map(|i| (expected(base(i), 0.4, exact(i).1 + noise_n_m(i)), exact(i).0)).collect();
        for (estimate, contact) in &touches[5..] {
            assert!(estimate.is_some_and(|estimate| estimate.contact.distance(contact) < 0.2e-3), "{estimate:?}");
        }
        assert!(expected(in_front, 0.6, 0.0).is_none());
    }

    #[test]
    fn verif_a_touch_that_was_expected_begins_with_the_known_object() {
        let knowledge = knowledge();
        let worst_m = |is_expected: bool| {
            let (mut follower, exact) = settled(&knowledge);
            for i in 151..160 {
                let reading_n_m = if is_expected { exact(i).1 } else { 0.0 };
                let free_s = 4e-3 * (i - 150) as f64;
                follower.expect_touch(&Undetected { base: in_start(base(i)), free_s, dt_s: 4e-3, reading_n_m });
            }
            let touch = Touch { free_s: 36e-3, ..touch(&knowledge, in_start(base(159))) };
            assert!(follower.resume(&touch));
            let motion = base(159).then(&base(160).inverse());
            let estimate = follower.step(&Sample { motion, dt_s: 4e-3, reading_n_m: exact(160).1 }).unwrap();
            estimate.covariance_m2.unwrap().trace().sqrt()
        };
        assert!(worst_m(true) < 0.3 * worst_m(false), "{} {}", worst_m(true), worst_m(false));
    }

    #[test]
    fn regress_a_contact_that_was_lost_is_regained_where_the_readings_agree_with_it() {
        let knowledge = knowledge();
        let (mut follower, exact) = settled(&knowledge);
        follower.is_lost = true;
        let mut step = |i: usize, reading_n_m: f64| {
            follower.step(&Sample { motion: base(i - 1).then(&base(i).inverse()), dt_s: 4e-3, reading_n_m })
        };
        assert!((151..200).all(|i| step(i, 0.0).is_none()));
        let regained: Vec<_> = (200..230).map(|i| (step(i, exact(i).1), exact(i).0)).collect();
        for (estimate, contact) in &regained[5..] {
            assert!(estimate.is_some_and(|estimate| estimate.contact.distance(contact) < 0.2e-3), "{estimate:?}");
        }
    }
}
