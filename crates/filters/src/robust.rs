//! Robust updates, in which an outlier has bounded influence.
//!
//! If the residual of a reading exceeds `gate_sds` of its standard deviations, the measurement noise is inflated until
//! the residual lies at the gate. The influence of an outlier then decreases with its distance. Unlike a gate that
//! rejects readings, an inconsistent belief still converges to the readings, since each has some weight. With an
//! infinite gate this is the plain update.

use nalgebra::{SMatrix, SVector, Vector1};

use crate::{Gaussian, Innovation, Measurement, StateArray, UpdateError};

/// Result of an update: innovation and marginal likelihood of the reading.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Update<const M: usize> {
    /// Innovation with the reading's nominal noise.
    pub innovation: Innovation<M>,
    /// Logarithm of the marginal likelihood `N(y; 0, S)`, with the noise that the update used.
    pub log_evidence: f64,
}

/// Measurement model with an inflated noise covariance.
#[derive(Clone, Copy, Debug)]
pub struct InflatedNoise<'a, Model> {
    /// Nominal measurement model.
    pub model: &'a Model,
    /// Factor by which the noise covariance `R` is multiplied.
    pub factor: f64,
}

impl<Model> InflatedNoise<'_, Model> {
    /// Measurement model with the noise at `x` for which a reading of the given innovation lies at the gate.
    pub fn at_gate<const N: usize>(mut self, x: &SVector<f64, N>, innovation: &Innovation<1>, gate_sds: f64) -> Self
    where
        Model: Measurement<N, 1>,
    {
        let missing = (innovation.residual[0] / gate_sds).powi(2) - innovation.covariance[0];
        self.factor = 1.0 + missing / self.model.noise(x)[0];
        self
    }
}

impl<const N: usize, const M: usize, Model: Measurement<N, M>> Measurement<N, M> for InflatedNoise<'_, Model> {
    fn predict(&self, x: &SVector<f64, N>) -> Option<SVector<f64, M>> {
        self.model.predict(x)
    }

    fn noise(&self, x: &SVector<f64, N>) -> SMatrix<f64, M, M> {
        self.model.noise(x) * self.factor
    }

    fn jacobian(&self, x: &SVector<f64, N>) -> Option<SMatrix<f64, M, N>> {
        self.model.jacobian(x)
    }

    fn linearised(&self, x: &SVector<f64, N>) -> Option<(SVector<f64, M>, SMatrix<f64, M, N>)> {
        self.model.linearised(x)
    }

    fn predict_each(&self, states: &StateArray<N>, expected: &mut StateArray<M>) {
        self.model.predict_each(states, expected);
    }

    fn constant_noise(&self) -> Option<SMatrix<f64, M, M>> {
        self.model.constant_noise().map(|noise| noise * self.factor)
    }

    #[inline(always)]
    fn residual(&self, z: &SVector<f64, M>, expected: &SVector<f64, M>) -> SVector<f64, M> {
        self.model.residual(z, expected)
    }
}

/// Conditions the belief on a scalar reading by a filter's `update`, with the influence bounded at `gate_sds` standard deviations.
///
/// # Errors
/// [`UpdateError`] of the filter's `update`; the belief is unchanged.
pub fn update<const N: usize, Model: Measurement<N, 1>>(
    belief: &mut Gaussian<N>,
    measurement: &Model,
    gate_sds: f64,
    z: &Vector1<f64>,
    update: impl Fn(&mut Gaussian<N>, &InflatedNoise<'_, Model>, &Vector1<f64>) -> Result<Innovation<1>, UpdateError>,
) -> Result<Update<1>, UpdateError> {
    let prior = *belief;
    let innovation = update(belief, &InflatedNoise { model: measurement, factor: 1.0 }, z)?;
    if innovation.nis <= gate_sds * gate_sds {
        return Ok(Update { innovation, log_evidence: innovation.log_likelihood() });
    }
    *belief = prior;
    let inflated = InflatedNoise { model: measurement, factor: 1.0 }.at_gate(&prior.mean, &innovation, gate_sds);
    let updated = update(belief, &inflated, z);
    let log_evidence = updated.inspect_err(|_| *belief = prior)?.log_likelihood();
    Ok(Update { innovation, log_evidence })
}
