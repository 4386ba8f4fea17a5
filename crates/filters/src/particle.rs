//! Particle filter: sequential importance resampling (Gordon, Salmond and Smith 1993) with systematic resampling when
//! the effective sample size falls (Kitagawa 1996; Liu and Chen 1998) and kernel smoothing with shrinkage, which
//! restores diversity without inflating the covariance (Liu and West 2001).
//!
//! Readings are scalar. Buffers are reused: only the first step of each kind allocates.

mod weights;

use fearless_simd::prelude::*;
use nalgebra::{Cholesky, Const, Matrix1, SMatrix, SVector, Vector1};
use rand::{Rng, RngExt};
use rand_distr::StandardNormal;

use crate::robust::InflatedNoise;
use crate::simd::{self, Column, GROUPS, Generator, LANES, Rows, of_group};
use crate::vectorised;
use crate::{Gaussian, Innovation, Measurement, Process, StateArray, UpdateError, extended};
use weights::{Before, Sums};

/// Belief represented by weighted particles.
#[derive(Clone, Debug)]
pub struct ParticleSet<const N: usize> {
    particles: StateArray<N>,
    /// Normalised weights, one per particle, [padded](simd::padded) as all columns.
    weights: Column,
    /// Logarithms of the weights, up to a common constant. They rank particles whose weights underflow.
    logs: Column,
    summary: Summary,
    scratch: Scratch<N>,
}

/// Quantities of the weights that are computed along with them.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Summary {
    /// Largest logarithm.
    largest_log: f64,
    effective_size: f64,
}

impl Summary {
    /// Summary of equal weights, whose logarithms are zero.
    fn of_equal_weights(count: usize) -> Self {
        Self { largest_log: 0.0, effective_size: count as f64 }
    }
}

/// Buffers, kept between steps.
#[derive(Clone, Debug)]
struct Scratch<const N: usize> {
    particles: StateArray<N>,
    weights: Column,
    logs: Column,
    summary: Summary,
    /// Residual of the reading at each particle, NaN where the model is undefined.
    residuals: StateArray<1>,
    /// Measurement noise variance at each particle, if it depends on the state.
    variances: Column,
    conditioned: Vec<Option<Conditioned<N>>>,
    /// Index of the parent of each new particle, and one spare element.
    sources: Vec<usize>,
}

impl<const N: usize> Scratch<N> {
    /// Stores the residual of the reading at a particle and the variance of its noise.
    fn compare(&mut self, index: usize, found: Option<(f64, f64)>) {
        let (residual, variance) = found.filter(|(residual, _)| !residual.is_nan()).unwrap_or((f64::NAN, 1.0));
        self.residuals.set(index, &Vector1::new(residual));
        self.variances[index] = variance;
    }

    /// Stores the largest logarithm and returns the innovation relative to the mean predicted reading.
    fn innovation(&mut self, sums: &Sums) -> Result<Innovation<1>, UpdateError> {
        self.summary.largest_log = sums.largest_log;
        if sums.largest_log == f64::NEG_INFINITY {
            return Err(UpdateError::NoPrediction);
        }
        let residual = sums.first / sums.weight;
        let covariance = (sums.second + sums.variance) / sums.weight - residual * residual;
        Innovation::of(Vector1::new(residual), Matrix1::new(covariance)).ok_or(UpdateError::NotPositiveDefinite)
    }
}

/// Share of the variance of a component below which that part of it that is independent of the earlier ones counts as zero.
const SINGULAR: f64 = 1e-12;

