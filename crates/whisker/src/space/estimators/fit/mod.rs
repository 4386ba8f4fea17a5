//! Fits an object at rest to the readings of all touches.
//!
//! Without friction, the pose of the base and the object determine the contact, and with it the reading. The unknowns are those
//! of the contact at one reference pose, as in the filters of the same model of motion ([`super::motion`]); the object follows
//! from them, and so does the contact at every other pose. The fit minimises the squared residuals of all readings
//!
//! ```text
//! sum_k |z_k - h(p_k(x))|^2 / R_k + |x - x_0|^2 / P_0
//! ```
//!
//! by the Levenberg-Marquardt method. Readings at nearly the same pose are averaged. In contrast to a filter, nothing is
//! linearised about an early estimate, and the object has no process noise. The tilt of the normal by the inertia of the wire
//! is computed ([`super::ringing`]), and its unknown part is included in `R_k`.
//!
//! The first touch begins with a filter of a contact at rest. Its probable hypotheses, with the hypotheses of the model about the
//! object, are the modes of the fit, each with a search of its own and with a weight by Laplace's approximation of its evidence.
//! The work is divided among the samples. The unknown part of the tilt is none of the unknowns of the fit: it is filtered at the
//! present contact of each mode. If the contact is lost, or the innovations show that the whisker has slipped to another edge,
//! the fit begins anew with the later readings.
//!
//! At the next touch the fit goes on: an object at rest explains the readings of all touches. As the whisker may touch another
//! object, there is no estimate until the innovations have confirmed this one, and a few innovations suffice to give it up. If
//! they do neither for a second, there are estimates, with a covariance that includes the innovations.

mod readings;
mod search;

use filters::{Gaussian, Innovation};
use nalgebra::{Matrix3, SMatrix, SVector};
use serde::{Deserialize, Serialize};

use super::follower::{self, Follower, Tracker, Unrest};
use super::motion::{Fitted, Motion, MotionSettings, Object, Place, Resting, Shape, TILT, TILT_S, moved};
use super::ringing::Ringing;
use super::side::Side;
use super::{Estimate, Knowledge, Sample};
use crate::doubt::{DoubtSettings, Doubtful};
use crate::frames::{Base, Start};
use crate::settings::{Settings, SettingsError, within};
use crate::space::frames::Pose;
use crate::space::sensor::Around;
use readings::{Mean, Readings};
use search::{Evidence, MOST_TRIALS, Prior, START_TRIALS, Search};

/// Prior standard deviations of the contact's coordinates across the whisker.
const AWAY_SD_M: f64 = 5e-3;

/// Most hypotheses of the filter with which the fit begins, and their smallest weight relative to the heaviest.
const PLACES: usize = 2;
const PLACE_SHARE: f64 = 0.1;

/// Factor of the contact's distance from the undeflected whisker above which the reference pose is renewed: near the undeflected
/// whisker the direction of the force is uncertain.
const FARTHER: f64 = 1.5;

/// Largest squared distance of two modes, in their covariance, at which they are the same.
const SAME: f64 = 1.0;

/// Cost per mean, relative to its expectation, above which the readings contradict all modes and another start is searched.
const CONTRADICTED: f64 = 2.0;

/// Time after which a contradicted object is in doubt (s). While the means are few, a search from another start has ended by then.
const DOUBTED_S: f64 = 0.2;

/// Power of a mode's excess by which its stated covariance grows. Birge's factor is the first power, for independent errors; those
/// of a wrong model are not independent. Chosen on random scenes in space that are not reported.
const EXCESS_POWER: i32 = 3;

/// Largest cost of a mode found from another start, relative to the least cost of the others, at which it is accepted.
const BETTER: f64 = 0.5;

/// Expected cost of a mode after the next step of its search, beyond the least of the others, above which the search is given up.
const HOPELESS: f64 = 8.0;

/// Time between samples up to which the work of a step is the same, and that up to which it grows (s): after a gap, the estimate
/// shall not be late.
const STEP_S: f64 = 4e-3;
const LONGEST_STEP_S: f64 = 0.1;

/// Time without a contact after which the object is given up (s).
const LOST_S: f64 = 0.2;

