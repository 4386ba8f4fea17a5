//! Follows one contact in space with a bank of Gaussian hypotheses, each an iterated extended Kalman filter.

use filters::iterated::{self, Search};
use filters::{Bank, Gaussian, Innovation, robust};
use nalgebra::{Matrix3, Vector3};
use serde::{Deserialize, Serialize};

use super::motion::{AnyMotion, Motion, MotionSettings};
use super::side::{ContactReading, Side};
use super::stay::Stay;
use super::{Estimate, Knowledge, Sample, start};
use crate::settings::{Settings, SettingsError, within};
use crate::space::frames::Point;

/// Settings of an estimator in space.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Config {
    /// Number of initial hypotheses along the whisker.
    pub(super) hypotheses: usize,
    /// Model of the contact's motion.
    pub(super) motion: MotionSettings,
    /// Gate, in standard deviations: the noise of readings with a larger innovation is inflated until it lies at the gate.
    pub(super) gate_sds: f64,
    /// Weight of a hypothesis, relative to the heaviest, below which it is dropped.
    pub(super) prune_share: f64,
    /// Divergence between the beliefs before and after below which two hypotheses are merged.
    pub(super) merge_loss: f64,
    /// Maximum number of iterations of an update.
    pub(super) iterations: usize,
    /// Step, in standard deviations of the prior, below which an update ends.
    pub(super) tolerance_sds: f64,
}

impl Config {
    pub(super) fn new(motion: MotionSettings) -> Self {
        Self {
            hypotheses: 6,
            motion,
            gate_sds: 5.0,
            prune_share: 1e-3,
            merge_loss: 5e-2,
            iterations: 5,
            tolerance_sds: 1e-2,
        }
    }
}

impl Settings for Config {
    fn validate(&self) -> Result<(), SettingsError> {
        within("hypotheses", self.hypotheses as f64, 1.0..=1000.0)?;
        within("gate_sds", self.gate_sds, 1.0..=1e6)?;
        within("prune_share", self.prune_share, 0.0..=0.5)?;
        within("merge_loss", self.merge_loss, 0.0..=1.0)?;
        within("iterations", self.iterations as f64, 1.0..=1000.0)?;
        within("tolerance_sds", self.tolerance_sds, 0.0..=1.0)?;
        self.motion.validate()
    }
}

/// Tracks the contacts of a recording, one after the other.
pub(super) trait Tracker: Send {
    /// Takes one sample of a touch. `None` if there is no estimate.
    fn step(&mut self, sample: &Sample) -> Option<Estimate>;

    /// Takes one sample at which the whisker is free. The next sample with a contact begins the next touch.
    fn release(&mut self, sample: &Sample);

    /// Estimate of a contact that is not detected, at a sample that was released before: an object at rest that is known predicts
    /// contact and reading. Given once the reading shows that the whisker touches it; `None` otherwise. Default: none is expected.
    fn expect_touch(&mut self, _sample: &Sample) -> Option<Estimate> {
        None
    }

    /// Forgets the objects of earlier touches. The next sample begins a touch.
    fn forget(&mut self);

    /// Keeps the samples of each touch for [`Tracker::hindsight`]. Default: nothing is kept.
    fn remember(&mut self) {}

    /// Estimates of every sample since the touch, in their order, from all readings of the touch. Called before each sample without
    /// a contact, and at the end of the recording; discards the samples. `None` if none have been kept.
    fn hindsight(&mut self) -> Option<Vec<Option<Estimate>>> {
        None
    }

    /// Whether the readings of this touch contradict the object of earlier ones.
    fn is_another(&self) -> bool {
        false
    }

    /// Whether the estimates are those of a fitted object, and the readings determine the place of the contact along the whisker. A
    /// fit begins with a filter of a contact at rest, whose innovations say nothing about the model of the object; and as long as
    /// the place is not determined, its distribution is far from the normal one that a fit states.
    fn is_determined(&self) -> bool {
        true
    }

    /// Logarithm of the evidence for the model of the object from all readings so far, up to a constant that all models share.
    /// `None` if the method does not compute it, or not yet.
    fn log_evidence(&self) -> Option<f64> {
        None
    }

