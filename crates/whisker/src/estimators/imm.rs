//! The interacting-multiple-model estimator ([`filters::imm`]) on the contact: the contact rests on a thin object,
//! slides over a round one, or is lost.
//!
//! All modes share the state of a sliding contact, `(s, d, rho, e)`. In the mode *static* every step resets the radius
//! to that of a thin object. In the mode *sliding* the radius is estimated, from a diffuse prior whenever the mode is
//! entered from another one. In the mode *lost* the expected reading is zero for every state, and the contact drifts
//! from its last position. Each of several hypotheses at the touch is such an estimator; they are weighted, pruned and
//! merged as in the other filters.

use std::ops::RangeInclusive;
use std::sync::Arc;

use filters::imm::{Imm, Transition};
use filters::{Bank, Gaussian, Innovation, Measurement, Process, Update, UpdateError, extended, robust};
use nalgebra::{Matrix1, Matrix4, SMatrix, SVector, Vector1, Vector4};
use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::motion::{Motion, Round};
use super::shares::ModelShares;
use super::side::{ContactReading, Side};
use super::start::{Earlier, EarlierReading, Start, earlier};
use super::{ContactPrior, Estimate, Knowledge, Method, Sample, Touch, Tracker};
use crate::settings::{Settings, SettingsError, parse, within};

/// Names of the modes, in their order.
const MODES: [&str; 3] = ["static", "sliding", "lost"];
const STATIC: usize = 0;
const SLIDING: usize = 1;
const LOST: usize = 2;

/// A number for each mode.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct OfModes {
    r#static: f64,
    sliding: f64,
    lost: f64,
}

impl OfModes {
    fn all(self) -> [f64; 3] {
        [self.r#static, self.sliding, self.lost]
    }
}

/// Settings.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub(super) struct Config {
    /// Initial hypotheses: one Gaussian, or several along the whisker.
    pub start: Start,
    /// Motion model of the mode *static*.
    pub thin: Round,
    /// Motion model of the mode *sliding*.
    pub round: Round,
    /// Drift of a lost contact, as the standard deviation after one second.
    pub lost_wander_m_sqrt_s: f64,
    /// Relative probabilities of the modes at the touch, where *lost* has none. The probabilities of a transition into
    /// the modes have the same proportion.
    pub weights: OfModes,
    /// Mean duration of each mode (s).
    pub sojourn_s: OfModes,
    /// Gate, in standard deviations: the noise of a reading with a larger innovation is inflated until the innovation
    /// lies at the gate.
    pub gate_sds: f64,
    /// Weight of a hypothesis, relative to the heaviest, below which it is dropped.
    pub prune_share: f64,
    /// Divergence between the beliefs before and after below which two hypotheses are merged.
    pub merge_loss: f64,
}