/// Innovations of the modes that show that the whisker has slipped to another edge, so that the object is given up.
const SLIPPED: DoubtSettings = DoubtSettings { window_s: 0.5, most_nis: 12.5, nis: 8.0 };

/// Mean of the innovations with which a touch of a known object begins, and the one at which the object is confirmed.
const UNCONFIRMED_NIS: f64 = 7.0;
const CONFIRMED_NIS: f64 = 4.5;

/// Time after which an object that is not contradicted counts as confirmed (s).
const UNDECIDED_S: f64 = 1.0;

/// Time after the first readings of a fit (s) in which they do not count: the modes are still searched.
const SETTLED_S: f64 = 0.5;

/// Settings of a fit.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Config {
    /// Model of the contact's motion. A contact at rest is filtered, not fitted.
    pub(super) motion: MotionSettings,
    /// Number of initial hypotheses along the whisker.
    pub(super) hypotheses: usize,
    /// Time since the touch after which the fit begins.
    pub(super) start_s: f64,
    /// Largest number of modes at the start, and after the first searches.
    pub(super) modes: usize,
    pub(super) kept_modes: usize,
    /// Weight of a mode, relative to the heaviest, below which it is dropped.
    pub(super) prune_share: f64,
    /// Gate, in standard deviations: the residual of a mean beyond it counts by its logarithm.
    pub(super) gate_sds: f64,
    /// Evaluations of the whisker's geometry per sample after which the searches pause, which bound the time of a step but for the
    /// mean in progress. More in proportion if samples are more than 4 ms apart, so that a search takes the same time at low rates.
    pub(super) evaluations_per_step: usize,
    /// Standard deviation of the contact for deviations of the object from its model.
    pub(super) deviation_m: f64,
}

impl Config {
    /// Start and work of the searches were chosen on random scenes in space that are not reported.
    pub(super) fn new(motion: MotionSettings) -> Self {
        Self {
            motion,
            hypotheses: 8,
            start_s: 0.3,
            modes: 8,
            kept_modes: 3,
            prune_share: 1e-2,
            gate_sds: 5.0,
            evaluations_per_step: 52,
            deviation_m: 5e-6,
        }
    }
}

impl Config {
    /// Settings of the filter with which a touch begins.
    pub(super) fn filter(&self, motion: MotionSettings) -> follower::Config {
        follower::Config { hypotheses: self.hypotheses, ..follower::Config::new(motion) }
    }
}

impl Settings for Config {
    fn validate(&self) -> Result<(), SettingsError> {
        within("start_s", self.start_s, 0.0..=1e3)?;
        within("modes", self.modes as f64, 1.0..=100.0)?;
        within("kept_modes", self.kept_modes as f64, 1.0..=100.0)?;
        within("prune_share", self.prune_share, 0.0..=0.5)?;
        within("gate_sds", self.gate_sds, 1.0..=1e6)?;
        within("evaluations_per_step", self.evaluations_per_step as f64, 1.0..=1e5)?;
        within("deviation_m", self.deviation_m, 0.0..=0.1)?;
        self.filter(self.motion).validate()
    }
}

/// An object that explains the readings.
#[derive(Clone, Copy)]
struct Mode<Body, const N: usize> {
    /// Pose of the base that the state belongs to.
    reference: Pose<Base, Start>,
    prior: Prior<N>,
    about: Fitted<Body, N>,
    covariance: SMatrix<f64, N, N>,
    /// Cost per mean relative to its expectation, at least 1.
    excess: f64,
    log_weight: f64,
    /// The contact at the present instant, without tilt.
    near: Around,
    /// Mean (rad) and variance of the tilt at the present instant.
    tilt: (f64, f64),
    /// Angular frequency of the wire's oscillation along the object.
    oscillation_rad_s: f64,
}

/// Searches of all modes on the same means.
struct Round<Body, const N: usize> {
    means: Vec<Mean>,
    /// The mode whose search is in progress.
    mode: usize,
    search: Search<Body, N>,
    log_evidence: Vec<f64>,
    /// Smallest cost of a mode.
    least_cost: f64,
    /// Logarithm of the evidence of the readings since the means were taken.
    since: f64,
}

