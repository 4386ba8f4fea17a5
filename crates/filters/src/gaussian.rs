//! Gaussian belief, mixture moments and innovation.

use nalgebra::{SMatrix, SVector};

use crate::product;

/// Gaussian belief `N(x, P)` about a state.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Gaussian<const N: usize> {
    /// Mean `x`.
    pub mean: SVector<f64, N>,
    /// Covariance `P`, symmetric.
    pub covariance: SMatrix<f64, N, N>,
}

impl<const N: usize> Gaussian<N> {
    /// Belief with the given mean and covariance.
    pub fn new(mean: SVector<f64, N>, covariance: SMatrix<f64, N, N>) -> Self {
        Self { mean, covariance }
    }

    /// Gaussian with the mean and covariance of a Gaussian mixture (moment matching). The weights need not be
    /// normalised. `None` if no weight is positive.
    pub fn of_mixture(parts: impl IntoIterator<Item = (Self, f64)>) -> Option<Self> {
        let mut mixture = Mixture::empty();
        parts.into_iter().for_each(|(part, weight)| mixture.add(&part, weight));
        mixture.moments()
    }

    /// Whether mean and covariance are finite.
    pub fn is_finite(&self) -> bool {
        self.mean.iter().chain(self.covariance.iter()).all(|value| value.is_finite())
    }

    /// Fading memory: scales the covariance by `alpha >= 1`, once per step, which discounts old readings with a time
    /// constant of about `1 / (alpha - 1)` steps (Simon, *Optimal State Estimation*, 2006, section 7.4).
    pub fn fade(&mut self, alpha: f64) {
        self.covariance *= alpha;
    }
}

/// Running sums of a Gaussian mixture's moments.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Mixture<const N: usize> {
    /// Mean of the first component. The others are taken relative to it, which avoids cancellation if all lie close
    /// together and far from zero.
    origin: Option<SVector<f64, N>>,
    weight: f64,
    shift: SVector<f64, N>,
    second: SMatrix<f64, N, N>,
}

impl<const N: usize> Mixture<N> {
    /// Mixture without components.
    pub(crate) fn empty() -> Self {
        Self { origin: None, weight: 0.0, shift: SVector::zeros(), second: SMatrix::zeros() }
    }

    /// Adds a component with its weight.
    pub(crate) fn add(&mut self, part: &Gaussian<N>, weight: f64) {
        if weight > 0.0 {
            let apart = part.mean - *self.origin.get_or_insert(part.mean);
            self.weight += weight;
            self.shift += apart * weight;
            self.second += (part.covariance + product(&apart, &apart.transpose())) * weight;
        }
    }

    /// Mean and covariance of the mixture. `None` if no component of positive weight was added.
    pub(crate) fn moments(&self) -> Option<Gaussian<N>> {
        let shift = self.shift / self.weight;
        let covariance = self.second / self.weight - product(&shift, &shift.transpose());
        self.origin.map(|origin| Gaussian::new(origin + shift, symmetrised(covariance)))
    }
}

/// Innovation of an update: the residual of the reading with its covariance under the prior.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Innovation<const M: usize> {
    /// `y = z - h(x)`.
    pub residual: SVector<f64, M>,
    /// Covariance `S` of the residual.
    pub covariance: SMatrix<f64, M, M>,
    /// Normalised innovation squared (NIS), `y' S^-1 y`: chi-square distributed with `M` degrees of freedom if the
    /// filter is consistent.
    pub nis: f64,
}

impl<const M: usize> Innovation<M> {
    /// Moment-matched innovation of a mixture. The weights need not be normalised. `None` if no weight is positive or
    /// the covariance is not positive definite.
    pub fn of_mixture(parts: impl IntoIterator<Item = (Self, f64)>) -> Option<Self> {
        let together = Gaussian::of_mixture(parts.into_iter().map(|(part, weight)| (part.gaussian(), weight)))?;
        Self::of(together.mean, together.covariance)
    }

    /// Residual and covariance as a Gaussian.
    pub(crate) fn gaussian(&self) -> Gaussian<M> {
        Gaussian::new(self.residual, self.covariance)
    }

    pub(crate) fn new(residual: SVector<f64, M>, covariance: SMatrix<f64, M, M>, factor: &Factor<M>) -> Self {
        let nis = residual.dot(&factor.solve(&residual));
        Self { residual, covariance, nis }
    }

    /// Innovation with the given residual and covariance. `None` unless the covariance is positive definite.
    pub fn of(residual: SVector<f64, M>, covariance: SMatrix<f64, M, M>) -> Option<Self> {
        Factor::of(&covariance).map(|factor| Self::new(residual, covariance, &factor))
    }