impl Default for Config {
    fn default() -> Self {
        Self {
            start: Start::Hypotheses { count: 16 },
            thin: Round::default(),
            round: Round::of_any_size(),
            lost_wander_m_sqrt_s: 1e-2,
            weights: OfModes { r#static: 10.0, sliding: 1.0, lost: 0.1 },
            sojourn_s: OfModes { r#static: 100.0, sliding: 100.0, lost: 0.1 },
            gate_sds: 5.0,
            prune_share: 1e-4,
            merge_loss: 1e-2,
        }
    }
}

impl Settings for Config {
    fn validate(&self) -> Result<(), SettingsError> {
        self.start.validate()?;
        self.thin.validate()?;
        self.round.validate()?;
        within("lost_wander_m_sqrt_s", self.lost_wander_m_sqrt_s, 1e-9..=1.0)?;
        for weight in self.weights.all() {
            within("weights", weight, 1e-9..=1e9)?;
        }
        for sojourn_s in self.sojourn_s.all() {
            within("sojourn_s", sojourn_s, 1e-3..=1e9)?;
        }
        within("gate_sds", self.gate_sds, 1.0..=1e6)?;
        within("prune_share", self.prune_share, 0.0..=0.5)?;
        within("merge_loss", self.merge_loss, 0.0..=1.0)
    }
}

struct Interacting {
    config: Config,
    knowledge: Arc<Knowledge>,
}

pub(super) fn build(config: &Value, knowledge: &Arc<Knowledge>) -> Result<Box<dyn Method>, SettingsError> {
    Ok(Box::new(Interacting { config: parse(config)?, knowledge: knowledge.clone() }))
}

impl Method for Interacting {
    fn begin(&self, touch: &Touch<'_>) -> Box<dyn Tracker> {
        Box::new(Follower {
            config: Config {
                thin: self.config.thin.beyond_pin(touch.face),
                round: self.config.round.beyond_pin(touch.face),
                ..self.config
            },
            side: Side::new(touch.face, &self.knowledge),
            noise_sd_n_m: self.knowledge.noise_sd_n_m,
            contact_prior: touch.contact_prior,
            history: touch.history.to_vec(),
            bank: None,
        })
    }
}

/// Follows one contact.
struct Follower {
    config: Config,
    side: Side,
    noise_sd_n_m: f64,
    contact_prior: Option<ContactPrior>,
    /// Samples before the touch, until the first step.
    history: Vec<Sample>,
    /// `None` before the first step.
    bank: Option<Bank<4, Imm<4>>>,
}

impl Follower {
    /// The bank at the touch, with zero probability of *lost*.
    fn begin(&self, touch: &Sample) -> Bank<4, Imm<4>> {
        let Config { thin, round, weights, .. } = self.config;
        let places = self.config.start.beliefs(&self.side, touch.reading_n_m, self.contact_prior);
        let hypotheses = places.iter().flat_map(|(place, log_weight)| {
            let resting = thin.belief(place);
            let parts = round.parts(place).into_iter();
            parts.map(move |(sliding, log_part)| {
                let modes = [(resting, weights.r#static), (sliding, weights.sliding), (resting, 0.0)];
                (Imm::new(modes), log_weight + log_part)
            })
        });
        let mut bank = Bank::new(hypotheses);
        for Earlier { sample, .. } in earlier(&self.history, touch, self.noise_sd_n_m, 0.0) {
            // A reading without a valid update leaves the bank as it is.
            let _ = self.condition(&mut bank, sample.reading_n_m, |mode| EarlierReading {
                back: self.process(mode, &sample),
                reading: self.reading(),
            });
        }
        bank
    }

    fn reading(&self) -> ContactReading<'_> {
        ContactReading::new(&self.side, Round::INDICES)
    }

    fn process(&self, mode: usize, sample: &Sample) -> ModeProcess<'_> {
        let Config { thin, round, lost_wander_m_sqrt_s, .. } = &self.config;
        match mode {
            SLIDING => ModeProcess { step: round.step(&self.side, sample), thin: None, drift_m2: 0.0 },
            STATIC => ModeProcess { step: thin.step(&self.side, sample), thin: Some(*thin), drift_m2: 0.0 },
            _ => {
                let drift_m2 = lost_wander_m_sqrt_s.powi(2) * sample.dt_s;
                ModeProcess { step: thin.step(&self.side, sample), thin: Some(*thin), drift_m2 }
            }
        }
    }

    /// Conditions the bank on a reading; `reading` gives the measurement model of a mode.
    fn condition<Reading: Measurement<4, 1>>(
        &self,
        bank: &mut Bank<4, Imm<4>>,
        z_n_m: f64,
        reading: impl Fn(usize) -> Reading,
    ) -> Result<Innovation<1>, UpdateError> {
        let (gate_sds, z) = (self.config.gate_sds, Vector1::new(z_n_m));
        let innovation = bank.update(|modes| {
            modes.update(|mode, belief| -> Result<Update<1>, UpdateError> {
                robust::update(belief, &reading(mode), gate_sds, &z, |belief, reading, z| {
                    extended::update(belief, reading, z)
                })
            })
        });
        bank.prune(self.config.prune_share);
        bank.merge(self.config.merge_loss);
        bank.map(|modes| modes.map(|belief| self.side.hold(&mut belief.mean)));
        innovation
    }

    /// Takes a sample after that of the touch.
    fn advance(&self, bank: &mut Bank<4, Imm<4>>, sample: &Sample) -> Option<Innovation<1>> {
        let Config { sojourn_s, weights, round, .. } = &self.config;
        let transition = Transition::from_sojourns(sample.dt_s, &sojourn_s.all(), &weights.all());
        bank.predict(|modes| {
            modes.mix(&transition, |_, to, belief| if to == SLIDING { unknown(round, belief) } else { *belief });
            modes.predict(|mode, belief| {
                extended::predict(belief, &self.process(mode, sample));
                Ok(())
            })
        });
        self.condition(bank, sample.reading_n_m, |mode| ModeReading {
            contact: self.reading(),
            is_lost: mode == LOST,
            noise_n2_m2: self.noise_sd_n_m.powi(2),
        })
        .ok()
    }

    /// The estimate of the bank. `None` while the contact is more probably lost.
    fn estimate(&self, bank: &Bank<4, Imm<4>>, innovation: Option<Innovation<1>>) -> Option<Estimate> {
        let share = |mode: usize| -> f64 {
            bank.hypotheses().iter().map(|one| one.weight() * one.belief.probabilities()[mode]).sum()
        };
        let belief = moments(bank, STATIC..=SLIDING).filter(|_| share(LOST) < 0.5)?;
        let models = ModelShares::new(MODES.iter().enumerate().map(|(mode, name)| (*name, share(mode))));
        let stated = self.side.estimate(self.config.round.radius(), &belief, innovation);
        // The static mode does not estimate a radius.
        let sliding = moments(bank, SLIDING..=SLIDING).filter(|_| share(SLIDING) > share(STATIC));
        let radius = sliding.and_then(|sliding| self.side.radius(self.config.round.radius(), &sliding, stated.contact));
        Some(Estimate { models: Some(models), radius, ..stated })
    }
}

impl Tracker for Follower {
    fn step(&mut self, sample: &Sample) -> Option<Estimate> {
        let (bank, innovation) = match self.bank.take() {
            Some(mut bank) => {
                let innovation = self.advance(&mut bank, sample);
                (bank, innovation)
            }
            None => {
                let bank = self.begin(sample);
                // If all hypotheses are lost later on, these samples are too old for a new start.
                self.history.clear();
                self.contact_prior = None;
                (bank, None)
            }
        };
        let estimate = self.estimate(&bank, innovation);
        self.bank = (!bank.hypotheses().is_empty()).then_some(bank);
        estimate
    }
}

/// Moments of the bank over some of the modes together. `None` if they have no probability.
fn moments(bank: &Bank<4, Imm<4>>, modes: RangeInclusive<usize>) -> Option<Gaussian<4>> {
    let parts = bank.hypotheses().iter().flat_map(|one| {
        let (beliefs, shares) = (one.belief.beliefs(), one.belief.probabilities());
        modes.clone().map(move |mode| (beliefs[mode], one.weight() * shares[mode]))
    });
    Gaussian::of_mixture(parts)
}

/// The belief with a diffuse radius.
fn unknown(round: &Round, belief: &Gaussian<4>) -> Gaussian<4> {
    let mut entered = *belief;
    let (radius_m, radius_sd_m) = round.expected_radius_m();
    entered.mean[2] = radius_m;
    entered.covariance.row_mut(2).fill(0.0);
    entered.covariance.column_mut(2).fill(0.0);
    entered.covariance[(2, 2)] = radius_sd_m.powi(2);
    entered
}

/// One step of a mode.
struct ModeProcess<'a> {
    step: <Round as Motion<4>>::Step<'a>,
    /// Prior motion whose radius replaces that of the state.
    thin: Option<Round>,
    /// Additional variance of the position (m2).
    drift_m2: f64,
}

impl ModeProcess<'_> {
    /// The state from which the step starts.
    fn from(&self, x: &Vector4<f64>) -> Vector4<f64> {
        let mut from = *x;
        from[2] = self.thin.map_or(x[2], |thin| thin.expected_radius_m().0);
        from
    }
}

