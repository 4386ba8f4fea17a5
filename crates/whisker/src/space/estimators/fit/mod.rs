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
//! by the Levenberg-Marquardt method. Readings at nearly the same pose are averaged. If the calibration states a
//! correlation length of the model's errors, the residuals are the changes from mean to mean ([`correlated`]). In contrast to a
//! filter, nothing is linearised about an early estimate, and the object has no process noise. The tilt of the normal by the
//! inertia and the damping of the wire is computed ([`super::ringing`]), and its unknown part is included in `R_k`.
//!
//! The first touch begins with a filter of a contact at rest. Its probable hypotheses, with the hypotheses of the model about the
//! object, are the modes of the fit, each with a search of its own and with a weight by Laplace's approximation of its evidence.
//! The work is divided among the samples. The unknown part of the tilt is not an unknown of the fit: it is filtered at the
//! present contact of each mode. If the contact is lost, or the innovations show that the whisker has slipped to another edge,
//! the fit begins anew with the later readings. When the new fit has settled, the earlier ones are joined to them if one object
//! explains both ([`forerunner`]).
//!
//! At the next touch the fit goes on: an object at rest explains the readings of all touches. As the whisker may touch another
//! object, there is no estimate until the innovations have confirmed this one, and a few innovations suffice to give it up. If
//! they do neither for a second, there are estimates, with a covariance that includes the innovations.
//!
//! The fit ([`Fitter`]) keeps [`readings`], from which searches ([`search`]) find its modes ([`mode`]). The modes state the present
//! contact ([`present`]) and the evidence of the model ([`evidence`]). In hindsight, they state the contact at every sample of a
//! touch ([`memory`]). While the readings contradict the object, a second fit is made to the later readings ([`successor`]).

mod config;
mod correlated;
mod evidence;
mod forerunner;
mod memory;
mod mode;
mod present;
mod readings;
mod search;
mod successor;

use filters::Gaussian;

pub(super) use self::config::Config;
use self::evidence::LogEvidence;
use self::forerunner::{Forerunner, Joining};
use self::memory::Memory;
use self::mode::Mode;
use self::readings::{Mean, Readings};
use self::search::{Evidence, MOST_TRIALS, Prior, START_TRIALS, Search};
use self::successor::Successor;
use super::follower::{Follower, Tracker, Unrest};
use super::motion::{Fitted, Motion, MotionSettings, Place, Resting, Shape, Swing, SwingTilt, TILT};
use super::ringing::Ringing;
use super::side::Side;
use super::{Estimate, Knowledge, Sample};
use crate::doubt::Doubtful;
use crate::frames::{Base, Start};
use crate::regained::Regained;
use crate::space::frames::Pose;
use crate::space::sensor::Around;

/// Prior standard deviations of the contact's coordinates across the whisker.
const AWAY_SD_M: f64 = 5e-3;

/// Most hypotheses of the filter with which the fit begins, and their smallest weight relative to the heaviest.
const PLACES: usize = 2;
const PLACE_SHARE: f64 = 0.1;

/// Largest squared distance of two modes, in their covariance, at which they are the same.
const SAME: f64 = 1.0;

/// Cost per mean, relative to its expectation, above which the readings contradict all modes and another start is searched.
const CONTRADICTED: f64 = 2.0;

/// Standard deviation of the contact along the whisker, at the reference pose of the likeliest mode, below which the readings
/// determine it. Chosen on random scenes in space that are not reported.
const DETERMINED_M: f64 = 3e-3;

/// Time after which a contradicted object is in doubt (s). While the means are few, a search from another start has ended by then.
const DOUBTED_S: f64 = 0.2;

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

/// Mean of the innovations with which a touch of a known object begins, and the one at which the object is confirmed.
const UNCONFIRMED_NIS: f64 = 7.0;
const CONFIRMED_NIS: f64 = 4.5;

/// Time after which an object that is not contradicted counts as confirmed (s).
const UNDECIDED_S: f64 = 1.0;

