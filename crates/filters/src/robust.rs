//! Robust updates, in which an outlier has bounded influence.
//!
//! If the residual of a reading exceeds `gate_sds` of its standard deviations, the measurement noise is inflated until
//! the residual lies at the gate. The influence of an outlier then decreases with its distance. Unlike a gate that
//! rejects readings, an inconsistent belief still converges to the readings, since each has some weight. With an
//! infinite gate this is the plain update. In a least-squares fit the cost of a residual beyond the gate grows by its logarithm.

use nalgebra::{SMatrix, SVector, Vector1};

use crate::{Gaussian, Innovation, Measurement, StateArray, UpdateError};

/// Half of a squared residual in its standard deviations, which grows logarithmically beyond the gate; and the factor of the
/// residual's weight in the quadratic that majorises it.
pub fn logarithmic_cost(squared: f64, gate_sds: f64) -> (f64, f64) {
    let gate = gate_sds.powi(2);
    if squared <= gate { (0.5 * squared, 1.0) } else { (0.5 * gate * (1.0 + (squared / gate).ln()), gate / squared) }
}

/// Logarithm of the likelihood of an innovation, which beyond the gate decreases no further.
pub fn log_likelihood<const M: usize>(innovation: &Innovation<M>, gate_sds: f64) -> f64 {
    innovation.log_likelihood() + 0.5 * (innovation.nis - gate_sds.powi(2)).max(0.0)
}

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

    fn predict_with_noise(&self, x: &SVector<f64, N>) -> Option<(SVector<f64, M>, SMatrix<f64, M, M>)> {
        self.model.predict_with_noise(x).map(|(expected, noise)| (expected, noise * self.factor))
    }

    fn jacobian(&self, x: &SVector<f64, N>) -> Option<SMatrix<f64, M, N>> {
        self.model.jacobian(x)
    }

    fn linearised(&self, x: &SVector<f64, N>) -> Option<(SVector<f64, M>, SMatrix<f64, M, N>)> {
        self.model.linearised(x)
    }

    fn linearised_with_noise(
        &self,
        x: &SVector<f64, N>,
    ) -> Option<(SVector<f64, M>, SMatrix<f64, M, N>, SMatrix<f64, M, M>)> {
        let (expected, jacobian, noise) = self.model.linearised_with_noise(x)?;
        Some((expected, jacobian, noise * self.factor))
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

/// Factor of the noise covariance `R` for which a reading with this innovation, beyond the gate, lies at the gate: the solution of
/// `y' (S + (f - 1) R)^-1 y = gate^2`, whose left side decreases with `f`, by bisection. `None` unless `R` is positive definite.
fn factor_at_gate<const M: usize>(
    innovation: &Innovation<M>,
    noise: &SMatrix<f64, M, M>,
    gate_sds: f64,
) -> Option<f64> {
    const HALVINGS: usize = 40;
    let square = |covariance: SMatrix<f64, M, M>| {
        Some(innovation.residual.dot(&covariance.cholesky()?.solve(&innovation.residual)))
    };
    let goal = gate_sds * gate_sds;
    // `S + (f - 1) R >= f R`.
    let (mut low, mut high) = (1.0, (square(*noise)? / goal).max(1.0));
    for _ in 0..HALVINGS {
        let middle = 0.5 * (low + high);
        let is_beyond = square(innovation.covariance + noise * (middle - 1.0))? > goal;
        (low, high) = if is_beyond { (middle, high) } else { (low, middle) };
    }
    Some(high)
}

/// Conditions the belief on a reading of several components by a filter's `update`, with the influence bounded at `gate_sds`
/// standard deviations: beyond, the noise of all components is inflated alike.
///
/// # Errors
/// [`UpdateError`] of the filter's `update`; the belief is unchanged.
pub fn update_vector<const N: usize, const M: usize, Model: Measurement<N, M>>(
    belief: &mut Gaussian<N>,
    measurement: &Model,
    gate_sds: f64,
    z: &SVector<f64, M>,
    update: impl Fn(&mut Gaussian<N>, &InflatedNoise<'_, Model>, &SVector<f64, M>) -> Result<Innovation<M>, UpdateError>,
) -> Result<Update<M>, UpdateError> {
    let prior = *belief;
    let innovation = update(belief, &InflatedNoise { model: measurement, factor: 1.0 }, z)?;
    if innovation.nis <= gate_sds * gate_sds {
        return Ok(Update { innovation, log_evidence: innovation.log_likelihood() });
    }
    *belief = prior;
    let factor = factor_at_gate(&innovation, &measurement.noise(&prior.mean), gate_sds);
    let factor = factor.ok_or(UpdateError::NotPositiveDefinite)?;
    let updated = update(belief, &InflatedNoise { model: measurement, factor }, z);
    let log_evidence = updated.inspect_err(|_| *belief = prior)?.log_likelihood();
    Ok(Update { innovation, log_evidence })
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
