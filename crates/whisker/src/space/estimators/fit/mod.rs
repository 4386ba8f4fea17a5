//! Fits an object at rest to all readings of a touch.
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
//! linearised about an early estimate, and the object has no process noise. The lag and the ringing of the wire along the
//! surface are part of `R_k`.
//!
//! A touch begins with the filter of the same model. Its probable hypotheses are the modes of the fit, each with a search of its
//! own and with a weight by Laplace's approximation of its evidence. The work is divided among the samples.

mod readings;
mod search;

use filters::{Gaussian, Innovation};
use nalgebra::{SMatrix, SVector};
use serde::{Deserialize, Serialize};

use super::follower::{self, Follower, Tracker, Unrest};
use super::motion::{Motion, MotionSettings, Neighbours, Shape, TILT};
use super::side::Side;
use super::{Estimate, Knowledge, Sample};
use crate::frames::{Base, Start};
use crate::settings::{Settings, SettingsError, within};
use crate::space::frames::Pose;
use crate::space::sensor::Around;
use readings::{Mean, Readings};
use search::{Evidence, Prior, Search};

/// Prior standard deviations of the contact's coordinates across the whisker.
const AWAY_SD_M: f64 = 5e-3;

/// Largest squared distance of two modes, in their covariance, at which they are the same.
const SAME: f64 = 1.0;

/// Consecutive samples without a contact after which the object is given up.
const LOST: usize = 25;

/// Settings of a fit.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub(super) struct Config {
    /// Filter with which a touch begins, and model of the contact's motion.
    pub(super) filter: follower::Config,
    /// Time since the touch after which the fit begins.
    pub(super) start_s: f64,
    /// Largest number of modes.
    pub(super) modes: usize,
    /// Weight of a mode, relative to the heaviest, below which it is dropped.
    pub(super) prune_share: f64,
    /// Gate, in standard deviations: the residual of a mean beyond it counts by its logarithm.
    pub(super) gate_sds: f64,
    /// Means that are evaluated per sample, which bounds the time of a step.
    pub(super) means_per_step: usize,
    /// Standard deviation of the contact for deviations of the object from its model.
    pub(super) deviation_m: f64,
}

impl Default for Config {
    fn default() -> Self {
        Self::new(MotionSettings::line())
    }
}

impl Config {
    pub(super) fn new(motion: MotionSettings) -> Self {
        Self {
            filter: follower::Config::new(motion),
            start_s: 0.4,
            modes: 4,
            prune_share: 1e-3,
            gate_sds: 5.0,
            means_per_step: 6,
            deviation_m: 5e-6,
        }
    }
}

impl Settings for Config {
    fn validate(&self) -> Result<(), SettingsError> {
        within("start_s", self.start_s, 0.0..=1e3)?;
        within("modes", self.modes as f64, 1.0..=100.0)?;
        within("prune_share", self.prune_share, 0.0..=0.5)?;
        within("gate_sds", self.gate_sds, 1.0..=1e6)?;
        within("means_per_step", self.means_per_step as f64, 1.0..=1e4)?;
        within("deviation_m", self.deviation_m, 0.0..=0.1)?;
        self.filter.validate()
    }
}

/// An object that explains the readings.
struct Mode<const N: usize> {
    /// Pose of the base that the state belongs to.
    reference: Pose<Base, Start>,
    prior: Prior<N>,
    about: Neighbours<N>,
    covariance: SMatrix<f64, N, N>,
    log_weight: f64,
    /// The contact at the present instant.
    near: Around,
}

/// Searches of all modes on the same means.
struct Round<const N: usize> {
    means: Vec<Mean>,
    /// The mode whose search is in progress.
    mode: usize,
    search: Search<N>,
    log_evidence: Vec<f64>,
}

/// Follows one contact.
pub(super) struct Fitter<Model, const N: usize> {
    config: Config,
    model: Model,
    side: Side,
    knowledge: Knowledge,
    /// The filter, until the fit begins.
    front: Option<Follower<Model, N>>,
    unrest: Unrest,
    base: Pose<Base, Start>,
    elapsed_s: f64,
    readings: Readings,
    modes: Vec<Mode<N>>,
    round: Option<Round<N>>,
    lost: usize,
}

