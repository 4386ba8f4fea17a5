//! Extended Kalman filter: models linearised at the mean (Thrun, Burgard and Fox 2005, table 3.3).

use nalgebra::{SMatrix, SVector};

use crate::gaussian::{Factor, symmetrised};
use crate::{Gaussian, Innovation, Measurement, Process, UpdateError, congruence, product};

/// Propagates the belief through the process: `x <- f(x)`, `P <- F P F' + Q`. Returns the Jacobian `F`.
pub fn predict<const N: usize>(belief: &mut Gaussian<N>, process: &impl Process<N>) -> SMatrix<f64, N, N> {
    let (mean, jacobian, noise) = process.linearised(&belief.mean);
    belief.mean = mean;
    belief.covariance = symmetrised(congruence(&jacobian, &belief.covariance) + noise);
    jacobian
}

/// Conditions the belief on a reading: `S = H P H' + R`, `K = P H' S^-1`, `x <- x + K (z - h(x))`. The gain is computed
/// by a Cholesky solve and the covariance in Joseph form, `P <- (I - K H) P (I - K H)' + K R K'`, which stays positive
/// definite (Bucy and Joseph 1968).
///
/// # Errors
/// [`UpdateError`] if the model is undefined at the mean or `S` is not positive definite; the belief is unchanged.
pub fn update<const N: usize, const M: usize>(
    belief: &mut Gaussian<N>,
    measurement: &impl Measurement<N, M>,
    z: &SVector<f64, M>,
) -> Result<Innovation<M>, UpdateError> {
    let (expected, h, r) = measurement.linearised_with_noise(&belief.mean).ok_or(UpdateError::NoPrediction)?;
    let residual = measurement.residual(z, &expected);
    let cross = product(&h, &belief.covariance);
    let covariance = symmetrised(product(&cross, &h.transpose()) + r);
    let factor = Factor::of(&covariance).ok_or(UpdateError::NotPositiveDefinite)?;
    let gain = factor.solve(&cross).transpose();
    belief.mean += product(&gain, &residual);
    // Products with `K H`, of the rank of a reading, take a fraction of the time of those with `I - K H`.
    let kept = belief.covariance - product(&gain, &cross);
    let kept = kept - product(&product(&kept, &h.transpose()), &gain.transpose());
    belief.covariance = symmetrised(kept + congruence(&gain, &r));
    Ok(Innovation::new(residual, covariance, &factor))
}