/// Follows the contacts with one object after another.
pub(super) struct Fitter<Model: Shape<N>, const N: usize> {
    config: Config,
    model: Model,
    side: Side,
    knowledge: Knowledge,
    /// The filter, until the first searches of all modes have ended.
    front: Option<Follower<Resting, 3>>,
    unrest: Unrest,
    ringing: Ringing,
    base: Pose<Base, Start>,
    elapsed_s: f64,
    readings: Readings,
    modes: Vec<Mode<Model::Object, N>>,
    /// The modes of the start, of which `next_start` is searched again if the readings contradict all others.
    starts: Vec<Mode<Model::Object, N>>,
    next_start: usize,
    round: Option<Round<Model::Object, N>>,
    /// Time since the last contact with the object.
    lost_s: f64,
    /// Whether the next reading is the first of a touch, or of a fit that begins anew.
    is_first: bool,
    /// Pose of the base at the last contact, while the whisker is free.
    released: Pose<Base, Start>,
    /// Time of contact before this touch.
    before_s: f64,
    /// Whether the object of earlier touches is touched again.
    earlier: Earlier,
    /// Whether the recent innovations contradict all modes.
    slipped: Doubtful,
    log_evidence: LogEvidence,
    /// Time since the first of the latest rounds in sequence whose readings contradict all modes. `None` if those of the last one
    /// do not.
    contradicted_s: Option<f64>,
}

/// Whether a touch is one of the object that was touched before.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Earlier {
    /// The readings of the touch do not decide yet.
    Unconfirmed,
    /// It is, or there was no earlier touch.
    Confirmed,
    /// Another object is touched.
    Contradicted,
}

/// Logarithm of the evidence of the model.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct LogEvidence {
    /// That of all modes in the last round. `None` before the first has ended.
    round: Option<f64>,
    /// That of the readings since the means of that round were taken.
    since: f64,
    /// That of the readings before the fit began anew. `None` if it never did.
    before: Option<f64>,
}

impl LogEvidence {
    /// That of all readings. A fit that began anew is one of two objects, one after the other, and has the evidence of both.
    fn total(&self) -> Option<f64> {
        match self.round {
            Some(round) => Some(self.before.unwrap_or(0.0) + round + self.since),
            None => self.before,
        }
    }

    /// That after a round, `since` whose means were taken the readings have another. If the round has none, that of the readings
    /// since the last one still counts.
    fn after(&self, round: Option<f64>, since: f64) -> Self {
        match round {
            Some(_) => Self { round, since, ..*self },
            None => *self,
        }
    }

    /// That of a fit which begins anew.
    fn anew(&self) -> Self {
        Self { before: self.total(), ..Self::default() }
    }
}

impl<Model: Motion<N> + Shape<N>, const N: usize> Fitter<Model, N> {
    pub(super) fn new(config: &Config, model: Model, knowledge: &Knowledge) -> Self {
        Self {
            config: *config,
            model,
            side: Side::new(knowledge),
            knowledge: knowledge.clone(),
            front: Some(Follower::new(&config.filter(MotionSettings::resting()), Resting::default(), knowledge)),
            unrest: Unrest::default(),
            ringing: Ringing::new(knowledge.calibrated.whisker.whisker.damping_s),
            base: Pose::identity(),
            elapsed_s: 0.0,
            readings: Readings::default(),
            modes: Vec::new(),
            starts: Vec::new(),
            next_start: 0,
            round: None,
            lost_s: 0.0,
            is_first: true,
            released: Pose::identity(),
            before_s: 0.0,
            earlier: Earlier::Confirmed,
            slipped: Doubtful::default(),
            log_evidence: LogEvidence::default(),
            contradicted_s: None,
        }
    }

    /// The fit of another object, or of another part of it, to the readings from now on.
    fn anew(&self) -> Self {
        let new = Self::new(&self.config, self.model, &self.knowledge);
        let likeliest = self.modes.iter().max_by(|a, b| a.log_weight.total_cmp(&b.log_weight));
        let near_m = likeliest.map(|mode| mode.near.along_m);
        let front = new.front.map(|front| front.slipped(near_m, self.unrest));
        Self { unrest: self.unrest, ringing: self.ringing, log_evidence: self.log_evidence.anew(), front, ..new }
    }

