//! The fixed-interval smoother: what all readings say of each state, the later ones included (Rauch, Tung and Striebel, "Maximum likelihood
//! estimates of linear dynamic systems", AIAA Journal 3(8), 1965; Thrun's notation, with `F` linearised by the filter).

use nalgebra::SMatrix;

use crate::Gaussian;
use crate::gaussian::symmetrised;

/// One step of a filter, as the smoother needs it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Step<const N: usize> {
    /// Jacobian `F` of the process that led from the last filtered belief to the predicted one.
    pub jacobian: SMatrix<f64, N, N>,
    /// Belief before the reading.
    pub predicted: Gaussian<N>,
    /// Belief after it.
    pub filtered: Gaussian<N>,
}

/// Smoothed beliefs of a filter's steps, in their order: `C = P F' P'^-1`, `x <- x + C (x'_s - x')`, `P <- P + C (P'_s - P') C'`, from
/// the last step back. Where a predicted covariance has no inverse the filtered belief stays.
pub fn smooth<const N: usize>(steps: &[Step<N>]) -> Vec<Gaussian<N>> {
    let mut smoothed: Vec<Gaussian<N>> = steps.iter().map(|step| step.filtered).collect();
    for k in (1..steps.len()).rev() {
        let (before, next, later) = (&steps[k - 1].filtered, &steps[k], smoothed[k]);
        let Some(factor) = next.predicted.covariance.cholesky() else { continue };
        let gain = factor.solve(&(next.jacobian * before.covariance)).transpose();
        let mean = before.mean + gain * (later.mean - next.predicted.mean);
        let change = later.covariance - next.predicted.covariance;
        smoothed[k - 1] = Gaussian::new(mean, symmetrised(before.covariance + gain * change * gain.transpose()));
    }
    smoothed
}
