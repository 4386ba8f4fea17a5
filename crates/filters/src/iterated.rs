//! Iterated extended Kalman filter: the update is repeated with the measurement linearised at its own result. This is
//! the Gauss-Newton method for the maximum a posteriori state (Bell and Cathey, "The iterated Kalman filter update as a
//! Gauss-Newton method", IEEE Transactions on Automatic Control 38(2), 1993), here with a backtracking line search on
//! the posterior density.

use nalgebra::{Cholesky, Const, SMatrix, SVector};

use crate::gaussian::{Factor, symmetrised};
use crate::{Gaussian, Innovation, Measurement, UpdateError};

pub use crate::extended::predict;

/// Termination criteria of the search for the maximum a posteriori state.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Search {
    /// Most iterations.
    pub iterations: usize,
    /// Length of a step at which the search has converged, in standard deviations of the prior.
    pub tolerance_sds: f64,
}

/// Step lengths that the line search tries, each half of the last.
const HALVINGS: usize = 6;

/// Conditions the belief on a reading. The returned innovation is that of the extended filter, with the residual at the prior mean.
///
/// # Errors
/// [`UpdateError`] if the model is undefined at an iterate or a covariance is not positive definite; the belief is unchanged.
pub fn update<const N: usize, const M: usize>(
    belief: &mut Gaussian<N>,
    measurement: &impl Measurement<N, M>,
    search: &Search,
    z: &SVector<f64, M>,
) -> Result<Innovation<M>, UpdateError> {
    let prior = *belief;
    let spread = prior.covariance.cholesky().ok_or(UpdateError::NotPositiveDefinite)?;
    let (expected, h, r) = measurement.linearised_with_noise(&prior.mean).ok_or(UpdateError::NoPrediction)?;
    let noise = r.cholesky().ok_or(UpdateError::NotPositiveDefinite)?;
    let cost = |x: &SVector<f64, N>| -> Result<f64, UpdateError> {
        let residual = measurement.residual(z, &measurement.predict(x).ok_or(UpdateError::NoPrediction)?);
        Ok(squared(&noise, &residual) + squared(&spread, &(x - prior.mean)))
    };

    let mut x = prior.mean;
    let mut least = squared(&noise, &measurement.residual(z, &expected));
    let first = linearised(&prior, measurement, &r, (&x, &expected, h), z)?;
    let mut last = first;
    for iteration in 0..search.iterations {
        if iteration > 0 {
            let (expected, h) = measurement.linearised(&x).ok_or(UpdateError::NoPrediction)?;
            last = linearised(&prior, measurement, &r, (&x, &expected, h), z)?;
        }
        let step = last.mean - x;
        let shorter = (0..HALVINGS).map(|halving| x + step * 0.5f64.powi(halving as i32));
        let better = shorter.into_iter().find_map(|x| cost(&x).ok().filter(|&cost| cost < least).map(|cost| (x, cost)));
        let Some((found, lower)) = better else { break };
        let is_small = squared(&spread, &(found - x)) < search.tolerance_sds * search.tolerance_sds;
        (x, least) = (found, lower);
        if is_small {
            break;
        }
    }
    let keep = SMatrix::<f64, N, N>::identity() - last.gain * last.h;
    let covariance = symmetrised(keep * prior.covariance * keep.transpose() + last.gain * r * last.gain.transpose());
    *belief = Gaussian::new(x, covariance);
    let factor = Factor::of(&first.covariance).ok_or(UpdateError::NotPositiveDefinite)?;
    Ok(Innovation::new(first.residual, first.covariance, &factor))
}

/// Update with the measurement linearised at a given state.
#[derive(Clone, Copy)]
struct Linearised<const N: usize, const M: usize> {
    /// Updated mean.
    mean: SVector<f64, N>,
    gain: SMatrix<f64, N, M>,
    h: SMatrix<f64, M, N>,
    /// Residual and its covariance.
    residual: SVector<f64, M>,
    covariance: SMatrix<f64, M, M>,
}

/// Mean `x_prior + K (z - h(x) - H (x_prior - x))`, with the predicted reading `h(x)`, `H` and `K` taken at `x` (Bell and Cathey
/// 1993, equation 11).
fn linearised<const N: usize, const M: usize>(
    prior: &Gaussian<N>,
    measurement: &impl Measurement<N, M>,
    r: &SMatrix<f64, M, M>,
    (x, expected, h): (&SVector<f64, N>, &SVector<f64, M>, SMatrix<f64, M, N>),
    z: &SVector<f64, M>,
) -> Result<Linearised<N, M>, UpdateError> {
    let residual = measurement.residual(z, expected) - h * (prior.mean - x);
    let cross = h * prior.covariance;
    let covariance = symmetrised(cross * h.transpose() + r);
    let gain = covariance.cholesky().ok_or(UpdateError::NotPositiveDefinite)?.solve(&cross).transpose();
    Ok(Linearised { mean: prior.mean + gain * residual, gain, h, residual, covariance })
}

/// Squared Mahalanobis norm `v' A^-1 v`, from the Cholesky factor of `A`.
fn squared<const D: usize>(factor: &Cholesky<f64, Const<D>>, v: &SVector<f64, D>) -> f64 {
    v.dot(&factor.solve(v))
}
