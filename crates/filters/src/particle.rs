//! Particle filter: sequential importance resampling (Gordon, Salmond and Smith 1993) with systematic resampling when
//! the effective sample size falls (Kitagawa 1996; Liu and Chen 1998) and kernel smoothing with shrinkage, which
//! restores diversity without inflating the covariance (Liu and West 2001).
//!
//! Readings are scalar. Buffers are reused: only the first step of each kind allocates.

use nalgebra::{Cholesky, Const, Matrix1, SMatrix, SVector, Vector1};
use rand::{Rng, RngExt};

use crate::robust::InflatedNoise;
use crate::simd::{self, Column};
use crate::vectorised;
use crate::{Gaussian, Innovation, Measurement, Process, StateArray, UpdateError, extended};

/// Belief represented by weighted particles.
#[derive(Clone, Debug, PartialEq)]
pub struct ParticleSet<const N: usize> {
    particles: StateArray<N>,
    /// Normalised weights, one per particle.
    weights: Column,
    /// Logarithms of the weights, up to a common constant. They rank particles whose weights underflow.
    logs: Column,
    scratch: Scratch<N>,
}

/// Buffers, kept between steps.
#[derive(Clone, Debug, PartialEq)]
struct Scratch<const N: usize> {
    particles: StateArray<N>,
    weights: Column,
    logs: Column,
    expected: StateArray<1>,
    residuals: Column,
    /// Measurement noise variance at each particle, if it depends on the state.
    variances: Column,
    conditioned: Vec<Option<Conditioned<N>>>,
    /// Index of the parent of each new particle, and one spare element.
    sources: Vec<usize>,
}

impl<const N: usize> ParticleSet<N> {
    /// Particle set with equal weights.
    ///
    /// # Panics
    /// If there are no particles.
    pub fn new(particles: StateArray<N>) -> Self {
        assert!(!particles.is_empty(), "a particle set needs at least one particle");
        let count = particles.len();
        let scratch = Scratch {
            particles: StateArray::zeros(count),
            weights: simd::column(count, 0.0),
            logs: simd::column(count, 0.0),
            expected: StateArray::zeros(count),
            residuals: simd::column(count, 0.0),
            variances: simd::column(count, 0.0),
            conditioned: Vec::with_capacity(count),
            sources: vec![0; count + 1],
        };
        Self { particles, weights: simd::column(count, 1.0 / count as f64), logs: simd::column(count, 0.0), scratch }
    }

    /// Particles.
    pub fn particles(&self) -> &StateArray<N> {
        &self.particles
    }

    /// Normalised weights.
    pub fn weights(&self) -> &[f64] {
        &self.weights
    }

    /// Weighted mean.
    pub fn mean(&self) -> SVector<f64, N> {
        vectorised!(mean(&self.particles, &self.weights))
    }

    /// Weighted mean and covariance.
    pub fn moments(&self) -> Gaussian<N> {
        vectorised!(moments(&self.particles, &self.weights))
    }

    /// Effective sample size, `1 / sum w^2`.
    pub fn effective_size(&self) -> f64 {
        1.0 / vectorised!(sum_of_squares(&self.weights))
    }

    /// Applies `change` to every particle, for example to enforce bounds.
    pub fn map(&mut self, change: impl Fn(&SVector<f64, N>) -> SVector<f64, N>) {
        for index in 0..self.particles.len() {
            self.particles.set(index, &change(&self.particles.get(index)));
        }
    }

    /// Fading memory: moves the particles away from their mean so that the covariance is scaled by `alpha`.
    pub fn fade(&mut self, alpha: f64) {
        if alpha != 1.0 {
            let mean = self.mean();
            vectorised!(scale(&mut self.particles, mean, alpha.sqrt()));
        }
    }

    /// Propagates every particle through the process and adds process noise. As in the Gaussian filters, the noise
    /// covariance is that at the mean.
    pub fn predict(&mut self, process: &impl Process<N>, rng: &mut impl Rng) {
        let noise = process.constant_noise().unwrap_or_else(|| process.noise(&self.mean()));
        process.predict_each(&mut self.particles);
        if let Some(factor) = noise.cholesky() {
            self.add_noise(factor.l(), rng);
        }
    }

    /// Multiplies the weights by the likelihood of the reading. The returned innovation is relative to the mean predicted reading.
    ///
    /// # Errors
    /// [`UpdateError`] if the model is undefined at every particle or a variance is not positive; the particle set is unchanged.
    pub fn update(
        &mut self,
        measurement: &impl Measurement<N, 1>,
        z: &Vector1<f64>,
    ) -> Result<Innovation<1>, UpdateError> {
        let innovation = self.evaluate(measurement, z)?;
        self.accept_weights();
        Ok(innovation)
    }

