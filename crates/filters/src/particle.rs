//! The particle filter: sequential importance resampling (Gordon, Salmond and Smith 1993) with systematic resampling
//! when the effective sample size falls (Kitagawa 1996; Liu and Chen 1998) and a shrinking kernel that keeps the cloud
//! diverse without widening it (Liu and West 2001).

use nalgebra::{SMatrix, SVector};
use rand::{Rng, RngExt};
use rand_distr::StandardNormal;

use crate::bounded::Noisier;
use crate::gaussian::symmetrised;
use crate::{Gaussian, Innovation, Measurement, Process, Skipped, extended};

/// A belief made of weighted particles.
#[derive(Clone, Debug, PartialEq)]
pub struct Cloud<const N: usize> {
    particles: Vec<SVector<f64, N>>,
    /// Normalised weights, one a particle.
    weights: Vec<f64>,
    /// Kept between steps so that neither resampling nor weighing allocates.
    spare: Vec<SVector<f64, N>>,
    spare_weights: Vec<f64>,
    logs: Vec<f64>,
    conditioned: Vec<Option<Conditioned<N>>>,
    sources: Vec<usize>,
}

impl<const N: usize> Cloud<N> {
    /// Equally weighted particles.
    ///
    /// # Panics
    /// If there are none.
    pub fn new(particles: Vec<SVector<f64, N>>) -> Self {
        assert!(!particles.is_empty(), "a cloud needs at least one particle");
        let weights = vec![1.0 / particles.len() as f64; particles.len()];
        let count = particles.len();
        Self {
            particles,
            weights,
            spare: Vec::with_capacity(count),
            spare_weights: Vec::with_capacity(count),
            logs: Vec::with_capacity(count),
            conditioned: Vec::with_capacity(count),
            sources: Vec::with_capacity(count),
        }
    }

    /// The particles.
    pub fn particles(&self) -> &[SVector<f64, N>] {
        &self.particles
    }

    /// Their weights, adding up to 1.
    pub fn weights(&self) -> &[f64] {
        &self.weights
    }

    /// Mean of the cloud.
    pub fn mean(&self) -> SVector<f64, N> {
        self.particles.iter().zip(&self.weights).map(|(particle, &weight)| particle * weight).sum()
    }

    /// Mean and covariance of the cloud.
    pub fn moments(&self) -> Gaussian<N> {
        let mean = self.mean();
        let mut covariance = SMatrix::zeros();
        for (particle, &weight) in self.particles.iter().zip(&self.weights) {
            let deviation = particle - mean;
            covariance += deviation * deviation.transpose() * weight;
        }
        Gaussian::new(mean, symmetrised(covariance))
    }

    /// Effective sample size, `1 / sum w^2`.
    pub fn effective_size(&self) -> f64 {
        1.0 / self.weights.iter().map(|w| w * w).sum::<f64>()
    }

    /// Applies `change` to every particle, for example to hold it within bounds.
    pub fn map(&mut self, change: impl Fn(&SVector<f64, N>) -> SVector<f64, N>) {
        for particle in &mut self.particles {
            *particle = change(particle);
        }
    }

    /// Fading memory: particles move away from their mean so that the covariance grows by `alpha`.
    pub fn fade(&mut self, alpha: f64) {
        if alpha == 1.0 {
            return;
        }
        let mean = self.mean();
        let scale = alpha.sqrt();
        self.map(|particle| mean + (particle - mean) * scale);
    }

    /// Carries every particle through the process and draws its noise, which is that at the cloud's mean as in the Gaussian filters.
    pub fn predict(&mut self, process: &impl Process<N>, rng: &mut impl Rng) {
        let noise = process.noise(&self.mean());
        let factor = noise.cholesky().map_or_else(SMatrix::zeros, |factor| factor.l());
        for particle in &mut self.particles {
            *particle = process.predict(particle) + factor * normal(rng);
        }
    }

    /// Weighs the particles by the likelihood of the reading. The innovation is that of the cloud's mean prediction.
    ///
    /// # Errors
    /// [`Skipped`] leaves the cloud as it was: no particle has a prediction, or every likelihood vanishes.
    pub fn update<const M: usize>(
        &mut self,
        measurement: &impl Measurement<N, M>,
        z: &SVector<f64, M>,
    ) -> Result<Innovation<M>, Skipped> {
        let innovation = self.expect(measurement, z)?;
        self.weigh();
        Ok(innovation)
    }