    /// Begins a touch of a known object: its contact is sought from the place of the last one.
    fn approach(&mut self) {
        let (rest, motion) = (self.side.rest(), self.released.then(&self.base.inverse()));
        for mode in self.modes.iter_mut().filter(|mode| !mode.is_new()) {
            mode.near = Around::of(rest, motion.apply(mode.near.contact(rest)));
            mode.tilt = (0.0, 0.0);
        }
    }

    /// The modes from the probable hypotheses of the filter.
    fn begin(&self, front: &Follower<Resting, 3>) -> Vec<Mode<Model::Object, N>> {
        let mut places: Vec<(Gaussian<3>, f64)> = front.hypotheses().collect();
        places.sort_by(|a, b| b.1.total_cmp(&a.1));
        let most = places.first().map_or(0.0, |(_, weight)| *weight);
        let probable = places.iter().filter(|(_, weight)| *weight >= PLACE_SHARE * most).take(PLACES);
        let beliefs =
            probable.flat_map(|(place, weight)| self.model.parts(place).into_iter().map(|part| (part, *weight)));
        let (low_m, high_m) = self.side.calibrated.domain.arc_range_m();
        let mode = |(belief, weight): (Gaussian<N>, f64)| {
            let (x, mut covariance) = (belief.mean, belief.covariance);
            covariance.row_mut(TILT).fill(0.0);
            covariance.column_mut(TILT).fill(0.0);
            let (mut mean, mut sd) = self.model.prior(&x);
            mean.fixed_rows_mut::<3>(0).copy_from(&x.fixed_rows::<3>(0));
            (sd[0], sd[1], sd[2], sd[TILT]) = ((high_m - low_m) / 12_f64.sqrt(), AWAY_SD_M, AWAY_SD_M, 1.0);
            Some(Mode {
                reference: self.base,
                prior: Prior { mean, sd },
                about: Fitted::new(&self.side, &self.model, &x)?,
                covariance,
                excess: 1.0,
                log_weight: weight.ln(),
                near: Around::of_state(&x),
                tilt: (0.0, 0.0),
                oscillation_rad_s: Place::new(&self.side, Around::of_state(&x))?.plane_rad_s(&self.side)?,
            })
        };
        beliefs.take(self.config.modes).filter_map(mode).collect()
    }

    /// Goes on with the searches, for a step of `dt_s`.
    fn search(&mut self, dt_s: f64) {
        if self.round.is_none() {
            self.round = self.search_of(0, f64::INFINITY).map(|search| Round {
                means: self.readings.means().to_vec(),
                mode: 0,
                search,
                log_evidence: vec![f64::NEG_INFINITY; self.modes.len()],
                least_cost: f64::INFINITY,
                since: 0.0,
            });
        }
        let gate_sds = self.config.gate_sds;
        let (mut work, most_work) = (0, self.most_work(dt_s));
        while work < most_work
            && let Some(round) = &mut self.round
        {
            let evidence = Evidence { side: &self.side, shape: &self.model, means: &round.means, gate_sds };
            if round.search.advance(&evidence, &mut work, most_work) {
                self.conclude();
            }
        }
    }

    /// Evaluations of the whisker's geometry in a step of `dt_s`.
    fn most_work(&self, dt_s: f64) -> usize {
        (self.config.evaluations_per_step as f64 * (dt_s.clamp(STEP_S, LONGEST_STEP_S) / STEP_S)).round() as usize
    }

    /// Takes the result of a search, and begins that of the next mode or weighs all modes.
    fn conclude(&mut self) {
        let Some(mut round) = self.round.take() else { return };
        let mode = &mut self.modes[round.mode];
        let is_new = mode.is_new();
        if (is_new || self.front.is_some())
            && let Some(near) = round.search.nearest(&round.means, &self.base, self.side.rest())
        {
            mode.near = near;
        }
        if let Some((about, quadratic)) = round.search.best()
            && let Some(covariance) = quadratic.covariance()
            && (!is_new || quadratic.cost < BETTER * round.least_cost)
        {
            (mode.about, mode.covariance) = (about, covariance);
            mode.excess = (quadratic.cost / round.means.len() as f64).max(1.0);
            round.log_evidence[round.mode] = quadratic.log_evidence(&mode.prior).unwrap_or(f64::NEG_INFINITY);
            round.least_cost = round.least_cost.min(quadratic.cost);
        }
        let next = round.mode + 1;
        if next == self.modes.len() {
            let evidence = self.weigh(&round.log_evidence, round.means.len());
            self.log_evidence = self.log_evidence.after(evidence, round.since);
            self.front = None;
            if round.least_cost > CONTRADICTED * round.means.len() as f64 {
                self.contradicted_s.get_or_insert(0.0);
                self.start_again();
            } else {
                self.contradicted_s = None;
            }
        } else {
            self.round =
                self.search_of(next, round.least_cost + HOPELESS).map(|search| Round { mode: next, search, ..round });
        }
    }