    /// Updates the weights as [`Self::update`] does, with the influence of the reading bounded as in [`crate::robust`].
    /// If the effective sample size would fall below [`Renewal::share`], the particles are drawn anew from a proposal
    /// that uses the reading.
    ///
    /// Each particle is the centre of a Gaussian kernel of `bandwidth` standard deviations of the particle set, shrunk
    /// towards the mean so that mean and covariance are preserved (Liu and West 2001). Kernels are selected by their
    /// marginal likelihood of the reading and conditioned on it by an extended Kalman update, from which the new
    /// particle is drawn (auxiliary particle filter of Pitt and Shephard 1999, with the linearised optimal proposal of
    /// Doucet, Godsill and Andrieu 2000). Importance weights correct for the linearisation.
    ///
    /// # Errors
    /// [`UpdateError`] as for [`Self::update`], or if the covariance of the particles is singular; the particle set is unchanged.
    pub fn update_or_renew(
        &mut self,
        measurement: &impl Measurement<N, 1>,
        z: &Vector1<f64>,
        renewal: &Renewal,
        rng: &mut impl Rng,
    ) -> Result<Innovation<1>, UpdateError> {
        let innovation = self.evaluate(measurement, z)?;
        let mut measurement = InflatedNoise { model: measurement, factor: 1.0 };
        if innovation.nis > renewal.gate_sds * renewal.gate_sds {
            measurement = measurement.at_gate(&self.mean(), &innovation, renewal.gate_sds);
            self.evaluate(&measurement, z)?;
        }
        self.accept_weights();
        if self.effective_size() < renewal.share * self.particles.len() as f64 {
            self.restore_weights();
            self.renew(&measurement, z, renewal.bandwidth, rng)?;
        }
        Ok(innovation)
    }

    /// Writes the logarithms of the updated weights to the scratch buffer and returns the innovation relative to the
    /// mean predicted reading.
    fn evaluate(
        &mut self,
        measurement: &impl Measurement<N, 1>,
        z: &Vector1<f64>,
    ) -> Result<Innovation<1>, UpdateError> {
        let Scratch { logs, expected, residuals, variances, .. } = &mut self.scratch;
        let residual = |expected| measurement.residual(z, &Vector1::new(expected))[0];
        let (sums, variance) = if let Some(noise) = measurement.constant_noise() {
            if !is_positive(noise[0]) {
                return Err(UpdateError::NotPositiveDefinite);
            }
            measurement.predict_each(&self.particles, expected);
            let expected = expected.column(0);
            vectorised!(log_weights_constant_noise(residual, expected, noise[0], &self.logs, residuals, logs));
            let sums = vectorised!(residual_sums(&self.weights, residuals));
            let variance = noise[0] * sums.weight;
            (sums, variance)
        } else {
            for (index, (variance, particle)) in variances.iter_mut().zip(self.particles.iter()).enumerate() {
                let found = measurement.predict_with_noise(&particle).filter(|(expected, _)| !expected[0].is_nan());
                let (at_particle, noise) = found.unwrap_or_else(|| (Vector1::repeat(f64::NAN), Matrix1::identity()));
                expected.set(index, &at_particle);
                *variance = noise[0];
            }
            if !variances.iter().all(|&variance| is_positive(variance)) {
                return Err(UpdateError::NotPositiveDefinite);
            }
            vectorised!(log_weights(residual, expected.column(0), variances, &self.logs, residuals, logs));
            let sums = vectorised!(residual_sums(&self.weights, residuals));
            (sums, vectorised!(total_variance(&self.weights, residuals, variances)))
        };
        if vectorised!(simd::largest(logs)) == f64::NEG_INFINITY {
            return Err(UpdateError::NoPrediction);
        }
        let residual = sums.first / sums.weight;
        let covariance = (sums.second + variance) / sums.weight - residual * residual;
        Innovation::of(Vector1::new(residual), Matrix1::new(covariance)).ok_or(UpdateError::NotPositiveDefinite)
    }

    /// Replaces the weights by those in the scratch buffer, which keeps the old ones.
    fn accept_weights(&mut self) {
        std::mem::swap(&mut self.logs, &mut self.scratch.logs);
        std::mem::swap(&mut self.weights, &mut self.scratch.weights);
        vectorised!(normalise(&mut self.weights, &mut self.logs));
    }