/// Lower triangular factor of a covariance. Components without variance of their own have columns of zeros.
fn factor<const N: usize>(covariance: &SMatrix<f64, N, N>) -> SMatrix<f64, N, N> {
    if let Some(definite) = covariance.cholesky() {
        return definite.l();
    }
    let mut factor = SMatrix::<f64, N, N>::zeros();
    for j in 0..N {
        let left = |i: usize| covariance[(i, j)] - (0..j).map(|k| factor[(i, k)] * factor[(j, k)]).sum::<f64>();
        let pivot = left(j);
        if pivot > SINGULAR * covariance[(j, j)] {
            let column: SVector<f64, N> = SVector::from_fn(|i, _| if i < j { 0.0 } else { left(i) / pivot.sqrt() });
            factor.set_column(j, &column);
        }
    }
    factor
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
            summary: Summary::of_equal_weights(count),
            residuals: StateArray::zeros(count),
            variances: simd::column(count, 0.0),
            conditioned: Vec::with_capacity(count),
            sources: vec![0; count + 1],
        };
        let (weights, logs) = (simd::column(count, 1.0 / count as f64), simd::column(count, 0.0));
        Self { particles, weights, logs, summary: Summary::of_equal_weights(count), scratch }
    }

    /// Particle set with equal weights, drawn from Gaussians in proportion to their weights. Their covariances may be singular.
    /// `None` if no weight is positive, or the sum of the weights is not finite.
    pub fn drawn(parts: &[(Gaussian<N>, f64)], count: usize, rng: &mut impl Rng) -> Option<Self> {
        let total: f64 = parts.iter().map(|(_, weight)| weight).sum();
        let mut particles = Vec::with_capacity(count);
        let mut due = 0.0;
        for (belief, weight) in parts {
            let factor = factor(&belief.covariance);
            due += weight / total * count as f64;
            while particles.len() < due.round() as usize {
                let normal = SVector::from_fn(|_, _| rng.sample(StandardNormal));
                particles.push(belief.mean + factor * normal);
            }
        }
        (!particles.is_empty()).then(|| Self::new(particles.into_iter().collect()))
    }

    /// Particles.
    pub fn particles(&self) -> &StateArray<N> {
        &self.particles
    }

    /// Normalised weights.
    pub fn weights(&self) -> &[f64] {
        &self.weights[..self.particles.len()]
    }

    /// Weighted mean.
    pub fn mean(&self) -> SVector<f64, N> {
        vectorised!(simd => mean(simd, &self.particles, &self.weights))
    }

    /// Weighted mean and covariance.
    pub fn moments(&self) -> Gaussian<N> {
        vectorised!(simd => moments(simd, &self.particles, &self.weights))
    }

    /// Effective sample size, `1 / sum w^2`, between 1 and the number of particles.
    pub fn effective_size(&self) -> f64 {
        self.summary.effective_size
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
    /// covariance is that at the mean; it may be singular.
    pub fn predict(&mut self, process: &impl Process<N>, rng: &mut impl Rng) {
        let noise = process.constant_noise().unwrap_or_else(|| process.noise(&self.mean()));
        process.predict_each(&mut self.particles);
        if noise.iter().any(|entry| *entry != 0.0) {
            self.add_noise(factor(&noise), rng);
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

    /// Updates the weights as [`Self::update`] does, with the expected reading and the variance of its noise by `expect`, `None`
    /// where the model is undefined. It may also move the particle, for example to enforce bounds of the model.
    ///
    /// # Errors
    /// [`UpdateError`] as for [`Self::update`]; the weights are unchanged.
    pub fn move_and_update(
        &mut self,
        expect: impl Fn(&mut SVector<f64, N>) -> Option<(f64, f64)>,
        z: f64,
    ) -> Result<Innovation<1>, UpdateError> {
        for index in 0..self.particles.len() {
            let mut particle = self.particles.get(index);
            let found = expect(&mut particle).map(|(expected, variance)| (z - expected, variance));
            self.particles.set(index, &particle);
            self.scratch.compare(index, found);
        }
        let innovation = self.weigh()?;
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
    /// [`UpdateError`] as for [`Self::update`], or if the covariance of the particles is singular, or the model is undefined at
    /// every new particle; the particle set is unchanged.
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
        self.try_weights();
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
        let residual = |expected: f64| measurement.residual(z, &Vector1::new(expected))[0];
        if let Some(noise) = measurement.constant_noise() {
            if !is_positive(noise[0]) {
                return Err(UpdateError::NotPositiveDefinite);
            }
            let Scratch { logs, residuals, .. } = &mut self.scratch;
            measurement.predict_each(&self.particles, residuals);
            vectorised!(replace_each(residuals, residual));
            let before = Before { weights: &self.weights, logs: &self.logs, largest_log: self.summary.largest_log };
            let sums = weights::log_weights_constant_noise(residuals, noise[0], before, logs);
            return self.scratch.innovation(&sums);
        }
        for (index, particle) in self.particles.iter().enumerate() {
            let found = measurement.predict_with_noise(&particle);
            self.scratch.compare(index, found.map(|(expected, noise)| (residual(expected[0]), noise[0])));
        }
        self.weigh()
    }

    /// Writes the logarithms of the updated weights to the scratch buffer, by the residuals and their variances there.
    fn weigh(&mut self) -> Result<Innovation<1>, UpdateError> {
        let Scratch { logs, residuals, variances, .. } = &mut self.scratch;
        if !variances.iter().take(self.particles.len()).all(|&variance| is_positive(variance)) {
            return Err(UpdateError::NotPositiveDefinite);
        }
        let before = Before { weights: &self.weights, logs: &self.logs, largest_log: self.summary.largest_log };
        let sums = weights::log_weights(residuals, variances, before, logs);
        self.scratch.innovation(&sums)
    }

    /// Replaces the weights by those whose logarithms are in the scratch buffer.
    fn accept_weights(&mut self) {
        std::mem::swap(&mut self.logs, &mut self.scratch.logs);
        std::mem::swap(&mut self.summary, &mut self.scratch.summary);
        let (count, largest_log) = (self.particles.len(), self.summary.largest_log);
        self.summary.effective_size = weights::normalised(count, &self.logs, largest_log, &mut self.weights);
    }

    /// As [`Self::accept_weights`], but keeps the old weights for [`Self::restore_weights`].
    fn try_weights(&mut self) {
        std::mem::swap(&mut self.weights, &mut self.scratch.weights);
        self.accept_weights();
    }

    /// Undoes [`Self::try_weights`].
    fn restore_weights(&mut self) {
        std::mem::swap(&mut self.logs, &mut self.scratch.logs);
        std::mem::swap(&mut self.weights, &mut self.scratch.weights);
        std::mem::swap(&mut self.summary, &mut self.scratch.summary);
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
        self.find_largest_log();
        if self.scratch.summary.largest_log == f64::NEG_INFINITY {
            return Err(UpdateError::NoPrediction);
        }
        self.try_weights();
        self.draw_sources(rng);
        self.restore_weights();
        let seed = rng.next_u64();
        vectorised!(simd => fill_normal(simd, &mut self.scratch.particles, seed));
        standardise(&mut self.scratch.particles);
        // The new particles replace their normals in the buffer: the set is unchanged if the model is undefined at all of them.
        let Scratch { logs, conditioned, sources, particles, .. } = &mut self.scratch;
        for (index, log) in logs.iter_mut().take(self.particles.len()).enumerate() {
            let drawn = conditioned[sources[index]].as_ref().map(|part| part.draw(&particles.get(index)));
            *log = drawn.as_ref().map_or(f64::NEG_INFINITY, |drawn| drawn.log_weight(measurement, z, &spread));
            particles.set(index, &drawn.map_or_else(|| self.particles.get(index), |drawn| drawn.particle));
        }
        self.find_largest_log();
        if self.scratch.summary.largest_log == f64::NEG_INFINITY {
            return Err(UpdateError::NoPrediction);
        }
        std::mem::swap(&mut self.particles, &mut self.scratch.particles);
        self.accept_weights();
        Ok(())
    }

    /// Finds the largest logarithm in the scratch buffer.
    fn find_largest_log(&mut self) {
        let Scratch { logs, summary, .. } = &mut self.scratch;
        summary.largest_log = weights::largest(self.particles.len(), logs);
    }

    /// Draws the parents of the new particles by systematic resampling with one random number (Kitagawa 1996).
    fn draw_sources(&mut self, rng: &mut impl Rng) {
        let weights = &self.weights[..self.particles.len()];
        weights::systematic_sources(weights, &mut self.scratch.sources, rng.random::<f64>());
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
        self.summary = Summary::of_equal_weights(self.particles.len());

        if let Some(factor) = (moments.covariance * (bandwidth * bandwidth)).cholesky() {
            let shrink = (1.0 - bandwidth * bandwidth).max(0.0).sqrt();
            vectorised!(scale(&mut self.particles, moments.mean, shrink));
            self.add_noise(factor.l(), rng);
        }
    }

    /// Adds Gaussian noise to every particle; `factor` is the lower Cholesky factor of its covariance.
    fn add_noise(&mut self, factor: SMatrix<f64, N, N>, rng: &mut impl Rng) {
        let seed = rng.next_u64();
        vectorised!(simd => add_normal(simd, &mut self.particles, factor, seed));
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
fn mean<const N: usize>(simd: impl Simd, particles: &StateArray<N>, weights: &[f64]) -> SVector<f64, N> {
    let columns = (weights, particles.padded_columns());
    let [sums] = simd::sums(simd, particles.len(), columns, |weight, x, [sums]: &mut [[_; N]; 1]| {
        for i in 0..N {
            sums[i] = weight.mul_add_precise(x[i], sums[i]);
        }
    });
    sums.into()
}

#[inline(always)]
fn moments<const N: usize>(simd: impl Simd, particles: &StateArray<N>, weights: &[f64]) -> Gaussian<N> {
    let mean = mean(simd, particles, weights);
    let columns = (weights, particles.padded_columns());
    let sums = simd::sums(simd, particles.len(), columns, |weight, x, sums: &mut [[_; N]; N]| {
        let mut offset = x;
        for i in 0..N {
            offset[i] -= mean[i];
        }
        for i in 0..N {
            let weighted = weight * offset[i];
            // The lower triangle, as a condition in a loop of constant length, which the compiler unrolls.
            for j in 0..N {
                if j <= i {
                    sums[i][j] = weighted.mul_add_precise(offset[j], sums[i][j]);
                }
            }
        }
    });
    Gaussian::new(mean, SMatrix::from_fn(|i, j| sums[i.max(j)][i.min(j)]))
}

/// Replaces every value, each a state of one component.
#[inline(always)]
fn replace_each(values: &mut StateArray<1>, new: impl Fn(f64) -> f64) {
    let [values] = values.columns_mut();
    values.iter_mut().for_each(|value| *value = new(*value));
}

/// Scales the distances of the particles from a centre by `factor`.
#[inline(always)]
fn scale<const N: usize>(particles: &mut StateArray<N>, centre: SVector<f64, N>, factor: f64) {
    for (column, centre) in particles.columns_mut().into_iter().zip(&centre) {
        column.iter_mut().for_each(|value| *value = centre + (*value - centre) * factor);
    }
}

/// Adds normal draws whose covariance has the lower Cholesky factor `factor`.
#[inline(always)]
fn add_normal<const N: usize>(simd: impl Simd, states: &mut StateArray<N>, factor: SMatrix<f64, N, N>, seed: u64) {
    change_with_normals(simd, states, seed, |mut state, normals| {
        for i in 0..N {
            // The lower triangle, as a condition in a loop of constant length, which the compiler unrolls.
            for j in 0..N {
                if j <= i {
                    state[i] = normals[j].mul_add_precise(factor[(i, j)], state[i]);
                }
            }
        }
        state
    });
}

/// Replaces the states by standard normal draws.
#[inline(always)]
fn fill_normal<const N: usize>(simd: impl Simd, states: &mut StateArray<N>, seed: u64) {
    change_with_normals(simd, states, seed, |_, normals| normals);
}

/// Changes every state, given as many standard normal draws as it has components.
#[allow(clippy::needless_range_loop, reason = "the columns are indexed by component and by step")]
#[inline(always)]
fn change_with_normals<S: Simd, const N: usize>(
    simd: S,
    states: &mut StateArray<N>,
    seed: u64,
    change: impl Fn([Rows<S>; N], [Rows<S>; N]) -> [Rows<S>; N],
) {
    let mut generator = Generator::new(simd, seed);
    let steps = states.len().div_ceil(LANES);
    let columns = states.padded_columns_mut().map(|column| &mut column.as_chunks_mut::<LANES>().0[..steps]);
    for number in 0..steps {
        let normals = generator.normals::<N>();
        for group in 0..GROUPS {
            let (mut state, mut draws) = ([Rows::splat(simd, 0.0); N], [Rows::splat(simd, 0.0); N]);
            for i in 0..N {
                state[i] = Rows::from_slice(simd, &columns[i][number][of_group(group)]);
                draws[i] = normals[i][group];
            }
            let found = change(state, draws);
            for i in 0..N {
                found[i].store_slice(&mut columns[i][number][of_group(group)]);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use fearless_simd::{Level, dispatch};
    use nalgebra::{Matrix3, Vector3};

    use super::weights::{log_weights_by, log_weights_constant_noise_by, normalised_by};
    use super::*;
    use crate::LEVEL;
    use crate::simd::tests::levels;

    const SEED: u64 = 5;
    const VARIANCE: f64 = 0.3;

    /// Results of a step: states, logarithms, weights, sums of the innovation, effective sample size and moments.
    #[derive(Debug, PartialEq)]
    struct Found {
        states: Vec<Vector3<f64>>,
        logs: Vec<f64>,
        weights: Vec<f64>,
        sums: Sums,
        effective_size: f64,
        moments: Gaussian<3>,
    }

    /// A step of `count` particles of which the second is outside the model's domain. The reading is the first component, zero.
    #[inline(always)]
    fn step(simd: impl Simd, count: usize, is_noise_constant: bool) -> Found {
        let (mut states, mut residuals) = (StateArray::<3>::zeros(count), StateArray::<1>::zeros(count));
        fill_normal(simd, &mut states, SEED);
        let factor = Matrix3::new(1.0, 0.0, 0.0, 0.4, 0.7, 0.0, -0.3, 0.2, 0.5);
        add_normal(simd, &mut states, factor, SEED + 1);
        residuals.columns_mut()[0].copy_from_slice(states.column(0));
        replace_each(&mut residuals, |expected| -expected);
        if count > 1 {
            residuals.set(1, &Vector1::new(f64::NAN));
        }
        let (mut logs, mut weights) = (simd::column(count, 0.0), simd::column(count, 1.0 / count as f64));
        let (variances, zeros) = (simd::column(count, VARIANCE), simd::column(count, 0.0));
        let before = Before { weights: &weights, logs: &zeros, largest_log: 0.0 };
        let sums = if is_noise_constant {
            log_weights_constant_noise_by(simd, &residuals, VARIANCE, before, &mut logs)
        } else {
            log_weights_by(simd, &residuals, &variances, before, &mut logs)
        };
        let effective_size = normalised_by(simd, count, &logs, sums.largest_log, &mut weights);
        let moments = moments(simd, &states, &weights);
        let (logs, weights) = (logs[..count].to_vec(), weights[..count].to_vec());
        Found { states: states.iter().collect(), logs, weights, sums, effective_size, moments }
    }

    /// A step with an instruction set. Both tests call it, so that `step` is compiled only once per instruction set.
    fn step_at(level: Level, count: usize, is_noise_constant: bool) -> Found {
        dispatch!(level, simd => step(simd, count, is_noise_constant))
    }

    #[test]
    fn verif_a_step_does_not_depend_on_the_instruction_set() {
        for (count, is_noise_constant) in
            [1, 2, 7, 8, 9, 15, 16, 17, 1000].into_iter().zip([true, false].into_iter().cycle())
        {
            let widest = step_at(*LEVEL, count, is_noise_constant);
            for level in levels() {
                assert_eq!(step_at(level, count, is_noise_constant), widest, "{level:?}, {count}");
            }
        }
    }

    #[test]
    fn val_a_step_agrees_with_the_formulas() {
        for (count, is_noise_constant) in [(1, true), (2, false), (17, true), (33, false), (1000, true), (1000, false)]
        {
            let found = step_at(*LEVEL, count, is_noise_constant);
            let is_defined = |index: usize| index != 1;
            let likelihood = |(index, state): (usize, &Vector3<f64>)| {
                if is_defined(index) { (-0.5 * state[0] * state[0] / VARIANCE).exp() } else { 0.0 }
            };
            let likelihoods: Vec<f64> = found.states.iter().enumerate().map(likelihood).collect();
            let total: f64 = likelihoods.iter().sum();
            let weights = || likelihoods.iter().map(|likelihood| likelihood / total);
            for (found, expected) in found.weights.iter().zip(weights()) {
                assert!((found - expected).abs() <= 1e-11 * expected, "{count}: {found} {expected}");
            }
            let mean: Vector3<f64> = found.states.iter().zip(weights()).map(|(state, weight)| state * weight).sum();
            let apart = |state: &Vector3<f64>| (state - mean) * (state - mean).transpose();
            let covariance: Matrix3<f64> =
                found.states.iter().zip(weights()).map(|(state, weight)| apart(state) * weight).sum();
            assert!(
                (found.moments.mean - mean).norm() < 1e-10 && (found.moments.covariance - covariance).norm() < 1e-10
            );
            let size = 1.0 / weights().map(|weight| weight * weight).sum::<f64>();
            assert!((found.effective_size - size).abs() < 1e-10 * size);

            let share = 1.0 / count as f64;
            let residuals =
                found.states.iter().enumerate().filter(|(index, _)| is_defined(*index)).map(|(_, state)| -state[0]);
            let sum = |term: fn(f64) -> f64| residuals.clone().map(|residual| share * term(residual)).sum::<f64>();
            let expected =
                [sum(|_| 1.0), sum(|residual| residual), sum(|residual| residual * residual), sum(|_| VARIANCE)];
            let Sums { weight, first, second, variance, .. } = found.sums;
            for (found, expected) in [weight, first, second, variance].into_iter().zip(expected) {
                assert!((found - expected).abs() < 1e-12, "{count}: {found} {expected}");
            }
        }
    }

    #[test]
    fn val_added_noise_has_the_covariance_of_its_factor() {
        let factor = Matrix3::new(1.0, 0.0, 0.0, 0.4, 0.7, 0.0, -0.3, 0.2, 0.5);
        let mut states = StateArray::<3>::zeros(100_000);
        vectorised!(simd => add_normal(simd, &mut states, factor, SEED));
        let count = states.len() as f64;
        let found = states.iter().map(|state| state * state.transpose()).sum::<Matrix3<f64>>() / count;
        // The standard deviation of a product of two components is at most sqrt(2) here.
        assert!((found - factor * factor.transpose()).amax() < 4.0 * (2.0 / count).sqrt(), "{found}");
    }
}
