//! The particle filter: sequential importance resampling (Gordon, Salmond and Smith 1993) with systematic resampling
//! when the effective sample size falls (Kitagawa 1996; Liu and Chen 1998) and a shrinking kernel that keeps the cloud
//! diverse without widening it (Liu and West 2001).
//!
//! Readings are of one number. No step allocates, but for the first of each kind.

use nalgebra::{Cholesky, Const, Matrix1, SMatrix, SVector, Vector1};
use rand::{Rng, RngExt};

use crate::bounded::Noisier;
use crate::vectorised;
use crate::wide::{self, Column};
use crate::{Gaussian, Innovation, Measurement, Process, StateArray, UpdateError, extended};

/// A belief made of weighted particles.
#[derive(Clone, Debug, PartialEq)]
pub struct ParticleSet<const N: usize> {
    particles: StateArray<N>,
    /// Normalised weights, one a particle.
    weights: Column,
    /// Their logarithms, but for a common summand. They still tell the particles apart whose weights are too small for a number.
    logs: Column,
    scratch: Scratch<N>,
}

/// What the steps write to, kept between them.
#[derive(Clone, Debug, PartialEq)]
struct Scratch<const N: usize> {
    particles: StateArray<N>,
    weights: Column,
    logs: Column,
    expected: StateArray<1>,
    residuals: Column,
    /// Variance of the reading at each particle, where it is not the same at all.
    variances: Column,
    conditioned: Vec<Option<Conditioned<N>>>,
    /// Which particle each new one comes from, and one place more.
    sources: Vec<usize>,
}

impl<const N: usize> ParticleSet<N> {
    /// Equally weighted particles.
    ///
    /// # Panics
    /// If there are none.
    pub fn new(particles: StateArray<N>) -> Self {
        assert!(!particles.is_empty(), "a cloud needs at least one particle");
        let count = particles.len();
        let scratch = Scratch {
            particles: StateArray::zeros(count),
            weights: wide::column(count, 0.0),
            logs: wide::column(count, 0.0),
            expected: StateArray::zeros(count),
            residuals: wide::column(count, 0.0),
            variances: wide::column(count, 0.0),
            conditioned: Vec::with_capacity(count),
            sources: vec![0; count + 1],
        };
        Self { particles, weights: wide::column(count, 1.0 / count as f64), logs: wide::column(count, 0.0), scratch }
    }

    /// The particles.
    pub fn particles(&self) -> &StateArray<N> {
        &self.particles
    }

    /// Their weights, adding up to 1.
    pub fn weights(&self) -> &[f64] {
        &self.weights
    }

    /// Mean of the cloud.
    pub fn mean(&self) -> SVector<f64, N> {
        vectorised!(mean(&self.particles, &self.weights))
    }

    /// Mean and covariance of the cloud.
    pub fn moments(&self) -> Gaussian<N> {
        vectorised!(moments(&self.particles, &self.weights))
    }

    /// Effective sample size, `1 / sum w^2`.
    pub fn effective_size(&self) -> f64 {
        1.0 / vectorised!(sum_of_squares(&self.weights))
    }

    /// Applies `change` to every particle, for example to hold it within bounds.
    pub fn map(&mut self, change: impl Fn(&SVector<f64, N>) -> SVector<f64, N>) {
        for index in 0..self.particles.len() {
            self.particles.set(index, &change(&self.particles.get(index)));
        }
    }

    /// Fading memory: particles move away from their mean so that the covariance grows by `alpha`.
    pub fn fade(&mut self, alpha: f64) {
        if alpha != 1.0 {
            let mean = self.mean();
            vectorised!(scale(&mut self.particles, mean, alpha.sqrt()));
        }
    }

    /// Carries every particle through the process and draws its noise, which is that at the cloud's mean as in the Gaussian filters.
    pub fn predict(&mut self, process: &impl Process<N>, rng: &mut impl Rng) {
        let noise = process.even_noise().unwrap_or_else(|| process.noise(&self.mean()));
        process.predict_each(&mut self.particles);
        if let Some(factor) = noise.cholesky() {
            self.scatter(factor.l(), rng);
        }
    }