    /// Undoes [`Self::accept_weights`].
    fn restore_weights(&mut self) {
        std::mem::swap(&mut self.logs, &mut self.scratch.logs);
        std::mem::swap(&mut self.weights, &mut self.scratch.weights);
    }

    /// Draws the particles anew; see [`Self::update_or_renew`].
    fn renew(
        &mut self,
        measurement: &impl Measurement<N, 1>,
        z: &Vector1<f64>,
        bandwidth: f64,
        rng: &mut impl Rng,
    ) -> Result<(), UpdateError> {
        let moments = self.moments();
        let kernel = moments.covariance * (bandwidth * bandwidth);
        let spread = kernel.cholesky().ok_or(UpdateError::NotPositiveDefinite)?;
        let shrink = (1.0 - bandwidth * bandwidth).max(0.0).sqrt();
        let Scratch { logs, conditioned, .. } = &mut self.scratch;
        conditioned.clear();
        for ((particle, old), log) in self.particles.iter().zip(&*self.logs).zip(logs.iter_mut()) {
            let centre = moments.mean + (particle - moments.mean) * shrink;
            let part = Conditioned::new(centre, &kernel, measurement, z);
            *log = part.as_ref().map_or(f64::NEG_INFINITY, |part| old + part.log_evidence);
            conditioned.push(part);
        }
        if vectorised!(simd::largest(logs)) == f64::NEG_INFINITY {
            return Err(UpdateError::NoPrediction);
        }
        self.accept_weights();
        self.draw_sources(rng);
        simd::fill_normal(self.scratch.particles.values_mut(), rng);
        standardise(&mut self.scratch.particles);
        let Scratch { logs, conditioned, sources, particles: normals, .. } = &mut self.scratch;
        for (index, log) in logs.iter_mut().enumerate() {
            let drawn = conditioned[sources[index]].as_ref().map(|part| part.draw(&normals.get(index)));
            *log = drawn.as_ref().map_or(f64::NEG_INFINITY, |drawn| drawn.log_weight(measurement, z, &spread));
            if let Some(drawn) = drawn {
                self.particles.set(index, &drawn.particle);
            }
        }
        self.accept_weights();
        Ok(())
    }

    /// Draws the parents of the new particles by systematic resampling with one random number (Kitagawa 1996).
    fn draw_sources(&mut self, rng: &mut impl Rng) {
        vectorised!(systematic_sources(&self.weights, &mut self.scratch.sources, rng.random::<f64>()));
    }

    /// Systematic resampling with one random number (Kitagawa 1996), followed by a Gaussian kernel of `bandwidth`
    /// standard deviations of the particle set. The particles are shrunk towards the mean by `sqrt(1 - bandwidth^2)`,
    /// which preserves mean and covariance (Liu and West 2001). A bandwidth of zero adds no noise.
    pub fn resample(&mut self, bandwidth: f64, rng: &mut impl Rng) {
        let moments = self.moments();
        self.draw_sources(rng);
        let Scratch { particles, sources, .. } = &mut self.scratch;
        for (number, column) in particles.columns_mut().into_iter().enumerate() {
            let from = self.particles.column(number);
            column.iter_mut().zip(&*sources).for_each(|(value, &source)| *value = from[source]);
        }
        std::mem::swap(&mut self.particles, particles);
        self.weights.fill(1.0 / self.particles.len() as f64);
        self.logs.fill(0.0);

        if let Some(factor) = (moments.covariance * (bandwidth * bandwidth)).cholesky() {
            let shrink = (1.0 - bandwidth * bandwidth).max(0.0).sqrt();
            vectorised!(scale(&mut self.particles, moments.mean, shrink));
            self.add_noise(factor.l(), rng);
        }
    }

    /// Adds Gaussian noise to every particle; `factor` is the lower Cholesky factor of its covariance.
    fn add_noise(&mut self, factor: SMatrix<f64, N, N>, rng: &mut impl Rng) {
        simd::fill_normal(self.scratch.particles.values_mut(), rng);
        vectorised!(add_product(&mut self.particles, factor, &self.scratch.particles));
    }
}

/// Settings of [`ParticleSet::update_or_renew`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Renewal {
    /// Effective sample size below which the particles are drawn anew, as a share of their number.
    pub share: f64,
    /// Bandwidth of the kernels, in standard deviations of the particle set.
    pub bandwidth: f64,
    /// Gate in standard deviations beyond which the influence of a reading is bounded, as in [`crate::robust`].
    pub gate_sds: f64,
}