    /// Weighs the particles as [`Self::update`] does, unless that would leave an effective sample size below `share` of them: then the cloud
    /// is drawn anew from where the reading says that the particles should have been.
    ///
    /// Each particle stands for a Gaussian kernel of `bandwidth` standard deviations of the cloud, drawn towards the mean so that mean and
    /// covariance stay (Liu and West 2001). A kernel is chosen by how well it foretells the reading, and conditioned on it by an extended
    /// Kalman update, from which the new particle is drawn (the auxiliary filter of Pitt and Shephard 1999, with the linearised optimal
    /// proposal of Doucet, Godsill and Andrieu 2000). The weights correct for what the linearisation misses.
    ///
    /// # Errors
    /// [`Skipped`] leaves the cloud as it was.
    pub fn update_or_renew(
        &mut self,
        measurement: &impl Measurement<N, 1>,
        z: &SVector<f64, 1>,
        renewal: &Renewal,
        rng: &mut impl Rng,
    ) -> Result<Innovation<1>, Skipped> {
        let innovation = self.expect(measurement, z)?;
        let mut measurement = Noisier { model: measurement, factor: 1.0 };
        if innovation.nis > renewal.gate_sds * renewal.gate_sds {
            measurement = measurement.at_gate(&self.mean(), &innovation, renewal.gate_sds);
            self.expect(&measurement, z)?;
        }
        self.spare_weights.clone_from(&self.weights);
        self.weigh();
        if self.effective_size() < renewal.share * self.particles.len() as f64 {
            std::mem::swap(&mut self.weights, &mut self.spare_weights);
            self.renew(&measurement, z, renewal.bandwidth, rng)?;
        }
        Ok(innovation)
    }

    /// Logarithms of what the weights would be with the reading, and the innovation of the cloud's mean prediction.
    fn expect<const M: usize>(
        &mut self,
        measurement: &impl Measurement<N, M>,
        z: &SVector<f64, M>,
    ) -> Result<Innovation<M>, Skipped> {
        self.logs.clear();
        let mut shift = SVector::<f64, M>::zeros();
        let mut second = SMatrix::<f64, M, M>::zeros();
        let mut known = 0.0;
        for (particle, &weight) in self.particles.iter().zip(&self.weights) {
            let Some(expected) = measurement.predict(particle) else {
                self.logs.push(f64::NEG_INFINITY);
                continue;
            };
            let r = measurement.noise(particle);
            let residual = measurement.residual(z, &expected);
            self.logs.push(weight.ln() + log_density(&residual, &r).ok_or(Skipped::NotPositiveDefinite)?);
            shift += residual * weight;
            second += (residual * residual.transpose() + r) * weight;
            known += weight;
        }
        if !self.logs.iter().any(|log| log.is_finite()) {
            return Err(Skipped::NoPrediction);
        }
        let residual = shift / known;
        let covariance = symmetrised(second / known - residual * residual.transpose());
        Innovation::of(residual, covariance).ok_or(Skipped::NotPositiveDefinite)
    }

    /// Takes the weights from their logarithms.
    fn weigh(&mut self) {
        let largest = self.logs.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        for (weight, log) in self.weights.iter_mut().zip(&self.logs) {
            *weight = (log - largest).exp();
        }
        let total: f64 = self.weights.iter().sum();
        self.weights.iter_mut().for_each(|weight| *weight /= total);
    }

    /// Draws the cloud anew; see [`Self::update_or_renew`].
    fn renew<const M: usize>(
        &mut self,
        measurement: &impl Measurement<N, M>,
        z: &SVector<f64, M>,
        bandwidth: f64,
        rng: &mut impl Rng,
    ) -> Result<(), Skipped> {
        let moments = self.moments();
        let kernel = moments.covariance * (bandwidth * bandwidth);
        let spread = kernel.cholesky().ok_or(Skipped::NotPositiveDefinite)?;
        let shrink = (1.0 - bandwidth * bandwidth).max(0.0).sqrt();
        self.logs.clear();
        self.conditioned.clear();
        for (particle, weight) in self.particles.iter().zip(&self.weights) {
            let centre = moments.mean + (particle - moments.mean) * shrink;
            let part = Conditioned::new(centre, &kernel, measurement, z);
            self.logs.push(part.as_ref().map_or(f64::NEG_INFINITY, |part| weight.ln() + part.log_evidence));
            self.conditioned.push(part);
        }
        if !self.logs.iter().any(|log| log.is_finite()) {
            return Err(Skipped::NoPrediction);
        }
        self.weigh();
        self.draw_sources(rng);
        self.spare.clear();
        self.spare.extend((0..self.particles.len()).map(|_| normal::<N>(rng)));
        standardise(&mut self.spare);
        self.logs.clear();
        for ((particle, &source), normal) in self.particles.iter_mut().zip(&self.sources).zip(&self.spare) {
            let Some(part) = &self.conditioned[source] else {
                self.logs.push(f64::NEG_INFINITY);
                continue;
            };
            *particle = part.mean + part.factor * normal;
            let likelihood = measurement
                .predict(particle)
                .and_then(|expected| log_density(&measurement.residual(z, &expected), &measurement.noise(particle)));
            let offset = *particle - part.centre;
            let prior = -0.5 * offset.dot(&spread.solve(&offset)) - spread.l().diagonal().map(f64::ln).sum();
            let proposal = -0.5 * normal.norm_squared() - part.factor.diagonal().map(f64::ln).sum();
            self.logs.push(likelihood.map_or(f64::NEG_INFINITY, |log| log + prior - proposal - part.log_evidence));
        }
        self.weigh();
        Ok(())
    }