impl<Model: Motion<N> + Shape<N>, const N: usize> Fitter<Model, N> {
    pub(super) fn new(config: &Config, model: Model, knowledge: &Knowledge) -> Self {
        Self {
            config: *config,
            model,
            side: Side::new(knowledge),
            knowledge: knowledge.clone(),
            front: Some(Follower::new(&config.filter, model, knowledge)),
            unrest: Unrest::default(),
            base: Pose::identity(),
            elapsed_s: 0.0,
            readings: Readings::default(),
            modes: Vec::new(),
            round: None,
            lost: 0,
        }
    }

    /// The probable hypotheses of the filter as modes.
    fn begin(&self, front: &Follower<Model, N>) -> Vec<Mode<N>> {
        let mut parts: Vec<(Gaussian<N>, f64)> = front.hypotheses().collect();
        parts.sort_by(|a, b| b.1.total_cmp(&a.1));
        let mode = |(belief, weight): (Gaussian<N>, f64)| {
            let mut x = belief.mean;
            x[TILT] = 0.0;
            let (low_m, high_m) = self.side.calibrated.domain.arc_range_m();
            let (mut mean, mut sd) = self.model.prior(&x);
            mean.fixed_rows_mut::<3>(0).copy_from(&x.fixed_rows::<3>(0));
            (sd[0], sd[1], sd[2], sd[TILT]) = ((high_m - low_m) / 12_f64.sqrt(), AWAY_SD_M, AWAY_SD_M, 1.0);
            Some(Mode {
                reference: self.base,
                prior: Prior { mean, sd },
                about: Neighbours::new(&self.side, &x)?,
                covariance: belief.covariance,
                log_weight: weight.ln(),
                near: Around::of_state(&x),
            })
        };
        let modes = parts.into_iter().take(self.config.modes).filter_map(mode).map(|mut mode| {
            mode.covariance.row_mut(TILT).fill(0.0);
            mode.covariance.column_mut(TILT).fill(0.0);
            mode
        });
        modes.collect()
    }

    /// Goes on with the searches.
    fn search(&mut self) {
        let Some(round) = &mut self.round else {
            self.round = self.search_of(0).map(|search| Round {
                means: self.readings.means().to_vec(),
                mode: 0,
                search,
                log_evidence: vec![f64::NEG_INFINITY; self.modes.len()],
            });
            return;
        };
        let Config { gate_sds, means_per_step, .. } = self.config;
        let evidence = Evidence { side: &self.side, shape: &self.model, means: &round.means, gate_sds };
        if !round.search.advance(&evidence, means_per_step) {
            return;
        }
        let Some(mut round) = self.round.take() else { return };
        let mode = &mut self.modes[round.mode];
        if let Some((x, quadratic)) = round.search.best()
            && let (Some(about), Some(covariance)) = (Neighbours::new(&self.side, &x), quadratic.covariance())
        {
            (mode.about, mode.covariance) = (about, covariance);
            round.log_evidence[round.mode] = quadratic.log_evidence(&mode.prior).unwrap_or(f64::NEG_INFINITY);
        }
        let next = round.mode + 1;
        if next == self.modes.len() {
            self.weigh(&round.log_evidence);
        } else {
            self.round = self.search_of(next).map(|search| Round { mode: next, search, ..round });
        }
    }

    fn search_of(&self, mode: usize) -> Option<Search<N>> {
        let Mode { reference, prior, about, near, .. } = self.modes.get(mode)?;
        Search::new(&self.side, *reference, *prior, &about.x, (*near, self.base))
    }

    /// Weights of the modes by their evidence; improbable modes and duplicates are dropped.
    fn weigh(&mut self, log_evidence: &[f64]) {
        let most = log_evidence.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        if most == f64::NEG_INFINITY {
            return;
        }
        for (mode, evidence) in self.modes.iter_mut().zip(log_evidence) {
            mode.log_weight = evidence - most;
        }
        self.modes.sort_by(|a, b| b.log_weight.total_cmp(&a.log_weight));
        let least = self.config.prune_share.ln();
        let model = self.model;
        let mut kept: Vec<Mode<N>> = Vec::new();
        for mode in std::mem::take(&mut self.modes) {
            let is_same = |other: &Mode<N>| {
                let mut x = mode.about.x;
                model.align(&mut x, &other.about.x);
                let away = x - other.about.x;
                let mut covariance = other.covariance;
                covariance[(TILT, TILT)] = 1.0;
                covariance.cholesky().is_some_and(|factor| away.dot(&factor.solve(&away)) < SAME)
            };
            if mode.log_weight >= least && !kept.iter().any(is_same) {
                kept.push(mode);
            }
        }
        self.modes = kept;
    }