/// Kernel conditioned on the reading.
#[derive(Clone, Debug, PartialEq)]
struct Conditioned<const N: usize> {
    centre: SVector<f64, N>,
    mean: SVector<f64, N>,
    /// Lower Cholesky factor of the covariance.
    factor: SMatrix<f64, N, N>,
    log_evidence: f64,
}

impl<const N: usize> Conditioned<N> {
    /// Conditions a kernel at `centre`. `None` if the model is undefined there.
    fn new(
        centre: SVector<f64, N>,
        kernel: &SMatrix<f64, N, N>,
        measurement: &impl Measurement<N, 1>,
        z: &Vector1<f64>,
    ) -> Option<Self> {
        let mut belief = Gaussian::new(centre, *kernel);
        let innovation = extended::update(&mut belief, measurement, z).ok()?;
        let factor = belief.covariance.cholesky()?.l();
        Some(Self { centre, mean: belief.mean, factor, log_evidence: innovation.log_likelihood() })
    }

    /// Particle of the conditioned kernel for a standard normal draw.
    fn draw(&self, normal: &SVector<f64, N>) -> Drawn<'_, N> {
        Drawn { particle: self.mean + self.factor * normal, source: self, normal: *normal }
    }
}

/// Particle drawn from a conditioned kernel.
struct Drawn<'a, const N: usize> {
    particle: SVector<f64, N>,
    source: &'a Conditioned<N>,
    normal: SVector<f64, N>,
}

impl<const N: usize> Drawn<'_, N> {
    /// Logarithm of the importance weight: likelihood times prior density under the kernel, whose factor is `spread`,
    /// divided by the proposal density and the marginal likelihood by which the kernel was selected. Minus infinity if
    /// the model is undefined at the particle.
    fn log_weight(
        &self,
        measurement: &impl Measurement<N, 1>,
        z: &Vector1<f64>,
        spread: &Cholesky<f64, Const<N>>,
    ) -> f64 {
        let Some((expected, noise)) = measurement.predict_with_noise(&self.particle) else { return f64::NEG_INFINITY };
        let variance = noise[0];
        if !is_positive(variance) {
            return f64::NEG_INFINITY;
        }
        let residual = measurement.residual(z, &expected)[0];
        let likelihood = -0.5 * (residual * residual / variance + variance.ln());
        let offset = self.particle - self.source.centre;
        let prior = -0.5 * offset.dot(&spread.solve(&offset)) - spread.l_dirty().diagonal().map(f64::ln).sum();
        let proposal = -0.5 * self.normal.norm_squared() - self.source.factor.diagonal().map(f64::ln).sum();
        likelihood + prior - proposal - self.source.log_evidence
    }
}

/// Whether a variance is positive; false for NaN.
fn is_positive(variance: f64) -> bool {
    variance > 0.0
}

/// Shifts and scales standard normal draws to exactly zero mean and identity covariance (moment matching), which
/// reduces the Monte-Carlo error of a small particle set. Draws whose covariance is singular are unchanged.
fn standardise<const N: usize>(draws: &mut StateArray<N>) {
    let count = draws.len() as f64;
    let mean = draws.iter().sum::<SVector<f64, N>>() / count;
    let covariance =
        draws.iter().map(|draw| (draw - mean) * (draw - mean).transpose()).sum::<SMatrix<f64, N, N>>() / count;
    let Some(factor) = covariance.cholesky().map(|factor| factor.l()) else { return };
    for index in 0..draws.len() {
        let mut draw = draws.get(index) - mean;
        factor.solve_lower_triangular_mut(&mut draw);
        draws.set(index, &draw);
    }
}

#[inline(always)]
fn mean<const N: usize>(particles: &StateArray<N>, weights: &[f64]) -> SVector<f64, N> {
    let mut mean = SVector::zeros();
    for number in 0..N {
        mean[number] = simd::sum([weights, particles.column(number)], |[w, x]| w * x);
    }
    mean
}

#[inline(always)]
fn moments<const N: usize>(particles: &StateArray<N>, weights: &[f64]) -> Gaussian<N> {
    let mean = mean(particles, weights);
    let mut covariance = SMatrix::zeros();
    for i in 0..N {
        for j in 0..=i {
            let columns = [weights, particles.column(i), particles.column(j)];
            let both = simd::sum(columns, |[w, a, b]| w * (a - mean[i]) * (b - mean[j]));
            (covariance[(i, j)], covariance[(j, i)]) = (both, both);
        }
    }
    Gaussian::new(mean, covariance)
}

#[inline(always)]
fn sum_of_squares(weights: &[f64]) -> f64 {
    simd::sum([weights], |[w]| w * w)
}