impl Process<4> for ModeProcess<'_> {
    fn predict(&self, x: &Vector4<f64>) -> Vector4<f64> {
        self.step.predict(&self.from(x))
    }

    fn jacobian(&self, x: &Vector4<f64>) -> Matrix4<f64> {
        let mut jacobian = self.step.jacobian(&self.from(x));
        if self.thin.is_some() {
            jacobian.column_mut(2).fill(0.0);
        }
        jacobian
    }

    fn noise(&self, x: &Vector4<f64>) -> Matrix4<f64> {
        let mut noise = self.step.noise(&self.from(x));
        noise[(0, 0)] += self.drift_m2;
        noise[(1, 1)] += self.drift_m2;
        noise[(2, 2)] += self.thin.map_or(0.0, |thin| thin.expected_radius_m().1.powi(2));
        noise
    }
}

/// Measurement model of a mode.
struct ModeReading<'a> {
    contact: ContactReading<'a>,
    is_lost: bool,
    /// Variance of the measurement noise.
    noise_n2_m2: f64,
}

impl Measurement<4, 1> for ModeReading<'_> {
    fn predict(&self, x: &Vector4<f64>) -> Option<Vector1<f64>> {
        if self.is_lost { Some(Vector1::zeros()) } else { self.contact.predict(x) }
    }

    fn jacobian(&self, x: &SVector<f64, 4>) -> Option<SMatrix<f64, 1, 4>> {
        if self.is_lost { Some(SMatrix::zeros()) } else { self.contact.jacobian(x) }
    }

    fn noise(&self, x: &Vector4<f64>) -> Matrix1<f64> {
        if self.is_lost { Matrix1::new(self.noise_n2_m2) } else { self.contact.noise(x) }
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::vector;

    use super::*;
    use crate::estimators::testing::knowledge;

    #[test]
    fn verif_radius_is_that_of_the_sliding_mode() {
        let knowledge = knowledge();
        let config = Config::default();
        let follower = Follower {
            config,
            side: Side::new(&knowledge.faces[0], &knowledge),
            noise_sd_n_m: knowledge.noise_sd_n_m,
            contact_prior: None,
            history: Vec::new(),
            bank: None,
        };
        let belief = |radius_m: f64, sd_m: f64| {
            let variances = vector![1e-8, 1e-8, sd_m * sd_m, 1.0];
            Gaussian::new(vector![0.055, 3e-3, radius_m, 0.0], Matrix4::from_diagonal(&variances))
        };
        let modes = Imm::new([(belief(0.0, 1e-4), 0.4), (belief(15e-3, 1e-3), 0.6), (belief(0.0, 1e-4), 0.0)]);
        let stated = follower.estimate(&Bank::new([(modes, 0.0)]), None).unwrap().radius.unwrap();
        let wire_m = 0.125e-3;
        assert!((stated.radius_m - (15e-3 - wire_m)).abs() < 1e-9 && (stated.sd_m - 1e-3).abs() < 1e-9, "{stated:?}");
    }
}
