//! Rauch-Tung-Striebel fixed-interval smoother: the posterior of each state given all readings, past and future
//! ("Maximum likelihood estimates of linear dynamic systems", AIAA Journal 3(8), 1965). `F` is the Jacobian at which
//! the filter linearised the process.

use nalgebra::SMatrix;

use crate::Gaussian;
use crate::gaussian::symmetrised;

/// One step of a filter, as recorded for the smoother.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Step<const N: usize> {
    /// Jacobian `F` of the process from the previous filtered belief to the predicted one.
    pub jacobian: SMatrix<f64, N, N>,
    /// Prior: belief before the reading, `(x', P')`.
    pub predicted: Gaussian<N>,
    /// Posterior: belief after the reading, `(x, P)`.
    pub filtered: Gaussian<N>,
}

/// Smoothed beliefs `(x_s, P_s)` of a filter's steps, in the order of the steps: backwards from the last, with the
/// primed quantities those of the next step, `C = P F' P'^-1`, `x_s = x + C (x'_s - x')`, `P_s = P + C (P'_s - P') C'`.
/// Where a predicted covariance is singular or `P_s` is not positive definite, the filtered belief is kept: the recorded moments of
/// a filter that prunes hypotheses between its steps are not those of a single linear process.
pub fn smooth<const N: usize>(steps: &[Step<N>]) -> Vec<Gaussian<N>> {
    let mut smoothed: Vec<Gaussian<N>> = steps.iter().map(|step| step.filtered).collect();
    for k in (1..steps.len()).rev() {
        let (before, next, later) = (&steps[k - 1].filtered, &steps[k], smoothed[k]);
        let Some(factor) = next.predicted.covariance.cholesky() else { continue };
        let gain = factor.solve(&(next.jacobian * before.covariance)).transpose();
        let mean = before.mean + gain * (later.mean - next.predicted.mean);
        let change = later.covariance - next.predicted.covariance;
        let covariance = symmetrised(before.covariance + gain * change * gain.transpose());
        if covariance.cholesky().is_some() {
            smoothed[k - 1] = Gaussian::new(mean, covariance);
        }
    }
    smoothed
}
