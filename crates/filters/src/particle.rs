//! The particle filter: sequential importance resampling (Gordon, Salmond and Smith 1993) with systematic resampling
//! when the effective sample size falls (Kitagawa 1996; Liu and Chen 1998) and a shrinking kernel that keeps the cloud
//! diverse without widening it (Liu and West 2001).

use nalgebra::{SMatrix, SVector};
use rand::{Rng, RngExt};
use rand_distr::StandardNormal;

use crate::gaussian::symmetrised;
use crate::{Gaussian, Innovation, Measurement, Process, Skipped};

/// A belief made of weighted particles.
#[derive(Clone, Debug, PartialEq)]
pub struct Cloud<const N: usize> {
    particles: Vec<SVector<f64, N>>,
    /// Normalised weights, one a particle.
    weights: Vec<f64>,
    /// Kept between steps so that neither resampling nor weighing allocates.
    spare: Vec<SVector<f64, N>>,
    logs: Vec<f64>,
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
        Self { particles, weights, spare: Vec::with_capacity(count), logs: Vec::with_capacity(count) }
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
        let mean = self.mean();
        let scale = alpha.sqrt();
        self.map(|particle| mean + (particle - mean) * scale);
    }

    /// Carries every particle through the process and draws its noise.
    pub fn predict(&mut self, process: &impl Process<N>, rng: &mut impl Rng) {
        // Most processes have the same noise everywhere; its factor is then taken once.
        let mut last: Option<(SMatrix<f64, N, N>, SMatrix<f64, N, N>)> = None;
        for particle in &mut self.particles {
            let noise = process.noise(particle);
            *particle = process.predict(particle);
            if last.is_none_or(|(of, _)| of != noise) {
                last = Some((noise, noise.cholesky().map_or_else(SMatrix::zeros, |factor| factor.l())));
            }
            if let Some((_, factor)) = last {
                *particle += factor * normal(rng);
            }
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
        self.logs.clear();
        let mut largest = f64::NEG_INFINITY;
        let mut shift = SVector::<f64, M>::zeros();
        let mut second = SMatrix::<f64, M, M>::zeros();
        let mut known = 0.0;
        for (particle, &weight) in self.particles.iter().zip(&self.weights) {
            let Some(expected) = measurement.predict(particle) else {
                self.logs.push(f64::NEG_INFINITY);
                continue;
            };
            let r = measurement.noise(particle);
            let factor = r.cholesky().ok_or(Skipped::NotPositiveDefinite)?;
            let residual = measurement.residual(z, &expected);
            let log = weight.ln() - 0.5 * residual.dot(&factor.solve(&residual)) - 0.5 * factor.determinant().ln();
            self.logs.push(log);
            largest = largest.max(log);
            shift += residual * weight;
            second += (residual * residual.transpose() + r) * weight;
            known += weight;
        }
        if !largest.is_finite() {
            return Err(Skipped::NoPrediction);
        }
        let residual = shift / known;
        let covariance = symmetrised(second / known - residual * residual.transpose());
        let factor = covariance.cholesky().ok_or(Skipped::NotPositiveDefinite)?;
        for (weight, log) in self.weights.iter_mut().zip(&self.logs) {
            *weight = (log - largest).exp();
        }
        let total: f64 = self.weights.iter().sum();
        for weight in &mut self.weights {
            *weight /= total;
        }
        Ok(Innovation::new(residual, covariance, &factor))
    }

    /// Systematic resampling with one random number (Kitagawa 1996), then a Gaussian kernel of `bandwidth` standard deviations
    /// of the cloud, with the particles drawn towards the mean by `sqrt(1 - bandwidth^2)` so that mean and covariance
    /// stay (Liu and West 2001).
    pub fn resample(&mut self, bandwidth: f64, rng: &mut impl Rng) {
        let moments = self.moments();
        let count = self.particles.len();
        let step = 1.0 / count as f64;
        let mut target = rng.random::<f64>() * step;
        let mut reached = self.weights[0];
        let mut source = 0;
        self.spare.clear();
        for _ in 0..count {
            while reached < target && source + 1 < count {
                source += 1;
                reached += self.weights[source];
            }
            self.spare.push(self.particles[source]);
            target += step;
        }
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

fn normal<const N: usize>(rng: &mut impl Rng) -> SVector<f64, N> {
    SVector::from_fn(|_, _| rng.sample(StandardNormal))
}
