//! The unscented Kalman filter: models evaluated at sigma points (Julier and Uhlmann 2004; scaled form of
//! Wan and van der Merwe 2000).

use nalgebra::{SMatrix, SVector};

use crate::gaussian::{Factor, symmetrised};
use crate::{Gaussian, Innovation, Measurement, Process, UpdateError, mapped, product};

/// How far sigma points lie from the mean and how they are weighed.
///
/// With `lambda = alpha^2 (N + kappa) - N` the points lie `sqrt(N + lambda)` standard deviations out; the mean weighs
/// `lambda / (N + lambda)`, in the covariance `1 - alpha^2 + beta` more, each other point `1 / (2 (N + lambda))`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Spread {
    /// Scale of the spread.
    pub alpha: f64,
    /// Prior knowledge of the distribution; 2 is best for a Gaussian.
    pub beta: f64,
    /// Secondary scale; `N + kappa` is the kurtosis that is matched, 3 for a Gaussian.
    pub kappa: f64,
}

struct Weights {
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

/// Columns of `sqrt((N + lambda) P)`: the sigma points are the mean and the mean plus and minus each.
fn offsets<const N: usize>(belief: &Gaussian<N>, reach: f64) -> Result<SMatrix<f64, N, N>, UpdateError> {
    Ok(Factor::of(&belief.covariance).ok_or(UpdateError::NotPositiveDefinite)?.lower() * reach)
}

/// Carries the sigma points through the process.
///
/// # Errors
/// [`UpdateError::NotPositiveDefinite`] leaves the belief as it was.
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

/// Conditions the belief on a reading, with sigma points drawn anew from the belief.
///
/// # Errors
/// [`UpdateError`] leaves the belief as it was: a sigma point without prediction, or a degenerate covariance.
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

    // Deviations are taken from the centre's prediction through `residual`, so that wrapped readings average correctly.
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
    let posterior = symmetrised(belief.covariance - mapped(&gain, &covariance));
    // Unlike Joseph's form this difference can lose definiteness; then the reading is not worth the belief.
    Factor::of(&posterior).ok_or(UpdateError::NotPositiveDefinite)?;
    *belief = Gaussian::new(belief.mean + product(&gain, &residual), posterior);
    Ok(Innovation::new(residual, covariance, &factor))
}
