//! Unscented Kalman filter: models evaluated at sigma points (Julier and Uhlmann, "Unscented filtering and nonlinear
//! estimation", Proceedings of the IEEE 92(3), 2004), in the scaled form of Wan and van der Merwe ("The unscented
//! Kalman filter for nonlinear estimation", 2000).

use nalgebra::{SMatrix, SVector};

use crate::gaussian::{Factor, symmetrised};
use crate::{Gaussian, Innovation, Measurement, Process, UpdateError, congruence, product};

/// Spread and weights of the scaled sigma points.
///
/// With `lambda = alpha^2 (N + kappa) - N`, the points lie `sqrt(N + lambda)` standard deviations from the mean. The
/// central point has the weight `lambda / (N + lambda)` in the mean and `1 - alpha^2 + beta` more in the covariance;
/// each other point has `1 / (2 (N + lambda))` in both.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Spread {
    /// Scale of the spread, usually between 1e-3 and 1.
    pub alpha: f64,
    /// Correction for the distribution's higher moments; 2 is optimal for a Gaussian.
    pub beta: f64,
    /// Secondary scale; `N + kappa` is the matched kurtosis, 3 for a Gaussian.
    pub kappa: f64,
}

struct Weights {
    /// Distance of the points from the mean, in standard deviations.
    reach: f64,
    centre_mean: f64,
    centre_covariance: f64,
    other: f64,
}

impl Spread {
    fn weights<const N: usize>(&self) -> Weights {
        let n = N as f64;
        let total = self.alpha * self.alpha * (n + self.kappa);
        let centre_mean = (total - n) / total;
        Weights {
            reach: total.sqrt(),
            centre_mean,
            centre_covariance: centre_mean + 1.0 - self.alpha * self.alpha + self.beta,
            other: 0.5 / total,
        }
    }
}

/// Columns of `sqrt((N + lambda) P)`, which are added to and subtracted from the mean.
fn offsets<const N: usize>(belief: &Gaussian<N>, reach: f64) -> Result<SMatrix<f64, N, N>, UpdateError> {
    Ok(Factor::of(&belief.covariance).ok_or(UpdateError::NotPositiveDefinite)?.lower() * reach)
}

/// Propagates the belief by carrying its sigma points through the process.
///
/// # Errors
/// [`UpdateError::NotPositiveDefinite`] if the covariance has no Cholesky factor; the belief is unchanged.
pub fn predict<const N: usize>(
    belief: &mut Gaussian<N>,
    process: &impl Process<N>,
    spread: &Spread,
) -> Result<(), UpdateError> {
    let weights = spread.weights::<N>();
    let offsets = offsets(belief, weights.reach)?;
    let noise = process.noise(&belief.mean);
    let centre = process.predict(&belief.mean);
    let high: [SVector<f64, N>; N] = std::array::from_fn(|i| process.predict(&(belief.mean + offsets.column(i))));
    let low: [SVector<f64, N>; N] = std::array::from_fn(|i| process.predict(&(belief.mean - offsets.column(i))));

    let mut mean = centre * weights.centre_mean;
    for point in high.iter().chain(&low) {
        mean += point * weights.other;
    }
    let squared = |deviation: SVector<f64, N>| product(&deviation, &deviation.transpose());
    let mut covariance = squared(centre - mean) * weights.centre_covariance + noise;
    for point in high.iter().chain(&low) {
        covariance += squared(point - mean) * weights.other;
    }
    *belief = Gaussian::new(mean, symmetrised(covariance));
    Ok(())
}

/// Conditions the belief on a reading, with sigma points taken from the predicted belief.
///
/// # Errors
/// [`UpdateError`] if the model is undefined at a sigma point or a covariance is not positive definite; the belief is unchanged.
pub fn update<const N: usize, const M: usize>(
    belief: &mut Gaussian<N>,
    measurement: &impl Measurement<N, M>,
    spread: &Spread,
    z: &SVector<f64, M>,
) -> Result<Innovation<M>, UpdateError> {
    let weights = spread.weights::<N>();
    let offsets = offsets(belief, weights.reach)?;
    let expect = |x: SVector<f64, N>| measurement.predict(&x).ok_or(UpdateError::NoPrediction);
    let centre = expect(belief.mean)?;
    let mut high = [SVector::zeros(); N];
    let mut low = [SVector::zeros(); N];
    for i in 0..N {
        high[i] = expect(belief.mean + offsets.column(i))?;
        low[i] = expect(belief.mean - offsets.column(i))?;
    }

    // Deviations are taken from the central prediction by `residual`, so that wrapped angles average correctly.
    let mut shift = SVector::<f64, M>::zeros();
    for point in high.iter().chain(&low) {
        shift += measurement.residual(point, &centre) * weights.other;
    }
    let squared = |deviation: SVector<f64, M>| product(&deviation, &deviation.transpose());
    let mut covariance = squared(-shift) * weights.centre_covariance + measurement.noise(&belief.mean);
    let mut cross = SMatrix::<f64, N, M>::zeros();
    for i in 0..N {
        let above = measurement.residual(&high[i], &centre) - shift;
        let below = measurement.residual(&low[i], &centre) - shift;
        covariance += (squared(above) + squared(below)) * weights.other;
        let offset: SVector<f64, N> = offsets.column(i).into();
        cross += product(&offset, &(above - below).transpose()) * weights.other;
    }
    let covariance = symmetrised(covariance);
    let factor = Factor::of(&covariance).ok_or(UpdateError::NotPositiveDefinite)?;
    let gain = factor.solve(&cross.transpose()).transpose();
    let residual = measurement.residual(z, &centre) - shift;
    let posterior = symmetrised(belief.covariance - congruence(&gain, &covariance));
    // Unlike the Joseph form, `P - K S K'` can lose definiteness by rounding; the reading is then skipped.
    Factor::of(&posterior).ok_or(UpdateError::NotPositiveDefinite)?;
    *belief = Gaussian::new(belief.mean + product(&gain, &residual), posterior);
    Ok(Innovation::new(residual, covariance, &factor))
}