    /// Weighs the particles by the likelihood of the reading. The innovation is that of the cloud's mean prediction.
    ///
    /// # Errors
    /// [`UpdateError`] leaves the cloud as it was: no particle has a prediction, or a variance is not positive.
    pub fn update(
        &mut self,
        measurement: &impl Measurement<N, 1>,
        z: &Vector1<f64>,
    ) -> Result<Innovation<1>, UpdateError> {
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
    /// [`UpdateError`] leaves the cloud as it was.
    pub fn update_or_renew(
        &mut self,
        measurement: &impl Measurement<N, 1>,
        z: &Vector1<f64>,
        renewal: &Renewal,
        rng: &mut impl Rng,
    ) -> Result<Innovation<1>, UpdateError> {
        let innovation = self.expect(measurement, z)?;
        let mut measurement = Noisier { model: measurement, factor: 1.0 };
        if innovation.nis > renewal.gate_sds * renewal.gate_sds {
            measurement = measurement.at_gate(&self.mean(), &innovation, renewal.gate_sds);
            self.expect(&measurement, z)?;
        }
        self.weigh();
        if self.effective_size() < renewal.share * self.particles.len() as f64 {
            self.take_back();
            self.renew(&measurement, z, renewal.bandwidth, rng)?;
        }
        Ok(innovation)
    }

    /// Writes to the scratch's logarithms what those of the weights would be with the reading; the innovation of the cloud's mean prediction.
    fn expect(&mut self, measurement: &impl Measurement<N, 1>, z: &Vector1<f64>) -> Result<Innovation<1>, UpdateError> {
        let Scratch { logs, expected, residuals, variances, .. } = &mut self.scratch;
        measurement.predict_each(&self.particles, expected);
        let residual = |expected| measurement.residual(z, &Vector1::new(expected))[0];
        let expected = expected.column(0);
        let (seen, variance) = if let Some(noise) = measurement.even_noise() {
            if !is_positive(noise[0]) {
                return Err(UpdateError::NotPositiveDefinite);
            }
            vectorised!(weigh_evenly(residual, expected, noise[0], &self.logs, residuals, logs));
            let seen = vectorised!(seen(&self.weights, residuals));
            let variance = noise[0] * seen.known;
            (seen, variance)
        } else {
            for ((variance, particle), &expected) in variances.iter_mut().zip(self.particles.iter()).zip(expected) {
                *variance = if expected.is_nan() { 1.0 } else { measurement.noise(&particle)[0] };
            }
            if !variances.iter().all(|&variance| is_positive(variance)) {
                return Err(UpdateError::NotPositiveDefinite);
            }
            vectorised!(weigh_unevenly(residual, expected, variances, &self.logs, residuals, logs));
            let seen = vectorised!(seen(&self.weights, residuals));
            (seen, vectorised!(total_variance(&self.weights, residuals, variances)))
        };
        if vectorised!(wide::largest(logs)) == f64::NEG_INFINITY {
            return Err(UpdateError::NoPrediction);
        }
        let residual = seen.shift / seen.known;
        let covariance = (seen.second + variance) / seen.known - residual * residual;
        Innovation::of(Vector1::new(residual), Matrix1::new(covariance)).ok_or(UpdateError::NotPositiveDefinite)
    }

    /// Takes the weights from the scratch's logarithms, and puts the old ones there.
    fn weigh(&mut self) {
        std::mem::swap(&mut self.logs, &mut self.scratch.logs);
        std::mem::swap(&mut self.weights, &mut self.scratch.weights);
        vectorised!(normalise(&mut self.weights, &mut self.logs));
    }

    /// Undoes [`Self::weigh`].
    fn take_back(&mut self) {
        std::mem::swap(&mut self.logs, &mut self.scratch.logs);
        std::mem::swap(&mut self.weights, &mut self.scratch.weights);
    }

    /// Draws the cloud anew; see [`Self::update_or_renew`].
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
        if vectorised!(wide::largest(logs)) == f64::NEG_INFINITY {
            return Err(UpdateError::NoPrediction);
        }
        self.weigh();
        self.draw_sources(rng);
        wide::fill_normal(self.scratch.particles.values_mut(), rng);
        standardise(&mut self.scratch.particles);
        let Scratch { logs, conditioned, sources, particles: normals, .. } = &mut self.scratch;
        for (index, log) in logs.iter_mut().enumerate() {
            let drawn = conditioned[sources[index]].as_ref().map(|part| part.draw(&normals.get(index)));
            *log = drawn.as_ref().map_or(f64::NEG_INFINITY, |drawn| drawn.log_weight(measurement, z, &spread));
            if let Some(drawn) = drawn {
                self.particles.set(index, &drawn.particle);
            }
        }
        self.weigh();
        Ok(())
    }

    /// Indices of the particles that systematic resampling with one random number chooses (Kitagawa 1996).
    fn draw_sources(&mut self, rng: &mut impl Rng) {
        vectorised!(spread_sources(&self.weights, &mut self.scratch.sources, rng.random::<f64>()));
    }

    /// Systematic resampling with one random number (Kitagawa 1996), then a Gaussian kernel of `bandwidth` standard deviations
    /// of the cloud, with the particles drawn towards the mean by `sqrt(1 - bandwidth^2)` so that mean and covariance
    /// stay (Liu and West 2001). With a bandwidth of zero the particles stay as they are.
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
            self.scatter(factor.l(), rng);
        }
    }

    /// Adds normal noise to every particle; `factor` is the lower factor of its covariance.
    fn scatter(&mut self, factor: SMatrix<f64, N, N>, rng: &mut impl Rng) {
        wide::fill_normal(self.scratch.particles.values_mut(), rng);
        vectorised!(add_product(&mut self.particles, factor, &self.scratch.particles));
    }
}