/// Time after the first readings of a fit (s) in which they do not count: the modes are still searched.
const SETTLED_S: f64 = 0.5;

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
    /// The fit that ended when this one began anew, until it is known whether one object explains the readings of both, and the
    /// search that decides it.
    forerunner: Option<Forerunner>,
    joining: Option<Joining<Model::Object, N>>,
    /// Time since the last contact with the object.
    lost_s: f64,
    /// Whether the next reading is the first of a touch, or of a fit that begins anew.
    is_first: bool,
    /// Pose of the base to which the contacts of the modes were carried last, while the whisker is free.
    released: Pose<Base, Start>,
    /// Time of contact before this touch.
    before_s: f64,
    /// Whether the object of earlier touches is touched again.
    earlier: Earlier,
    /// Odds that the whisker touches the object although no contact is detected; those at the last sample before the touch.
    regained: Regained,
    /// Whether the recent innovations contradict all modes.
    slipped: Doubtful,
    log_evidence: LogEvidence,
    /// Time since the first of the latest rounds in sequence whose readings contradict all modes. `None` if those of the last one
    /// do not.
    contradicted_s: Option<f64>,
    /// Samples of the present touch. `None` if they are not kept.
    memory: Option<Memory>,
    /// Fit to the later readings, while the readings contradict this one.
    successor: Option<Successor<Model, N>>,
    /// Smallest excess, at the last sample, of the compared models whose object explains all readings. Infinite if there is none.
    least_excess: f64,
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
            forerunner: None,
            joining: None,
            lost_s: 0.0,
            is_first: true,
            released: Pose::identity(),
            before_s: 0.0,
            earlier: Earlier::Confirmed,
            regained: Regained::default(),
            slipped: Doubtful::default(),
            log_evidence: LogEvidence::default(),
            contradicted_s: None,
            memory: None,
            successor: None,
            least_excess: f64::INFINITY,
        }
    }

    /// The fit of another object, or of another part of it, to the readings from now on.
    fn anew(&self) -> Self {
        let new = Self::new(&self.config, self.model, &self.knowledge);
        let likeliest = self.modes.iter().max_by(|a, b| a.log_weight.total_cmp(&b.log_weight));
        let near_m = likeliest.map(|mode| mode.near.along_m);
        let front = new.front.map(|front| front.slipped(near_m, self.unrest));
        let (forerunner, log_evidence) = (self.forerunner(), self.log_evidence.anew());
        Self { unrest: self.unrest, ringing: self.ringing, forerunner, log_evidence, front, ..new }
    }

    /// Start of this fit seen from that of a fit that begins anew, which is the present Base.
    fn start_anew(&self) -> Pose<Start, Start> {
        self.base.inverse().then(&Pose::identity())
    }

    /// Begins a touch of a known object: its contact is sought from that of the last sample. The motions of the wire go on only if
    /// the contact was expected.
    fn approach(&mut self) {
        if !self.regained.is_there() {
            self.calm();
        }
        self.carry();
    }

    /// Carries the contacts of the modes to the present pose of the base, as if they were at rest.
    fn carry(&mut self) {
        let (axis, motion) = (self.side.axis(), self.released.then(&self.base.inverse()));
        for mode in self.modes.iter_mut().filter(|mode| !mode.is_new()) {
            mode.near = Around::of(axis, motion.apply(mode.near.contact(axis)));
        }
        self.released = self.base;
    }

    /// Ends the motions of the wire at the contacts of the modes.
    fn calm(&mut self) {
        for mode in self.modes.iter_mut().filter(|mode| !mode.is_new()) {
            (mode.tilt, mode.swing) = ((0.0, 0.0), Swing::default());
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
        let mode = |(belief, weight): (Gaussian<N>, f64)| {
            let (x, mut covariance) = (belief.mean, belief.covariance);
            covariance.row_mut(TILT).fill(0.0);
            covariance.column_mut(TILT).fill(0.0);
            let (mut mean, mut sd) = self.model.prior(&x);
            mean.fixed_rows_mut::<3>(0).copy_from(&x.fixed_rows::<3>(0));
            (sd[0], sd[1], sd[2], sd[TILT]) = (self.side.along_sd_m(), AWAY_SD_M, AWAY_SD_M, 1.0);
            Some(Mode {
                reference: self.base,
                prior: Prior { mean, sd },
                about: Fitted::new(&self.side, &self.model, &x)?,
                covariance,
                excess: 1.0,
                log_weight: weight.ln(),
                near: Around::of_state(&x),
                tilt: (0.0, 0.0),
                swing: Swing::default(),
                oscillation_rad_s: Place::new(&self.side, Around::of_state(&x))?.plane_rad_s(&self.side)?,
            })
        };
        beliefs.take(self.config.modes).filter_map(mode).collect()
    }

    /// Goes on with the searches, for a step of `dt_s`.
    fn search(&mut self, dt_s: f64) {
        if self.round.is_none() && self.joining.is_none() {
            self.begin_joining();
        }
        let (mut work, most_work) = (0, self.most_work(dt_s));
        self.join(&mut work, most_work);
        if self.round.is_none() && self.joining.is_none() {
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
            && let Some(near) = round.search.nearest(&round.means, &self.base, self.side.axis())
        {
            mode.near = near;
        }
        if let Some((about, quadratic)) = round.search.best()
            && let Some(covariance) = quadratic.covariance()
            && (!is_new || quadratic.cost < BETTER * round.least_cost)
        {
            (mode.about, mode.covariance) = (about, covariance);
            mode.swing.change_object();
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
                self.log_evidence = self.log_evidence.consistent();
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

    /// Whether the first searches have ended, so that the estimates are those of the fitted object.
    fn is_fitted(&self) -> bool {
        self.front.is_none()
    }

    /// Whether enough readings count for the search of the modes to have ended.
    fn has_settled(&self) -> bool {
        self.elapsed_s > self.config.start_s + SETTLED_S
    }

    /// Whether the readings have contradicted all modes for more than [`DOUBTED_S`].
    fn is_contradicted(&self) -> bool {
        self.contradicted_s.is_some_and(|duration_s| duration_s > DOUBTED_S)
    }

    /// Takes the acceleration of the base.
    fn accelerate(&mut self, sample: &Sample) {
        self.unrest.advance(sample, 0.5 * self.side.length_m());
        self.ringing.advance(sample);
    }

    /// Tilt by the swing along the likeliest object.
    fn swing(&self) -> SwingTilt {
        // The modes are sorted by weight.
        self.modes.first().map(|mode| mode.swing.tilt()).unwrap_or_default()
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
        // A contact that sticks does not oscillate.
        if let Some(rad_s) = rad_s.filter(|rad_s| rad_s.is_finite()) {
            self.ringing.set_frequency(rad_s);
        }
    }

    /// Takes one sample of a touch; see [`Tracker::step`].
    fn advance(&mut self, sample: &Sample) -> Option<Estimate> {
        self.base = sample.motion.inverse().then(&self.base);
        self.elapsed_s += sample.dt_s;
        self.accelerate(sample);
        self.keep(sample);
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
            let reading = Mean::new(self.base, sample.reading_n_m, sample.dt_s, acceleration2, response);
            self.readings.keep(reading.with(self.swing()));
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
        // The readings may still show that it is another object.
        let estimate = estimate.filter(|_| self.earlier != Earlier::Unconfirmed || self.regained.is_there());
        self.contradicted_s = self.contradicted_s.map(|duration_s| duration_s + sample.dt_s);
        let model_doubtful = Some(self.is_contradicted());
        let estimate = estimate.map(|estimate| Estimate { model_doubtful, ..estimate });
        let has_slipped = self.slipped.is_raised() && self.has_settled();
        let is_confirmed = self.slipped.mean_nis() < CONFIRMED_NIS || self.elapsed_s - self.before_s > UNDECIDED_S;
        if self.earlier == Earlier::Unconfirmed && is_confirmed {
            self.earlier = Earlier::Confirmed;
        }
        if self.is_fitted() && (has_slipped || self.lost_s >= LOST_S || self.modes.is_empty()) {
            let earlier = match self.earlier {
                Earlier::Unconfirmed => Earlier::Contradicted,
                earlier => earlier,
            };
            let memory = self.handed_over(self.earlier == Earlier::Unconfirmed);
            *self = Self { earlier, memory, ..self.anew() };
        }
        estimate
    }
}

impl<Model: Motion<N> + Shape<N>, const N: usize> Tracker for Fitter<Model, N> {
    fn step(&mut self, sample: &Sample) -> Option<Estimate> {
        let estimate = self.advance(sample);
        self.succeed(sample, estimate)
    }

    fn release(&mut self, sample: &Sample) {
        let has_touched = !self.is_first;
        self.successor = None;
        if has_touched && self.is_fitted() {
            (self.released, self.before_s) = (self.base, self.elapsed_s);
            self.readings.leave();
            // The evidence of an unfinished round would count as that of the next touch.
            (self.round, self.joining) = (None, None);
            (self.slipped, self.lost_s) = (Doubtful::starting_at(UNCONFIRMED_NIS), 0.0);
            (self.is_first, self.earlier) = (true, Earlier::Unconfirmed);
            self.regained = Regained::default();
            self.calm();
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

    fn expect_touch(&mut self, sample: &Sample) -> Option<Estimate> {
        self.expected(sample)
    }

    fn forget(&mut self) {
        let memory = self.handed_over(true);
        let new = Self::new(&self.config, self.model, &self.knowledge);
        *self = Self { unrest: self.unrest, ringing: self.ringing, memory, ..new };
        if let Some(front) = &mut self.front {
            front.set_unrest(self.unrest);
        }
    }

    fn remember(&mut self) {
        self.memory.get_or_insert_default();
    }

    fn hindsight(&mut self) -> Option<Vec<Option<Estimate>>> {
        self.revised()
    }

    fn is_another(&self) -> bool {
        self.earlier == Earlier::Contradicted
    }

    fn is_determined(&self) -> bool {
        // The modes are sorted by weight.
        let likeliest = self.modes.first().filter(|_| self.is_fitted());
        likeliest.is_some_and(|mode| mode.covariance[(0, 0)] < DETERMINED_M.powi(2))
    }

    fn log_evidence(&self) -> Option<f64> {
        self.log_evidence.total()
    }

    fn excess(&self) -> Option<f64> {
        // The modes are sorted by weight.
        self.modes.first().filter(|_| self.is_fitted()).map(|mode| mode.excess)
    }

    fn has_begun_anew(&self) -> bool {
        self.log_evidence.is_anew()
    }

    fn compare(&mut self, least_excess: f64) {
        self.least_excess = least_excess;
    }
}