    /// Adds the next of the first starts to the modes: a search that began with few readings may have converged to an object that
    /// contradicts the later ones. The starts are used in reverse order. For spheres the largest radius then comes first, from
    /// which searches converge to any smaller radius.
    fn start_again(&mut self) {
        self.modes.retain(|mode| !mode.is_new());
        let start = self.starts[self.starts.len() - 1 - self.next_start];
        self.modes.push(Mode { log_weight: f64::NEG_INFINITY, ..start });
        self.next_start = (self.next_start + 1) % self.starts.len();
    }

    /// The search of a mode, given up above an expected cost unless the mode is new. `None` if its state is no contact.
    fn search_of(&self, mode: usize, most_cost: f64) -> Option<Search<Model::Object, N>> {
        let mode = self.modes.get(mode)?;
        let Mode { reference, prior, about, near, .. } = mode;
        // Until the first search has ended, the contact is known at the reference pose alone.
        let pose = if self.front.is_some() || mode.is_new() { *reference } else { self.base };
        let (trials, most_cost) = if mode.is_new() { (START_TRIALS, f64::INFINITY) } else { (MOST_TRIALS, most_cost) };
        Search::new((&self.side, &self.model), *reference, *prior, &about.x, (*near, pose), trials, most_cost)
    }

    /// Weights of the modes by their evidence from a number of means; improbable modes and duplicates are dropped. Returns the
    /// evidence of all modes; without any, the modes are kept.
    fn weigh(&mut self, log_evidence: &[f64], means: usize) -> Option<f64> {
        let most = log_evidence.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        if most == f64::NEG_INFINITY {
            return None;
        }
        for (mode, evidence) in self.modes.iter_mut().zip(log_evidence) {
            mode.log_weight = evidence - most;
        }
        self.modes.sort_by(|a, b| b.log_weight.total_cmp(&a.log_weight));
        let least = self.config.prune_share.ln();
        let model = self.model;
        let mut kept: Vec<Mode<Model::Object, N>> = Vec::new();
        for mode in std::mem::take(&mut self.modes) {
            let is_same = |other: &Mode<Model::Object, N>| {
                let mut x = mode.about.x;
                model.align(&mut x, &other.about.x);
                let away = x - other.about.x;
                let mut covariance = other.covariance;
                covariance[(TILT, TILT)] = 1.0;
                covariance.cholesky().is_some_and(|factor| away.dot(&factor.solve(&away)) < SAME)
            };
            if kept.len() < self.config.kept_modes
                && !mode.is_new()
                && mode.log_weight >= least
                && !kept.iter().any(is_same)
            {
                kept.push(mode);
            }
        }
        // The cost of a mean of two readings is 1 on average: without it, rounds with different numbers of means are comparable.
        let total: f64 = kept.iter().map(|mode| mode.log_weight.exp()).sum();
        self.modes = kept;
        for mode in &mut self.modes {
            mode.renew(&self.side, &self.model, &self.base);
        }
        Some(most + total.ln() + means as f64)
    }