/// How [`ParticleSet::update_or_renew`] weighs a reading, and when and how it draws the cloud anew.
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

    /// The particle of the conditioned kernel that a standard normal draw makes.
    fn draw(&self, normal: &SVector<f64, N>) -> Drawn<'_, N> {
        Drawn { particle: self.mean + self.factor * normal, source: self, normal: *normal }
    }
}

/// A particle drawn from a conditioned kernel.
struct Drawn<'a, const N: usize> {
    particle: SVector<f64, N>,
    source: &'a Conditioned<N>,
    normal: SVector<f64, N>,
}

impl<const N: usize> Drawn<'_, N> {
    /// Logarithm of what the particle weighs: its likelihood and its prior under the kernel of which `spread` is the factor, over the density
    /// it was drawn from and the evidence its source was chosen by. Minus infinity where the model has no prediction.
    fn log_weight(
        &self,
        measurement: &impl Measurement<N, 1>,
        z: &Vector1<f64>,
        spread: &Cholesky<f64, Const<N>>,
    ) -> f64 {
        let Some(expected) = measurement.predict(&self.particle) else { return f64::NEG_INFINITY };
        let variance = measurement.noise(&self.particle)[0];
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

/// Whether a variance is one.
fn is_positive(variance: f64) -> bool {
    variance > 0.0
}

/// Moves and scales numbers drawn from the standard normal distribution so that their mean is zero and their covariance the identity: of what
/// chance does to the moments of a small cloud this leaves little. Too few for a covariance stay as they are.
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
        mean[number] = wide::sum([weights, particles.column(number)], |[w, x]| w * x);
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
            let both = wide::sum(columns, |[w, a, b]| w * (a - mean[i]) * (b - mean[j]));
            (covariance[(i, j)], covariance[(j, i)]) = (both, both);
        }
    }
    Gaussian::new(mean, covariance)
}

#[inline(always)]
fn sum_of_squares(weights: &[f64]) -> f64 {
    wide::sum([weights], |[w]| w * w)
}

/// Moves the particles away from a centre, or towards it.
#[inline(always)]
fn scale<const N: usize>(particles: &mut StateArray<N>, centre: SVector<f64, N>, factor: f64) {
    for (column, centre) in particles.columns_mut().into_iter().zip(&centre) {
        column.iter_mut().for_each(|value| *value = centre + (*value - centre) * factor);
    }
}

/// Adds a lower triangular matrix times other states.
#[inline(always)]
fn add_product<const N: usize>(particles: &mut StateArray<N>, factor: SMatrix<f64, N, N>, others: &StateArray<N>) {
    for (i, column) in particles.columns_mut().into_iter().enumerate() {
        for j in (0..=i).filter(|&j| factor[(i, j)] != 0.0) {
            let part = factor[(i, j)];
            column.iter_mut().zip(others.column(j)).for_each(|(value, other)| *value += part * other);
        }
    }
}

/// Weighted sums over the particles that have a residual.
struct Seen {
    known: f64,
    shift: f64,
    second: f64,
}

#[inline(always)]
fn seen(weights: &[f64], residuals: &[f64]) -> Seen {
    let columns = [weights, residuals];
    Seen {
        known: wide::sum(columns, |[w, r]| if r.is_nan() { 0.0 } else { w }),
        shift: wide::sum(columns, |[w, r]| if r.is_nan() { 0.0 } else { w * r }),
        second: wide::sum(columns, |[w, r]| if r.is_nan() { 0.0 } else { w * (r * r) }),
    }
}

/// The same of the reading's variance.
#[inline(always)]
fn total_variance(weights: &[f64], residuals: &[f64], variances: &[f64]) -> f64 {
    wide::sum([weights, residuals, variances], |[w, r, variance]| if r.is_nan() { 0.0 } else { w * variance })
}

/// Writes the residuals, and the logarithms of the weights with those of the residuals' densities, but for what is the same for all.
#[inline(always)]
fn weigh_evenly(
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

/// The same with a variance for each.
#[inline(always)]
fn weigh_unevenly(
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
        let density = -0.5 * (residual * residual / variance + wide::ln(variance));
        *log = if residual.is_nan() { f64::NEG_INFINITY } else { before + density };
    }
}

/// Takes normalised weights from logarithms, of which the largest becomes zero.
#[inline(always)]
fn normalise(weights: &mut [f64], logs: &mut [f64]) {
    let largest = wide::largest(logs);
    for (weight, log) in weights.iter_mut().zip(logs) {
        *log -= largest;
        *weight = wide::exp(*log);
    }
    let share = 1.0 / wide::sum([&*weights], |[w]| w);
    weights.iter_mut().for_each(|weight| *weight *= share);
}

/// Writes which particle each of the evenly spaced pointers `(i + start) / count` falls on, if they lie in a row as long as they weigh.
#[inline(always)]
fn spread_sources(weights: &[f64], sources: &mut [usize], start: f64) {
    let count = weights.len();
    sources.fill(0);
    let mut reached = 0.0;
    for (source, weight) in weights.iter().enumerate() {
        // The first pointer on this particle or behind it. One on which no pointer falls is written over by the next.
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
