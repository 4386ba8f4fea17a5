//! Follows one contact in space with a particle filter.

use filters::particle::Renewal;
use filters::{Gaussian, Innovation, Measurement, ParticleSet};
use nalgebra::{Matrix1, RowVector2, SMatrix, SVector, Vector1};
use rand::SeedableRng;
use rand_pcg::Pcg64;
use serde::{Deserialize, Serialize};

use super::follower::{Tracker, Unrest};
use super::motion::{AnyMotion, Motion, MotionSettings};
use super::side::{ContactReading, Side};
use super::{Estimate, Knowledge, Sample, start};
use crate::settings::{Settings, SettingsError, within};

/// Settings.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Config {
    /// Number of initial hypotheses along the whisker; particles are drawn from each in proportion to its weight.
    pub(super) hypotheses: usize,
    /// Model of the contact's motion.
    pub(super) motion: MotionSettings,
    /// Gate, in standard deviations: the noise of readings with a larger innovation is inflated until it lies at the gate.
    pub(super) gate_sds: f64,
    /// Number of particles.
    pub(super) particles: usize,
    /// Share of the particles; a new set is drawn if the effective sample size falls below it.
    pub(super) renew_share: f64,
    /// Bandwidth of the kernels from which a new set is drawn, in standard deviations of the old one.
    pub(super) kernel: f64,
    /// Seed of the random numbers.
    pub(super) seed: u64,
}

impl Config {
    pub(super) fn new(motion: MotionSettings) -> Self {
        Self { hypotheses: 50, motion, gate_sds: 5.0, particles: 300, renew_share: 0.5, kernel: 0.6, seed: 1 }
    }
}

impl Settings for Config {
    fn validate(&self) -> Result<(), SettingsError> {
        within("hypotheses", self.hypotheses as f64, 1.0..=1000.0)?;
        within("gate_sds", self.gate_sds, 1.0..=1e6)?;
        within("particles", self.particles as f64, 1.0..=1e6)?;
        within("renew_share", self.renew_share, 0.0..=1.0)?;
        within("kernel", self.kernel, 1e-3..=1.0)?;
        self.motion.validate()
    }
}

/// Follows one contact.
pub(super) struct Particles<Model, const N: usize> {
    config: Config,
    model: Model,
    side: Side,
    rng: Pcg64,
    /// `None` before the first step.
    set: Option<ParticleSet<N>>,
    unrest: Unrest,
}

impl AnyMotion for Config {
    fn begin_with<Model: Motion<N>, const N: usize>(&self, model: Model, knowledge: &Knowledge) -> Box<dyn Tracker> {
        Box::new(Particles::new(self, model, knowledge))
    }
}

impl<Model: Motion<N>, const N: usize> Particles<Model, N> {
    fn new(config: &Config, model: Model, knowledge: &Knowledge) -> Self {
        Self {
            config: *config,
            model,
            side: Side::new(knowledge),
            rng: Pcg64::seed_from_u64(config.seed),
            set: None,
            unrest: Unrest::default(),
        }
    }

    /// Particles that explain the readings of the touch, drawn from the initial hypotheses in proportion to their weights. `None`
    /// if no contact explains the readings.
    fn begin(&mut self, touch: &Sample) -> Option<ParticleSet<N>> {
        let places = start::beliefs(&self.side, self.config.hypotheses, None, touch.reading_n_m);
        let parts = |(place, weight): &(Gaussian<3>, f64)| {
            let (parts, weight) = (self.model.parts(place), *weight);
            let each = weight / parts.len() as f64;
            parts.into_iter().map(move |belief| (belief, each))
        };
        let parts: Vec<_> = places.iter().flat_map(parts).collect();
        let mut set = ParticleSet::drawn(&parts, self.config.particles, &mut self.rng)?;
        set.map(|particle| self.held(*particle));
        Some(set)
    }