    /// Belief about the present state of a mode, and the innovation of the reading, which the fit does not include yet.
    fn present(&self, mode: &mut Mode<Model::Object, N>, sample: &Sample) -> Option<(Gaussian<N>, Innovation<2>)> {
        let (side, model) = (&self.side, &self.model);
        let motion = mode.reference.then(&self.base.inverse());
        let object = mode.about.object(&motion);
        let found = mode.about.touched(side, model, (&object, &motion), mode.near, &mut 0)?;
        let place = found.0;
        mode.near = place.at;
        // The entries about the object hardly change from pose to pose.
        let mut slopes = SMatrix::<f64, N, N>::identity();
        let (of_contact, of_tilt, here) = mode.about.contact_slopes(model, &motion, &found);
        slopes.fixed_rows_mut::<3>(0).copy_from(&of_contact);
        slopes[(TILT, TILT)] = 0.0;
        // The readings of a contradicted object are scattered more than their covariance says (Birge, "The calculation of errors by
        // the method of least squares", Physical Review 40, 1932).
        let mut covariance = slopes * mode.covariance * slopes.transpose() * mode.excess;
        for i in 0..3 {
            covariance[(i, i)] += self.config.deviation_m.powi(2);
        }
        let mut by_tilt = SVector::<f64, N>::zeros();
        by_tilt.fixed_rows_mut::<3>(0).copy_from(&of_tilt);
        by_tilt[TILT] = 1.0;

        let contact = (&place, &found.1, &here);
        let inertial = mode.about.inertial_tilt(side, model, &motion, contact, &self.ringing.response());
        // The tilt is an Ornstein-Uhlenbeck process, of which the reading tells what the contact does not explain.
        let decay = (-sample.dt_s / TILT_S).exp();
        let variance = inertial.sd_rad().powi(2);
        let (tilt_rad, tilt_rad2) = (decay * mode.tilt.0, variance + decay.powi(2) * (mode.tilt.1 - variance));
        mode.oscillation_rad_s = place.oscillation_rad_s(side, &of_tilt);
        let state = model.state(&object, &place, &mode.about.x) + by_tilt * inertial.rad;
        let at = Around::of_state(&(state + by_tilt * tilt_rad));
        let expected = side.expect(at);
        let by_contact = expected.slopes;
        let by_reading = by_contact * by_tilt.fixed_rows::<3>(0);
        let of_contact: Matrix3<f64> = covariance.fixed_view::<3, 3>(0, 0).into_owned();
        let spread = by_contact * of_contact * by_contact.transpose()
            + by_reading * by_reading.transpose() * tilt_rad2
            + expected.covariance_n2_m2()
            + side.noise_of_mean_n2_m2(1.0);
        let innovation = Innovation::of(sample.reading_n_m - expected.reading_n_m, spread)?;
        let gain = spread.try_inverse()? * by_reading * tilt_rad2;
        let bounded = (self.config.gate_sds / innovation.nis.sqrt()).min(1.0);
        mode.tilt =
            (tilt_rad + gain.dot(&innovation.residual) * bounded, (tilt_rad2 * (1.0 - gain.dot(&by_reading))).max(0.0));
        covariance *= further_factor(mode.excess, self.slipped.mean_nis());
        covariance += by_tilt * by_tilt.transpose() * mode.tilt.1;
        Some((Gaussian::new(state + by_tilt * mode.tilt.0, covariance), innovation))
    }

    /// Evidence of a reading: the logarithm of its likelihood, `-nis / 2 - ln det S / 2` up to a constant, relative to the expected
    /// one under the covariance of a known contact, `-1 - ln det R / 2` up to the same constant.
    fn evidence_of(&self, innovation: &Innovation<2>, belief: &Gaussian<N>) -> f64 {
        let known = self.side.covariance_n2_m2(Around::of_state(&belief.mean));
        let spread = (innovation.covariance.determinant() / known.determinant()).ln();
        1.0 - 0.5 * innovation.nis.min(self.config.gate_sds.powi(2)) - 0.5 * spread
    }

    /// Adds the evidence of a reading.
    fn count(&mut self, evidence: f64) {
        self.log_evidence.since += evidence;
        if let Some(round) = &mut self.round {
            round.since += evidence;
        }
    }

    /// Takes the acceleration of the base.
    fn accelerate(&mut self, sample: &Sample) {
        self.unrest.advance(sample, 0.5 * self.side.rest().length_m());
        self.ringing.advance(sample);
    }

    /// Sets the frequency of the oscillation to that at the likeliest contact.
    fn tune(&mut self) {
        let rad_s = match &self.front {
            Some(front) => {
                let likeliest = front.hypotheses().max_by(|a, b| a.1.total_cmp(&b.1));
                let place = likeliest.and_then(|(belief, _)| Place::new(&self.side, Around::of_state(&belief.mean)));
                place.and_then(|place| place.plane_rad_s(&self.side))
            }
            // The modes are sorted by weight.
            None => self.modes.first().map(|mode| mode.oscillation_rad_s),
        };
        if let Some(rad_s) = rad_s {
            self.ringing.set_frequency(rad_s);
        }
    }

