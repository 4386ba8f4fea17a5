//! Common part of the filters with Gaussian hypotheses, which differ in prediction and update only.
//!
//! The settings are those of [`config`]. A contact may reach the tip ([`tip`]), jump to another place of the object and return
//! ([`places`]), and a touch may begin with the belief of the previous one ([`kept`]).

mod config;
mod kept;
mod places;
#[cfg(test)]
mod tests;
mod tip;

use std::fmt::Debug;
use std::sync::Arc;

use filters::{Bank, Gaussian, Innovation, Measurement, Process, Update, UpdateError, product, robust};
use nalgebra::{Matrix1, Matrix2, SMatrix, SVector, Vector1};
use serde::Serialize;
use serde::de::DeserializeOwned;
use serde_json::Value;

pub(super) use self::config::{Config, KEPT_SHARE, ONSET_WAY_M, without_motion};
use self::kept::Kept;
use self::places::{Left, MOST_LEFT, is_same_place};
use super::doubt::Doubt;
use super::inertia::Inertia;
use super::motion::{AnyMotion, Motion};
use super::side::{ContactReading, Side};
use super::start::{Earlier, EarlierReading, earlier, is_free};
use super::systematic::Systematic;
use super::{Ahead, ContactPrior, Estimate, Knowledge, Method, Sample, Touch, Tracker, Undetected};
use crate::frames::{Base, Point, Pose, Start};
use crate::odds::Odds;
use crate::regained::Regained;
use crate::sensor::AlongAway;
use crate::settings::{SettingsError, parse};

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

/// Probability that a touch is one of the same object if the readings showed a contact with that object before it was detected.
const CONTINUED_SHARE: f64 = 0.99;

/// Smallest probability of a hypothesis that is split ([`Motion::departure`]).
const LEAST_DEPARTING: f64 = 0.01;

/// Number of hypotheses at or above which none is split. A touch may begin with more.
const MOST_DEPARTING: usize = 64;

/// Relative standard deviation of the moment by the wire's inertia.
const INERTIA_SD: f64 = 0.3;

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
    base: Pose<Base, Start>,
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
    /// Magnitude of the expected reading from which the next [`Motion::rise`] counts. 0 before the first reading of a touch.
    reached_n_m: f64,
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
            reached_n_m: 0.0,
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

    /// Propagates a bank to a sample. Returns the Jacobian of the process at the most probable hypothesis, `None` without
    /// systematic errors.
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
            self.depart(&mut bank);
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

    /// Adds the hypotheses of the motion that begin as the expected reading increases.
    fn depart(&mut self, bank: &mut Bank<N>) {
        let (Some(rise), Some(most)) = (self.motion.rise(), bank.most_probable()) else { return };
        let expected_n_m = self.side.reading_n_m(AlongAway::of_state(&most.belief.mean)).abs();
        if expected_n_m < self.reached_n_m * (1.0 + rise) {
            return;
        }
        let reached_n_m = std::mem::replace(&mut self.reached_n_m, expected_n_m);
        if reached_n_m > 0.0 {
            let step = (expected_n_m / reached_n_m).ln();
            bank.split(LEAST_DEPARTING, MOST_DEPARTING, |belief| self.motion.departure(&self.side, belief, step));
        }
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
}

impl<Filter: GaussianFilter, Model: Motion<N>, const N: usize> Tracker for Follower<Filter, Model, N> {
    fn step(&mut self, sample: &Sample) -> Option<Estimate> {
        self.step_mean(sample, 1.0)
    }

    fn hypotheses(&self) -> usize {
        self.bank.as_ref().map_or(1, |bank| bank.hypotheses().len())
    }

    fn assumes_motion(&self) -> bool {
        Model::OBJECT_MOVES
    }

    fn assumes_friction(&self) -> bool {
        Model::INDICES.friction.is_some()
    }

    fn look_ahead(&self, sample: &Sample) -> Ahead {
        let most = self.bank.as_ref().and_then(Bank::most_probable).map(|most| most.belief);
        // The mean of a mixture of objects that slide and objects that rest does neither.
        let belief = self.stated.and_then(|stated| if self.motion.rise().is_some() { most } else { Some(stated) });
        belief.map_or_else(Ahead::default, |belief| self.look_ahead_from(&belief, sample))
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
        // The next touch may be one of another object, or at another place.
        self.reached_n_m = 0.0;
        self.inertia = Inertia::new(&self.side.whisker);
        true
    }
}

/// Result of one step.
pub(super) struct Advance<const N: usize> {
    /// Prior: the belief before the reading.
    pub(super) predicted: Gaussian<N>,
    /// Posterior: the belief after the reading.
    pub(super) filtered: Gaussian<N>,
    pub(super) innovation: Option<Innovation<1>>,
}

/// Residual of a reading for a contact (N m), and its variance (N2 m2) with the covariance of the contact. `None` without a
/// prediction.
fn residual<const N: usize>(
    reading: &ContactReading<'_>,
    x: &SVector<f64, N>,
    covariance: &SMatrix<f64, N, N>,
    z_n_m: f64,
) -> Option<(f64, Matrix1<f64>)> {
    let (expected, h, noise) = reading.linearised_with_noise(x)?;
    Some((z_n_m - expected.x, product(&product(&h, covariance), &h.transpose()) + noise))
}