    /// Moves the particles with the base, and replaces their states by equal ones that can be averaged ([`Motion::align`]).
    fn predict(&mut self, set: &mut ParticleSet<N>, sample: &Sample) {
        let process = self.model.step(&self.side, sample, &self.unrest.second);
        set.predict(&process, &mut self.rng);
        let likeliest = set.weights().iter().enumerate().max_by(|(_, a), (_, b)| a.total_cmp(b));
        let reference = set.particles().get(likeliest.map_or(0, |(index, _)| index));
        set.map(|particle| {
            let mut particle = *particle;
            self.model.align(&mut particle, &reference);
            self.held(particle)
        });
    }

    fn held(&self, mut x: SVector<f64, N>) -> SVector<f64, N> {
        self.side.hold(&mut x);
        x
    }

    /// Weights the particles by both readings, one after the other. Returns the innovation, with the sensor model linearised at the
    /// mean.
    fn weigh(&mut self, set: &mut ParticleSet<N>, sample: &Sample) -> Option<Innovation<2>> {
        let reading = ContactReading {
            side: &self.side,
            acceleration_m_s2: self.unrest.second.trace().sqrt(),
            new_share: self.side.new_share(&sample.motion),
            count: 1.0,
        };
        let belief = set.moments();
        // The error of the sensor model recurs at the same contact. If each particle had its own covariance, small residuals would
        // count as evidence for contacts at which the model is accurate.
        let (expected_n_m, jacobian, noise_n2_m2) = reading.linearised_with_noise(&belief.mean)?;
        let innovation = Innovation::of(
            sample.reading_n_m - expected_n_m,
            jacobian * belief.covariance * jacobian.transpose() + noise_n2_m2,
        );
        let whitened = noise_n2_m2.cholesky()?.l().try_inverse()?;
        let renewal =
            Renewal { share: self.config.renew_share, bandwidth: self.config.kernel, gate_sds: self.config.gate_sds };
        for row in whitened.row_iter() {
            let row = RowVector2::new(row[0], row[1]);
            let whitened = Whitened { reading: &reading, row };
            // A reading without a valid update leaves the particles as they are.
            let _ = set.update_or_renew(&whitened, &(row * sample.reading_n_m), &renewal, &mut self.rng);
        }
        innovation
    }
}

impl<Model: Motion<N>, const N: usize> Tracker for Particles<Model, N> {
    fn step(&mut self, sample: &Sample) -> Option<Estimate> {
        self.unrest.advance(sample, 0.5 * self.side.length_m());
        let (set, innovation) = match self.set.take() {
            None => (self.begin(sample)?, None),
            Some(mut set) => {
                self.predict(&mut set, sample);
                let innovation = self.weigh(&mut set, sample);
                (set, innovation)
            }
        };
        let belief = set.moments();
        self.set = Some(set);
        let mut estimate = self.side.estimate(&belief, innovation)?;
        self.model.describe(&self.side, &belief, &mut estimate);
        Some(estimate)
    }

    fn release(&mut self, _: &Sample) {
        self.forget();
    }

    fn forget(&mut self) {
        (self.set, self.unrest) = (None, Unrest::default());
    }
}

/// A linear combination of both readings whose noise has the variance 1, independent of the other one.
struct Whitened<'a> {
    reading: &'a ContactReading<'a>,
    row: RowVector2<f64>,
}

impl<const N: usize> Measurement<N, 1> for Whitened<'_> {
    fn predict(&self, x: &SVector<f64, N>) -> Option<Vector1<f64>> {
        Some(self.row * Measurement::<N, 2>::predict(self.reading, x)?)
    }

    fn noise(&self, _: &SVector<f64, N>) -> Matrix1<f64> {
        Matrix1::identity()
    }

    fn constant_noise(&self) -> Option<Matrix1<f64>> {
        Some(Matrix1::identity())
    }

    fn jacobian(&self, x: &SVector<f64, N>) -> Option<SMatrix<f64, 1, N>> {
        Some(self.row * Measurement::<N, 2>::jacobian(self.reading, x)?)
    }

    fn linearised(&self, x: &SVector<f64, N>) -> Option<(Vector1<f64>, SMatrix<f64, 1, N>)> {
        let (expected, jacobian) = Measurement::<N, 2>::linearised(self.reading, x)?;
        Some((self.row * expected, self.row * jacobian))
    }
}