    /// The estimate of the modes.
    fn together(&mut self, sample: &Sample) -> Option<Estimate> {
        let mut modes = std::mem::take(&mut self.modes);
        let mut beliefs: Vec<(Gaussian<N>, Innovation<2>, f64)> = modes
            .iter_mut()
            .filter(|mode| !mode.is_new())
            .filter_map(|mode| {
                let (belief, innovation) = self.present(mode, sample)?;
                Some((belief, innovation, mode.log_weight.exp()))
            })
            .filter(|(belief, ..)| belief.is_finite())
            .collect();
        self.modes = modes;
        // After a gap, one failed search is not enough.
        self.lost_s = if beliefs.is_empty() { self.lost_s + sample.dt_s.min(0.25 * LOST_S) } else { 0.0 };
        if beliefs.is_empty() {
            // Without a contact there, the object explains no reading.
            self.count(1.0 - 0.5 * self.config.gate_sds.powi(2));
        }
        let (likeliest, ..) = *beliefs.iter().max_by(|a, b| a.2.total_cmp(&b.2))?;
        for (belief, ..) in &mut beliefs {
            self.model.align(&mut belief.mean, &likeliest.mean);
        }
        let innovation = Innovation::of_mixture(beliefs.iter().map(|(_, innovation, weight)| (*innovation, *weight)));
        self.slipped.advance(&SLIPPED, sample.dt_s, innovation);
        if let Some(innovation) = &innovation {
            self.count(self.evidence_of(innovation, &likeliest));
        }
        let belief = Gaussian::of_mixture(beliefs.into_iter().map(|(belief, _, weight)| (belief, weight)))?;
        let mut estimate = self.side.estimate(&belief, innovation)?;
        self.model.describe(&self.side, &belief, &mut estimate);
        Some(estimate)
    }
}

/// Factor of the stated covariance of a mode relative to that of its innovations, which contains the excess once. The recent mean
/// of the innovations includes those since the last round, which the excess does not.
fn further_factor(excess: f64, recent_nis: f64) -> f64 {
    (recent_nis / excess).max(1.0) * excess.powi(EXCESS_POWER - 1)
}

impl<Body: Object, const N: usize> Mode<Body, N> {
    /// Whether it was never weighed against the others.
    fn is_new(&self) -> bool {
        self.log_weight == f64::NEG_INFINITY
    }

    /// Refers the state to the present pose of the base if the whisker is deflected farther there.
    fn renew<Model: Shape<N, Object = Body>>(&mut self, side: &Side, model: &Model, base: &Pose<Base, Start>) {
        if self.near.away_m() < FARTHER * Around::of_state(&self.about.x).away_m() {
            return;
        }
        let motion = self.reference.then(&base.inverse());
        let Some((x, slopes)) = moved(side, model, &self.about.x, (&motion, 0.0), self.near) else { return };
        let Some(about) = Fitted::new(side, model, &x) else { return };
        (self.reference, self.about) = (*base, about);
        self.covariance = slopes * self.covariance * slopes.transpose();
        self.prior.mean.fixed_rows_mut::<3>(0).copy_from(&x.fixed_rows::<3>(0));
    }
}