    /// Scatter of the readings about the fitted object relative to the expected one: 1, or more if they contradict the object.
    /// `None` without a fitted object.
    fn excess(&self) -> Option<f64> {
        None
    }

    /// Whether the fitted object is not the first one, so that it explains the later readings only.
    fn has_begun_anew(&self) -> bool {
        false
    }

    /// Takes the smallest excess, at the present sample, of the models whose object explains all readings. If one of them is small,
    /// no second fit is needed. Default: it is not used.
    fn compare(&mut self, _least_excess: f64) {}
}

/// Follows one contact.
pub(super) struct Follower<Model, const N: usize> {
    config: Config,
    model: Model,
    side: Side,
    /// Arc length from which the contact has slipped.
    near_m: Option<f64>,
    /// `None` before the first step.
    bank: Option<Bank<N>>,
    /// Readings at the present pose of the base, and innovation of the last update. `None` at the first step.
    stay: Option<Stay<N>>,
    innovation: Option<Innovation<2>>,
    unrest: Unrest,
}

impl AnyMotion for Config {
    fn begin_with<Model: Motion<N>, const N: usize>(&self, model: Model, knowledge: &Knowledge) -> Box<dyn Tracker> {
        Box::new(Follower::new(self, model, knowledge))
    }
}

/// Recent acceleration of the base, from its motion.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Unrest {
    /// Second moment of the acceleration in Base (m2/s4).
    pub(super) second: Matrix3<f64>,
    /// Displacement per time of a point of the whisker in the last step.
    velocity_m_s: Option<Vector3<f64>>,
}

/// Time in which the oscillation of a wire along a surface decays to its e-th part, and time in which an acceleration excites it.
const RINGING_S: f64 = 0.25;
const EXCITED_S: f64 = 0.1;

impl Unrest {
    /// Takes the motion of a step, of a point of the whisker at `middle_m` from the root.
    pub(super) fn advance(&mut self, sample: &Sample, middle_m: f64) {
        if sample.dt_s <= 0.0 {
            return;
        }
        let point = Point::new(middle_m, 0.0, 0.0);
        let velocity_m_s = (sample.motion.apply(point).vector() - point.vector()) / sample.dt_s;
        let before_m_s = self.velocity_m_s.replace(velocity_m_s).unwrap_or(velocity_m_s);
        // A point at rest in the world accelerates in Base opposite to the base.
        let acceleration_m_s2 = (before_m_s - velocity_m_s) / sample.dt_s;
        self.second *= (-2.0 * sample.dt_s / RINGING_S).exp();
        self.second += acceleration_m_s2 * acceleration_m_s2.transpose() * (sample.dt_s / EXCITED_S);
    }
}

impl<Model: Motion<N>, const N: usize> Follower<Model, N> {
    pub(super) fn new(config: &Config, model: Model, knowledge: &Knowledge) -> Self {
        let (side, unrest) = (Side::new(knowledge), Unrest::default());
        Self { config: *config, model, side, near_m: None, bank: None, stay: None, innovation: None, unrest }
    }

    /// The same for a contact that has slipped from the arc length `near_m`, with the recent acceleration of the base.
    pub(super) fn slipped(self, near_m: Option<f64>, unrest: Unrest) -> Self {
        Self { near_m, unrest, ..self }
    }

    /// Sets the recent acceleration of the base, which it had before the touch.
    pub(super) fn set_unrest(&mut self, unrest: Unrest) {
        self.unrest = unrest;
    }

    /// The hypotheses with their probabilities.
    pub(super) fn hypotheses(&self) -> impl Iterator<Item = (Gaussian<N>, f64)> {
        let bank = self.bank.iter().flat_map(Bank::hypotheses);
        bank.map(|one| (one.belief, one.weight()))
    }

