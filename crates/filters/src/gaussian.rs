//! The Gaussian belief and what an update returns.

use nalgebra::{Cholesky, Const, SMatrix, SVector};

/// A belief about a state: mean and covariance.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Gaussian<const N: usize> {
    /// Mean `x`.
    pub mean: SVector<f64, N>,
    /// Covariance `P`, symmetric.
    pub covariance: SMatrix<f64, N, N>,
}

impl<const N: usize> Gaussian<N> {
    /// A belief with this mean and covariance.
    pub fn new(mean: SVector<f64, N>, covariance: SMatrix<f64, N, N>) -> Self {
        Self { mean, covariance }
    }

    /// The Gaussian with the mean and the covariance of a mixture of Gaussians, whose weights need not add up to 1; nothing where they are zero.
    pub fn of_mixture(parts: impl IntoIterator<Item = (Self, f64)>) -> Option<Self> {
        let parts: Vec<(Self, f64)> = parts.into_iter().filter(|(_, weight)| *weight > 0.0).collect();
        if let [(only, _)] = parts[..] {
            return Some(only);
        }
        let total: f64 = parts.iter().map(|(_, weight)| weight).sum();
        let mean = parts.iter().map(|(part, weight)| part.mean * (weight / total)).sum::<SVector<f64, N>>();
        let covariance = parts.iter().map(|(part, weight)| {
            let apart = part.mean - mean;
            (part.covariance + apart * apart.transpose()) * (weight / total)
        });
        let covariance = symmetrised(covariance.sum::<SMatrix<f64, N, N>>());
        (!parts.is_empty()).then(|| Self::new(mean, covariance))
    }

    /// Whether every number of it is finite.
    pub fn is_finite(&self) -> bool {
        self.mean.iter().chain(self.covariance.iter()).all(|value| value.is_finite())
    }

    /// Fading memory: old knowledge is trusted less by scaling the covariance by `alpha` >= 1 once a step
    /// (Simon, *Optimal State Estimation*, 2006, section 7.4). The memory lasts `1 / (alpha - 1)` steps.
    pub fn fade(&mut self, alpha: f64) {
        self.covariance *= alpha;
    }
}

/// What an update learnt: how far the reading lay from what was expected.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Innovation<const M: usize> {
    /// `y = z - h(x)`.
    pub residual: SVector<f64, M>,
    /// Covariance `S` of the residual.
    pub covariance: SMatrix<f64, M, M>,
    /// Normalised innovation squared, `y' S^-1 y`: chi-square with `M` degrees of freedom if the filter is consistent.
    pub nis: f64,
}

impl<const M: usize> Innovation<M> {
    pub(crate) fn new(
        residual: SVector<f64, M>,
        covariance: SMatrix<f64, M, M>,
        factor: &Cholesky<f64, Const<M>>,
    ) -> Self {
        let nis = residual.dot(&factor.solve(&residual));
        Self { residual, covariance, nis }
    }

    /// The innovation with this residual; nothing unless the covariance is positive definite.
    pub fn of(residual: SVector<f64, M>, covariance: SMatrix<f64, M, M>) -> Option<Self> {
        covariance.cholesky().map(|factor| Self::new(residual, covariance, &factor))
    }

    /// The innovation of a mixture of Gaussians with these innovations and weights, which need not add up to 1; nothing where they are zero.
    pub fn of_mixture(parts: impl IntoIterator<Item = (Self, f64)>) -> Option<Self> {
        let parts = parts.into_iter().map(|(part, weight)| (Gaussian::new(part.residual, part.covariance), weight));
        let together = Gaussian::of_mixture(parts)?;
        Self::of(together.mean, together.covariance)
    }

    /// Logarithm of the reading's probability density before it was known, `ln N(y; 0, S)`.
    pub fn log_likelihood(&self) -> f64 {
        -0.5 * (self.nis + log_determinant(&self.covariance) + M as f64 * std::f64::consts::TAU.ln())
    }
}

/// Why an update left the belief as it was.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum Skipped {
    /// The measurement model has no prediction at the belief.
    #[error("the measurement model has no prediction at the belief")]
    NoPrediction,
    /// A covariance is not positive definite.
    #[error("a covariance is not positive definite")]
    NotPositiveDefinite,
}

/// Rounding makes covariances unsymmetric, which grows from step to step; the mean of both halves stops it.
pub(crate) fn symmetrised<const N: usize>(p: SMatrix<f64, N, N>) -> SMatrix<f64, N, N> {
    (p + p.transpose()) * 0.5
}

/// Logarithm of a covariance's determinant; minus infinity where it is not positive definite.
pub(crate) fn log_determinant<const N: usize>(p: &SMatrix<f64, N, N>) -> f64 {
    p.cholesky().map_or(f64::NEG_INFINITY, |factor| 2.0 * factor.l().diagonal().map(f64::ln).sum())
}