/// Scales the distances of the particles from a centre by `factor`.
#[inline(always)]
fn scale<const N: usize>(particles: &mut StateArray<N>, centre: SVector<f64, N>, factor: f64) {
    for (column, centre) in particles.columns_mut().into_iter().zip(&centre) {
        column.iter_mut().for_each(|value| *value = centre + (*value - centre) * factor);
    }
}

/// Adds the product of a lower triangular matrix and the other states.
#[inline(always)]
fn add_product<const N: usize>(particles: &mut StateArray<N>, factor: SMatrix<f64, N, N>, others: &StateArray<N>) {
    for (i, column) in particles.columns_mut().into_iter().enumerate() {
        for j in (0..=i).filter(|&j| factor[(i, j)] != 0.0) {
            let part = factor[(i, j)];
            column.iter_mut().zip(others.column(j)).for_each(|(value, other)| *value += part * other);
        }
    }
}

/// Weighted sums over the particles at which the model is defined.
struct ResidualSums {
    /// Sum of the weights.
    weight: f64,
    /// Sum of the residuals.
    first: f64,
    /// Sum of the squared residuals.
    second: f64,
}

#[inline(always)]
fn residual_sums(weights: &[f64], residuals: &[f64]) -> ResidualSums {
    let columns = [weights, residuals];
    ResidualSums {
        weight: simd::sum(columns, |[w, r]| if r.is_nan() { 0.0 } else { w }),
        first: simd::sum(columns, |[w, r]| if r.is_nan() { 0.0 } else { w * r }),
        second: simd::sum(columns, |[w, r]| if r.is_nan() { 0.0 } else { w * (r * r) }),
    }
}

/// Weighted sum of the measurement noise variances over the particles at which the model is defined.
#[inline(always)]
fn total_variance(weights: &[f64], residuals: &[f64], variances: &[f64]) -> f64 {
    simd::sum([weights, residuals, variances], |[w, r, variance]| if r.is_nan() { 0.0 } else { w * variance })
}

/// Writes the residuals and the logarithms of the updated weights, up to a common constant, for a constant noise variance.
#[inline(always)]
fn log_weights_constant_noise(
    residual: impl Fn(f64) -> f64,
    expected: &[f64],
    variance: f64,
    before: &[f64],
    residuals: &mut [f64],
    logs: &mut [f64],
) {
    let factor = -0.5 / variance;
    for (((log, written), &before), &expected) in logs.iter_mut().zip(residuals).zip(before).zip(expected) {
        let residual = residual(expected);
        *written = residual;
        *log = if residual.is_nan() { f64::NEG_INFINITY } else { before + factor * (residual * residual) };
    }
}

/// Writes the residuals and the logarithms of the updated weights, up to a common constant, for a noise variance per particle.
#[inline(always)]
fn log_weights(
    residual: impl Fn(f64) -> f64,
    expected: &[f64],
    variances: &[f64],
    before: &[f64],
    residuals: &mut [f64],
    logs: &mut [f64],
) {
    let numbers = before.iter().zip(expected).zip(variances);
    for ((log, written), ((&before, &expected), &variance)) in logs.iter_mut().zip(residuals).zip(numbers) {
        let residual = residual(expected);
        *written = residual;
        let density = -0.5 * (residual * residual / variance + simd::ln(variance));
        *log = if residual.is_nan() { f64::NEG_INFINITY } else { before + density };
    }
}

/// Writes the normalised weights of given logarithms, which are shifted so that the largest is zero.
#[inline(always)]
fn normalise(weights: &mut [f64], logs: &mut [f64]) {
    let largest = simd::largest(logs);
    for (weight, log) in weights.iter_mut().zip(logs) {
        *log -= largest;
        *weight = simd::exp(*log);
    }
    let share = 1.0 / simd::sum([&*weights], |[w]| w);
    weights.iter_mut().for_each(|weight| *weight *= share);
}

/// Writes the index of the particle into whose interval of the cumulative weights each of the evenly spaced pointers
/// `(i + start) / count` falls.
#[inline(always)]
fn systematic_sources(weights: &[f64], sources: &mut [usize], start: f64) {
    let count = weights.len();
    sources.fill(0);
    let mut reached = 0.0;
    for (source, weight) in weights.iter().enumerate() {
        // First pointer within or after this particle's interval. A particle without pointers is overwritten by the next one.
        let first = (reached * count as f64 - start).ceil() as usize;
        sources[first.min(count)] = source;
        reached += weight;
    }
    let mut last = 0;
    for source in sources {
        last = last.max(*source);
        *source = last;
    }
}