    /// The initial hypotheses, which explain the readings of the touch.
    fn begin(&self, touch: &Sample) -> Bank<N> {
        let places = start::beliefs(&self.side, self.config.hypotheses, self.near_m, touch.reading_n_m);
        let parts = |(place, weight): &(Gaussian<3>, f64)| {
            let log_weight = weight.ln();
            self.model.parts(place).into_iter().map(move |belief| (belief, log_weight))
        };
        Bank::new(places.iter().flat_map(parts))
    }

    fn advance(&mut self, bank: &mut Bank<N>, sample: &Sample) {
        let stays = self.stay.as_mut().is_some_and(|stay| stay.includes(&self.side, sample));
        let mut stay = match self.stay.take() {
            Some(stay) if stays => stay,
            earlier => Stay::new(bank, earlier, sample),
        };
        if stay.begin_update(bank) {
            self.innovation = self.update(bank, &stay);
        }
        self.stay = Some(stay);
    }

    /// Propagates the hypotheses before a stay to its pose and conditions them on its mean reading. Returns the innovation of the
    /// mixture.
    fn update(&self, bank: &mut Bank<N>, stay: &Stay<N>) -> Option<Innovation<2>> {
        let mean = stay.mean();
        let process = self.model.step(&self.side, &mean, &self.unrest.second);
        bank.predict(|belief| {
            iterated::predict(belief, &process);
            Ok(())
        });
        let Config { iterations, tolerance_sds, gate_sds, prune_share, merge_loss, .. } = self.config;
        let search = Search { iterations, tolerance_sds };
        let reading = ContactReading {
            side: &self.side,
            acceleration_m_s2: self.unrest.second.trace().sqrt(),
            new_share: self.side.new_share(&mean.motion),
            count: stay.count(),
        };
        let innovation = bank.update(|belief| {
            robust::update_vector(belief, &reading, gate_sds, &mean.reading_n_m, |belief, reading, z| {
                iterated::update(belief, reading, &search, z)
            })
        });
        bank.prune(prune_share);
        if let Some(likeliest) = bank.most_probable().map(|one| one.belief.mean) {
            bank.map(|belief| self.model.align_belief(belief, &likeliest));
        }
        bank.merge(merge_loss);
        bank.map(|belief| self.side.hold(&mut belief.mean));
        innovation.ok()
    }
}

impl<Model: Motion<N>, const N: usize> Tracker for Follower<Model, N> {
    fn step(&mut self, sample: &Sample) -> Option<Estimate> {
        self.unrest.advance(sample, 0.5 * self.side.length_m());
        let bank = match self.bank.take() {
            None => {
                (self.stay, self.innovation) = (None, None);
                self.begin(sample)
            }
            Some(mut bank) => {
                self.advance(&mut bank, sample);
                bank
            }
        };
        let belief = bank.moments()?;
        self.bank = Some(bank);
        let mut estimate = self.side.estimate(&belief, self.innovation)?;
        self.model.describe(&self.side, &belief, &mut estimate);
        Some(estimate)
    }

    fn release(&mut self, _: &Sample) {
        self.forget();
    }

    fn forget(&mut self) {
        (self.bank, self.stay, self.near_m, self.unrest) = (None, None, None, Unrest::default());
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::{Rotation3, Vector2};

    use super::*;
    use crate::space::frames::Pose;

    #[test]
    fn verif_the_second_moment_is_that_of_the_base_s_acceleration() {
        const DT_S: f64 = 4e-3;
        const STEPS: i32 = 50;
        let mut unrest = Unrest::default();
        for i in 0..STEPS {
            let moved_m = Vector3::y() * (0.3 * f64::from(i) * DT_S * DT_S);
            let motion = Pose::new(-moved_m, Rotation3::identity());
            unrest.advance(&Sample { motion, dt_s: DT_S, reading_n_m: Vector2::zeros() }, 0.04);
        }
        // The first step has no acceleration.
        let decay = (-2.0 * DT_S / RINGING_S).exp();
        let expected = 0.3_f64.powi(2) * DT_S / EXCITED_S * (1.0 - decay.powi(STEPS - 1)) / (1.0 - decay);
        assert!((unrest.second[(1, 1)] - expected).abs() < 1e-6 && unrest.second[(0, 0)] == 0.0, "{unrest:?}");
    }
}