    /// Indices of the particles that systematic resampling with one random number chooses (Kitagawa 1996).
    fn draw_sources(&mut self, rng: &mut impl Rng) {
        let count = self.particles.len();
        let step = 1.0 / count as f64;
        let start = rng.random::<f64>() * step;
        let (mut source, mut reached) = (0, self.weights[0]);
        self.sources.clear();
        for i in 0..count {
            let target = start + i as f64 * step;
            while reached < target && source + 1 < count {
                source += 1;
                reached += self.weights[source];
            }
            self.sources.push(source);
        }
    }

    /// Systematic resampling with one random number (Kitagawa 1996), then a Gaussian kernel of `bandwidth` standard deviations
    /// of the cloud, with the particles drawn towards the mean by `sqrt(1 - bandwidth^2)` so that mean and covariance
    /// stay (Liu and West 2001).
    pub fn resample(&mut self, bandwidth: f64, rng: &mut impl Rng) {
        let moments = self.moments();
        let step = 1.0 / self.particles.len() as f64;
        self.draw_sources(rng);
        self.spare.clear();
        self.spare.extend(self.sources.iter().map(|&source| self.particles[source]));
        std::mem::swap(&mut self.particles, &mut self.spare);
        self.weights.fill(step);

        if let Some(factor) = (moments.covariance * (bandwidth * bandwidth)).cholesky() {
            let kernel = factor.l();
            let shrink = (1.0 - bandwidth * bandwidth).max(0.0).sqrt();
            for particle in &mut self.particles {
                *particle = moments.mean + (*particle - moments.mean) * shrink + kernel * normal(rng);
            }
        }
    }
}

/// How [`Cloud::update_or_renew`] weighs a reading, and when and how it draws the cloud anew.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Renewal {
    /// Least effective sample size, as a share of the particles.
    pub share: f64,
    /// Width of the kernels, in standard deviations of the cloud.
    pub bandwidth: f64,
    /// Bound of a reading's influence, as in [`crate::bounded`].
    pub gate_sds: f64,
}

/// A kernel conditioned on the reading.
#[derive(Clone, Debug, PartialEq)]
struct Conditioned<const N: usize> {
    centre: SVector<f64, N>,
    mean: SVector<f64, N>,
    /// Lower factor of the covariance.
    factor: SMatrix<f64, N, N>,
    log_evidence: f64,
}

impl<const N: usize> Conditioned<N> {
    /// Nothing where the model has no prediction.
    fn new<const M: usize>(
        centre: SVector<f64, N>,
        kernel: &SMatrix<f64, N, N>,
        measurement: &impl Measurement<N, M>,
        z: &SVector<f64, M>,
    ) -> Option<Self> {
        let mut belief = Gaussian::new(centre, *kernel);
        let innovation = extended::update(&mut belief, measurement, z).ok()?;
        let factor = belief.covariance.cholesky()?.l();
        Some(Self { centre, mean: belief.mean, factor, log_evidence: innovation.log_likelihood() })
    }
}

/// `ln N(y; 0, S)`, but for a constant; nothing unless S is positive definite.
fn log_density<const M: usize>(y: &SVector<f64, M>, s: &SMatrix<f64, M, M>) -> Option<f64> {
    let factor = s.cholesky()?;
    Some(-0.5 * y.dot(&factor.solve(y)) - factor.l().diagonal().map(f64::ln).sum())
}

/// Moves and scales numbers drawn from the standard normal distribution so that their mean is zero and their covariance the identity: of what
/// chance does to the moments of a small cloud this leaves little. Too few for a covariance stay as they are.
fn standardise<const N: usize>(draws: &mut [SVector<f64, N>]) {
    let count = draws.len() as f64;
    let mean = draws.iter().sum::<SVector<f64, N>>() / count;
    let covariance =
        draws.iter().map(|draw| (draw - mean) * (draw - mean).transpose()).sum::<SMatrix<f64, N, N>>() / count;
    let Some(factor) = covariance.cholesky().map(|factor| factor.l()) else { return };
    for draw in draws {
        *draw -= mean;
        factor.solve_lower_triangular_mut(draw);
    }
}

fn normal<const N: usize>(rng: &mut impl Rng) -> SVector<f64, N> {
    SVector::from_fn(|_, _| rng.sample(StandardNormal))
}
