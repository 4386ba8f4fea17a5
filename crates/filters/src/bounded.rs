//! Updates with bounded influence: a reading too far off moves the belief the less the farther off it is.
//!
//! Beyond `gate_sds` standard deviations the reading is taken to be as noisy as it would have to be in order to lie at the gate. A spike then
//! hardly matters, and a belief that is truly wrong is still drawn to the readings, since each of them counts a little; no reading is
//! refused, so that there is nothing to recover from. With the gate at infinity it is the plain update.

use nalgebra::{SMatrix, SVector, Vector1};

use crate::{Gaussian, Innovation, Measurement, StateArray, UpdateError};

/// What an update learnt, and how well the belief had foretold it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Weighed<const M: usize> {
    /// The innovation, with the reading's own noise.
    pub innovation: Innovation<M>,
    /// Logarithm of the evidence `N(y; 0, S)`, with the noise that the update took.
    pub log_evidence: f64,
}

/// A measurement with more noise.
#[derive(Clone, Copy, Debug)]
pub struct Noisier<'a, Model> {
    /// The measurement.
    pub model: &'a Model,
    /// Factor of its covariance `R`.
    pub factor: f64,
}

impl<Model> Noisier<'_, Model> {
    /// The measurement with the noise at `x` with which a reading of this innovation would lie at the gate.
    pub fn at_gate<const N: usize>(mut self, x: &SVector<f64, N>, innovation: &Innovation<1>, gate_sds: f64) -> Self
    where
        Model: Measurement<N, 1>,
    {
        let missing = (innovation.residual[0] / gate_sds).powi(2) - innovation.covariance[0];
        self.factor = 1.0 + missing / self.model.noise(x)[0];
        self
    }
}

impl<const N: usize, const M: usize, Model: Measurement<N, M>> Measurement<N, M> for Noisier<'_, Model> {
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

    fn even_noise(&self) -> Option<SMatrix<f64, M, M>> {
        self.model.even_noise().map(|noise| noise * self.factor)
    }

    #[inline(always)]
    fn residual(&self, z: &SVector<f64, M>, expected: &SVector<f64, M>) -> SVector<f64, M> {
        self.model.residual(z, expected)
    }
}

/// Conditions the belief on a reading of one number by a filter's `update`, with the influence bounded by `gate_sds`.
///
/// # Errors
/// [`UpdateError`] of that update, which leaves the belief as it was.
pub fn update<const N: usize, Model: Measurement<N, 1>>(
    belief: &mut Gaussian<N>,
    measurement: &Model,
    gate_sds: f64,
    z: &Vector1<f64>,
    update: impl Fn(&mut Gaussian<N>, &Noisier<'_, Model>, &Vector1<f64>) -> Result<Innovation<1>, UpdateError>,
) -> Result<Weighed<1>, UpdateError> {
    let prior = *belief;
    let innovation = update(belief, &Noisier { model: measurement, factor: 1.0 }, z)?;
    if innovation.nis <= gate_sds * gate_sds {
        return Ok(Weighed { innovation, log_evidence: innovation.log_likelihood() });
    }
    *belief = prior;
    let noisier = Noisier { model: measurement, factor: 1.0 }.at_gate(&prior.mean, &innovation, gate_sds);
    let widened = update(belief, &noisier, z);
    let log_evidence = widened.inspect_err(|_| *belief = prior)?.log_likelihood();
    Ok(Weighed { innovation, log_evidence })
}