    /// The same residual, with its covariance multiplied by a positive factor.
    pub fn scaled(&self, factor: f64) -> Self {
        Self { residual: self.residual, covariance: self.covariance * factor, nis: self.nis / factor }
    }

    /// Logarithm of the reading's marginal likelihood, `ln N(y; 0, S)`.
    pub fn log_likelihood(&self) -> f64 {
        -0.5 * (self.nis + log_determinant(&self.covariance) + M as f64 * std::f64::consts::TAU.ln())
    }
}

/// Failure of an update. The belief is unchanged.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum UpdateError {
    /// The measurement model has no prediction at the belief.
    #[error("the measurement model has no prediction at the belief")]
    NoPrediction,
    /// A covariance is not positive definite.
    #[error("a covariance is not positive definite")]
    NotPositiveDefinite,
}

/// Symmetric part `(P + P') / 2`: removes the asymmetry that rounding introduces and that would grow from step to step.
pub(crate) fn symmetrised<const N: usize>(p: SMatrix<f64, N, N>) -> SMatrix<f64, N, N> {
    (p + p.transpose()) * 0.5
}

/// Logarithm of the determinant of a covariance; minus infinity unless it is positive definite.
pub(crate) fn log_determinant<const N: usize>(p: &SMatrix<f64, N, N>) -> f64 {
    // A product of four standard deviations has a logarithm as long as they are above 1e-77.
    let log = |factor: Factor<N>| -> f64 {
        factor.lower().diagonal().as_slice().chunks(4).map(|some| some.iter().product::<f64>().ln()).sum()
    };
    Factor::of(p).map_or(f64::NEG_INFINITY, |factor| 2.0 * log(factor))
}

/// Lower Cholesky factor of a small covariance. The unrolled loops are several times faster than nalgebra's
/// factorisation for any size.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Factor<const N: usize>(SMatrix<f64, N, N>);

impl<const N: usize> Factor<N> {
    /// Factor of `p`, of which only the lower triangle is read. `None` unless it is positive definite.
    #[inline]
    pub(crate) fn of(p: &SMatrix<f64, N, N>) -> Option<Self> {
        let mut l = SMatrix::<f64, N, N>::zeros();
        for j in 0..N {
            let left = (0..j).fold(p[(j, j)], |left, k| left - l[(j, k)] * l[(j, k)]);
            let is_definite = left > 0.0;
            if !is_definite {
                return None;
            }
            l[(j, j)] = left.sqrt();
            for i in j + 1..N {
                l[(i, j)] = (0..j).fold(p[(i, j)], |left, k| left - l[(i, k)] * l[(j, k)]) / l[(j, j)];
            }
        }
        Some(Self(l))
    }

    /// Lower triangular matrix `L` with `L L' = P`.
    pub(crate) fn lower(&self) -> &SMatrix<f64, N, N> {
        &self.0
    }

    /// `P^-1 b`.
    #[inline]
    pub(crate) fn solve<const C: usize>(&self, b: &SMatrix<f64, N, C>) -> SMatrix<f64, N, C> {
        let (l, mut x) = (&self.0, *b);
        for column in 0..C {
            for i in 0..N {
                x[(i, column)] = (0..i).fold(x[(i, column)], |left, k| left - l[(i, k)] * x[(k, column)]) / l[(i, i)];
            }
            for i in (0..N).rev() {
                let left = (i + 1..N).fold(x[(i, column)], |left, k| left - l[(k, i)] * x[(k, column)]);
                x[(i, column)] = left / l[(i, i)];
            }
        }
        x
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::{matrix, vector};

    use super::*;

    #[test]
    fn val_the_factor_equals_nalgebras() {
        let p = matrix![4.0, 1.2, -0.3; 1.2, 2.0, 0.4; -0.3, 0.4, 1.5];
        let b = matrix![1.0, -2.0; 0.5, 3.0; -0.7, 0.1];
        let (found, expected) = (Factor::of(&p).unwrap(), p.cholesky().unwrap());
        assert!((found.lower() - expected.l()).norm() < 1e-15);
        assert!((found.solve(&b) - expected.solve(&b)).norm() < 1e-15);
        assert!((log_determinant(&p) - p.determinant().ln()).abs() < 1e-14);
    }

    #[test]
    fn robust_a_matrix_that_is_not_positive_definite_has_no_factor() {
        assert_eq!(Factor::of(&matrix![1.0, 2.0; 2.0, 1.0]), None);
        assert_eq!(Factor::of(&matrix![f64::NAN]), None);
        assert_eq!(Innovation::of(vector![1.0], matrix![0.0]), None);
    }
}
