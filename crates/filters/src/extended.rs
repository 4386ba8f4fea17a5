//! The extended Kalman filter: models linearised at the mean (Thrun et al. 2005, table 3.3).

use nalgebra::SMatrix;
use nalgebra::SVector;

use crate::gaussian::{Factor, symmetrised};
use crate::{Gaussian, Innovation, Measurement, Process, UpdateError, mapped, product};

/// `x <- f(x)`, `P <- F P F' + Q`.
pub fn predict<const N: usize>(belief: &mut Gaussian<N>, process: &impl Process<N>) {
    let (mean, jacobian, noise) = process.linearised(&belief.mean);
    belief.mean = mean;
    belief.covariance = symmetrised(mapped(&jacobian, &belief.covariance) + noise);
}

/// Conditions the belief on a reading; the gain comes from a Cholesky solve and the covariance from Joseph's form
/// `(I - K H) P (I - K H)' + K R K'`, which stays positive definite (Bucy and Joseph 1968).
///
/// # Errors
/// [`UpdateError`] leaves the belief as it was: no prediction at the mean, or a degenerate covariance.
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
    let keep = SMatrix::<f64, N, N>::identity() - product(&gain, &h);
    belief.covariance = symmetrised(mapped(&keep, &belief.covariance) + mapped(&gain, &r));
    Ok(Innovation::new(residual, covariance, &factor))
}