    /// Belief about the present state of a mode.
    fn present(&self, mode: &mut Mode<N>) -> Option<Gaussian<N>> {
        let motion = mode.reference.then(&self.base.inverse());
        let (x, slopes) = mode.about.moved(&self.side, &self.model, &motion, 0.0, mode.near).or_else(|| {
            let start = mode.about.carried(&self.side, &motion);
            mode.about.moved(&self.side, &self.model, &motion, 0.0, start)
        })?;
        mode.near = Around::of_state(&x);
        let tilt = mode.about.tilt_slopes(&self.side, &self.model, &motion, mode.near)?;
        let sd_rad = tilt.1.tilt_sd_rad(&self.side, &self.unrest.second);
        let mut by_tilt = SVector::<f64, N>::zeros();
        by_tilt.fixed_rows_mut::<3>(0).copy_from(&tilt.0);
        by_tilt[TILT] = 1.0;
        let mut covariance =
            slopes * mode.covariance * slopes.transpose() + by_tilt * by_tilt.transpose() * sd_rad.powi(2);
        for i in 0..3 {
            covariance[(i, i)] += self.config.deviation_m.powi(2);
        }
        Some(Gaussian::new(x, covariance))
    }

    /// The estimate of the modes.
    fn together(&mut self, sample: &Sample) -> Option<Estimate> {
        let mut modes = std::mem::take(&mut self.modes);
        let mut beliefs: Vec<(Gaussian<N>, f64)> = modes
            .iter_mut()
            .filter_map(|mode| Some((self.present(mode)?, mode.log_weight.exp())))
            .filter(|(belief, _)| belief.is_finite())
            .collect();
        self.modes = modes;
        self.lost = if beliefs.is_empty() { self.lost + 1 } else { 0 };
        let (likeliest, _) = *beliefs.iter().max_by(|a, b| a.1.total_cmp(&b.1))?;
        for (belief, _) in &mut beliefs {
            self.model.align(&mut belief.mean, &likeliest.mean);
        }
        let innovations =
            beliefs.iter().filter_map(|(belief, weight)| Some((self.innovation(belief, sample)?, *weight)));
        let innovation = Innovation::of_mixture(innovations.collect::<Vec<_>>());
        let belief = Gaussian::of_mixture(beliefs)?;
        let mut estimate = self.side.estimate(&belief, innovation)?;
        self.model.describe(&self.side, &belief, &mut estimate);
        Some(estimate)
    }

    /// Innovation of a reading, which the fit does not include yet.
    fn innovation(&self, belief: &Gaussian<N>, sample: &Sample) -> Option<Innovation<2>> {
        let at = Around::of_state(&belief.mean);
        let (expected_n_m, slopes) = self.side.expect(at);
        let covariance = slopes * belief.covariance.fixed_view::<3, 3>(0, 0) * slopes.transpose();
        Innovation::of(sample.reading_n_m - expected_n_m, covariance + self.side.covariance_n2_m2(at))
    }
}

impl<Model: Motion<N> + Shape<N>, const N: usize> Tracker for Fitter<Model, N> {
    fn step(&mut self, sample: &Sample) -> Option<Estimate> {
        self.base = sample.motion.inverse().then(&self.base);
        self.elapsed_s += sample.dt_s;
        self.unrest.advance(sample, 0.5 * self.side.rest().length_m());
        let estimate = match &mut self.front {
            Some(front) => front.step(sample),
            None => self.together(sample),
        };
        // The reading of the touch itself was detected by its size.
        if self.elapsed_s > sample.dt_s {
            self.readings.keep(Mean::new(self.base, sample.reading_n_m, sample.dt_s, self.unrest.second));
        }
        if let Some(front) = self.front.take_if(|_| self.elapsed_s >= self.config.start_s) {
            self.modes = self.begin(&front);
            if self.modes.is_empty() {
                self.front = Some(front);
            }
        } else if self.front.is_none() {
            self.search();
            if self.lost >= LOST || self.modes.is_empty() {
                let unrest = self.unrest;
                *self = Self { unrest, ..Self::new(&self.config, self.model, &self.knowledge) };
            }
        }
        estimate
    }
}
