//! Bayesian filters over abstract process and measurement models.
//!
//! A filter here is two verbs on a belief: *predict* carries it through a [`Process`], *update* conditions it on a
//! reading through a [`Measurement`] and returns the [`Innovation`]. The belief is a [`Gaussian`] for the extended
//! ([`extended`]) and unscented ([`unscented`]) Kalman filters and a [`ParticleSet`] of particles for the particle filter. The same
//! model serves them all, in any number of states `N` and readings `M`.
//!
//! Notation, after Thrun, Burgard, Fox, *Probabilistic Robotics* (2005), chapters 3 and 4: state `x` with covariance `P`; process
//! `x' = f(x) + w`, `w ~ N(0, Q)`, Jacobian `F`; reading `z = h(x) + v`, `v ~ N(0, R)`, Jacobian `H`; innovation
//! `y = z - h(x)` with covariance `S`.
//!
//! ```
//! use filters::{Gaussian, Measurement, Process, extended};
//! use nalgebra::{Matrix1, SMatrix, SVector, Vector1, vector};
//!
//! /// A point at rest, of which the distance from the origin is measured.
//! struct Rest;
//! impl Process<2> for Rest {
//!     fn predict(&self, x: &SVector<f64, 2>) -> SVector<f64, 2> {
//!         *x
//!     }
//!     fn noise(&self, _: &SVector<f64, 2>) -> SMatrix<f64, 2, 2> {
//!         SMatrix::zeros()
//!     }
//! }
//! struct Range;
//! impl Measurement<2, 1> for Range {
//!     fn predict(&self, x: &SVector<f64, 2>) -> Option<Vector1<f64>> {
//!         Some(Vector1::new(x.norm()))
//!     }
//!     fn noise(&self, _: &SVector<f64, 2>) -> Matrix1<f64> {
//!         Matrix1::new(0.01)
//!     }
//! }
//!
//! let mut belief = Gaussian::new(vector![3.0, 4.0], SMatrix::identity());
//! extended::predict(&mut belief, &Rest);
//! let innovation = extended::update(&mut belief, &Range, &Vector1::new(5.5))?;
//! assert!((innovation.residual[0] - 0.5).abs() < 1e-12);
//! assert!((belief.mean.norm() - 5.5).abs() < 0.01);
//! # Ok::<(), filters::UpdateError>(())
//! ```

use std::sync::LazyLock;

use fearless_simd::Level;

pub mod bank;
pub mod batch;
pub mod bound;
pub mod bounded;
pub mod extended;
mod gaussian;
pub mod imm;
pub mod iterated;
pub mod least_squares;
mod model;
pub mod particle;
mod small;
pub mod smoother;
mod state_array;
pub mod unscented;
mod wide;

pub use bank::Bank;
pub use bounded::Weighed;
pub use gaussian::{Gaussian, Innovation, UpdateError};
pub use model::{ConstantNoise, Measurement, Process};
pub use particle::ParticleSet;
pub use small::{mapped, product};
pub use state_array::StateArray;

/// What [`vectorised!`] expands to.
#[doc(hidden)]
pub use fearless_simd;

/// The widest registers here. To ask the processor takes as long as a loop over hundreds of numbers.
#[doc(hidden)]
pub static LEVEL: LazyLock<Level> = LazyLock::new(Level::new);