impl<Model: Motion<N> + Shape<N>, const N: usize> Tracker for Fitter<Model, N> {
    fn step(&mut self, sample: &Sample) -> Option<Estimate> {
        self.base = sample.motion.inverse().then(&self.base);
        self.elapsed_s += sample.dt_s;
        self.accelerate(sample);
        let is_first = std::mem::replace(&mut self.is_first, false);
        if is_first {
            self.approach();
        }
        let estimate = match &mut self.front {
            Some(front) => front.step(sample),
            None => self.together(sample),
        };
        // The reading of the touch itself was detected by its size.
        if !is_first {
            let (acceleration2, response) = (self.unrest.second.trace(), self.ringing.response());
            self.readings.keep(Mean::new(self.base, sample.reading_n_m, sample.dt_s, acceleration2, response));
        }
        self.tune();
        match &self.front {
            Some(front) if self.modes.is_empty() => {
                if self.elapsed_s >= self.config.start_s {
                    self.modes = self.begin(front);
                    self.starts = self.modes.clone();
                }
            }
            _ => self.search(sample.dt_s),
        }
        let estimate = estimate.filter(|_| self.earlier != Earlier::Unconfirmed);
        self.contradicted_s = self.contradicted_s.map(|duration_s| duration_s + sample.dt_s);
        let is_doubtful = self.contradicted_s.is_some_and(|duration_s| duration_s > DOUBTED_S);
        let estimate = estimate.map(|estimate| Estimate { model_doubtful: Some(is_doubtful), ..estimate });
        let has_slipped = self.slipped.is_raised() && self.elapsed_s > self.config.start_s + SETTLED_S;
        let is_confirmed = self.slipped.mean_nis() < CONFIRMED_NIS || self.elapsed_s - self.before_s > UNDECIDED_S;
        if self.earlier == Earlier::Unconfirmed && is_confirmed {
            self.earlier = Earlier::Confirmed;
        }
        if self.is_fitted() && (has_slipped || self.lost_s >= LOST_S || self.modes.is_empty()) {
            let earlier = match self.earlier {
                Earlier::Unconfirmed => Earlier::Contradicted,
                earlier => earlier,
            };
            *self = Self { earlier, ..self.anew() };
        }
        estimate
    }

    fn release(&mut self, sample: &Sample) {
        let has_touched = !self.is_first;
        if has_touched && self.is_fitted() {
            (self.released, self.before_s) = (self.base, self.elapsed_s);
            self.readings.leave();
            // The evidence of an unfinished round would count as that of the next touch.
            self.round = None;
            (self.slipped, self.lost_s) = (Doubtful::starting_at(UNCONFIRMED_NIS), 0.0);
            (self.is_first, self.earlier) = (true, Earlier::Unconfirmed);
        }
        self.accelerate(sample);
        if self.is_fitted() {
            self.base = sample.motion.inverse().then(&self.base);
        } else if has_touched {
            self.forget();
        }
        if let Some(front) = &mut self.front {
            front.set_unrest(self.unrest);
        }
    }

    fn forget(&mut self) {
        *self =
            Self { unrest: self.unrest, ringing: self.ringing, ..Self::new(&self.config, self.model, &self.knowledge) };
        if let Some(front) = &mut self.front {
            front.set_unrest(self.unrest);
        }
    }

    fn is_another(&self) -> bool {
        self.earlier == Earlier::Contradicted
    }

    fn is_fitted(&self) -> bool {
        self.front.is_none()
    }

    fn log_evidence(&self) -> Option<f64> {
        self.log_evidence.total()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn verif_the_covariance_grows_with_the_third_power_of_the_excess_or_with_recent_innovations() {
        for (excess, recent_nis, factor) in [(1.0, 0.5, 1.0), (1.0, 3.0, 3.0), (4.0, 2.0, 64.0), (4.0, 8.0, 128.0)] {
            assert_eq!(excess * further_factor(excess, recent_nis), factor);
        }
    }

    #[test]
    fn regress_a_round_without_a_solution_keeps_the_evidence_since_the_last_one() {
        let first = LogEvidence::default().after(Some(-80.0), -2.0);
        assert_eq!(first.total(), Some(-82.0));
        let later = LogEvidence { since: -20.0, ..first };
        assert_eq!(later.after(None, -5.0).total(), Some(-100.0));
        assert_eq!(later.after(Some(-90.0), -5.0).total(), Some(-95.0));
    }

    #[test]
    fn regress_a_fit_that_begins_anew_keeps_the_evidence_of_the_readings_before() {
        let mut evidence = LogEvidence::default();
        assert_eq!(evidence.total(), None);
        (evidence.round, evidence.since) = (Some(-80.0), -20.0);
        let mut anew = evidence.anew();
        assert_eq!(anew.total(), Some(-100.0), "a model that lost the contact is not forgiven");
        (anew.round, anew.since) = (Some(-5.0), 1.0);
        assert_eq!(anew.total(), Some(-104.0));
        assert_eq!(anew.anew().total(), Some(-104.0));
    }
}
