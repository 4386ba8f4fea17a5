//! Posterior Cramér–Rao bound: a lower bound on the error covariance of any estimator.
//!
//! The error covariance is at least `J^-1`, where `J` is the information of the prior and of all readings so far.
//! Tichavsky, Muravchik and Nehorai ("Posterior Cramér–Rao bounds for discrete-time nonlinear filtering", IEEE
//! Transactions on Signal Processing 46(5), 1998) compute it recursively. For additive Gaussian noise their recursion
//! (equations 21 and 34 to 36) is, by the matrix inversion lemma,
//!
//! `J' = (Q + F J^-1 F')^-1 + H' R^-1 H`,
//!
//! which also holds for a singular `Q`. The expectation over trajectories is omitted: the Jacobians are those at the
//! true states, so this is the bound *along one trajectory*, which shows how observable the state is under its motion.
//!
//! On a linear model the bound equals the covariance of the Kalman filter:
//!
//! ```
//! use filters::{Gaussian, Measurement, Process, bound, bound::Bound, extended};
//! use nalgebra::{Matrix1, Matrix2, SMatrix, SVector, Vector1, vector};
//!
//! struct Cart;
//! impl Process<2> for Cart {
//!     fn predict(&self, x: &SVector<f64, 2>) -> SVector<f64, 2> {
//!         vector![x[0] + 0.1 * x[1], x[1]]
//!     }
//!     fn noise(&self, _: &SVector<f64, 2>) -> SMatrix<f64, 2, 2> {
//!         Matrix2::from_diagonal(&vector![0.0, 0.02])
//!     }
//! }
//! impl Measurement<2, 1> for Cart {
//!     fn predict(&self, x: &SVector<f64, 2>) -> Option<Vector1<f64>> {
//!         Some(Vector1::new(x[0]))
//!     }
//!     fn noise(&self, _: &SVector<f64, 2>) -> Matrix1<f64> {
//!         Matrix1::new(0.3)
//!     }
//! }
//!
//! let mut belief = Gaussian::new(vector![0.0, 0.0], Matrix2::identity());
//! let mut bound = Bound::new(&belief.covariance).expect("the prior is positive definite");
//! for _ in 0..100 {
//!     bound.predict(&Cart, &belief.mean);
//!     extended::predict(&mut belief, &Cart);
//!     bound.update(bound::information(&Cart, &belief.mean).expect("a prediction"));
//!     extended::update(&mut belief, &Cart, &Vector1::new(1.0))?;
//! }
//! let covariance = bound.covariance().expect("positive definite information");
//! assert!((covariance - belief.covariance).norm() < 1e-12);
//! # Ok::<(), filters::UpdateError>(())
//! ```

use nalgebra::{SMatrix, SVector};

use crate::gaussian::symmetrised;
use crate::{Measurement, Process};

/// Fisher information `H' R^-1 H` of one reading at the true state `x`. `None` if the model is undefined there or `R`
/// is not positive definite.
pub fn information<const N: usize, const M: usize>(
    measurement: &impl Measurement<N, M>,
    x: &SVector<f64, N>,
) -> Option<SMatrix<f64, N, N>> {
    let h = measurement.jacobian(x)?;
    let factor = measurement.noise(x).cholesky()?;
    Some(symmetrised(h.transpose() * factor.solve(&h)))
}

/// Posterior Cramér–Rao bound along one trajectory.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bound<const N: usize> {
    information: SMatrix<f64, N, N>,
}

impl<const N: usize> Bound<N> {
    /// Bound before the first reading, from the prior covariance. `None` unless it is positive definite.
    pub fn new(prior: &SMatrix<f64, N, N>) -> Option<Self> {
        Some(Self { information: symmetrised(prior.cholesky()?.inverse()) })
    }

    /// Propagates the information through the process, from the true state `x` before the step. Information that is
    /// numerically singular is unchanged, which is an upper bound of the propagated information.
    pub fn predict(&mut self, process: &impl Process<N>, x: &SVector<f64, N>) {
        let f = process.jacobian(x);
        let spread = |covariance| symmetrised(f * covariance * f.transpose() + process.noise(x));
        if let Some(factor) = self.covariance().and_then(|covariance| spread(covariance).cholesky()) {
            self.information = symmetrised(factor.inverse());
        }
    }

    /// Adds the [`information`] of a reading.
    pub fn update(&mut self, information: SMatrix<f64, N, N>) {
        self.information += information;
    }

    /// Information `J`.
    pub fn information(&self) -> SMatrix<f64, N, N> {
        self.information
    }

    /// Lower bound `J^-1` of the error covariance. `None` if `J` is not numerically positive definite.
    pub fn covariance(&self) -> Option<SMatrix<f64, N, N>> {
        Some(symmetrised(self.information.cholesky()?.inverse()))
    }
}
