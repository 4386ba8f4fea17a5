//! Bayesian filters, smoothers and nonlinear least squares over abstract process and measurement models.
//!
//! A filter has two operations on a belief: *predict* propagates it through a [`Process`] model; *update* conditions it
//! on a reading through a [`Measurement`] model and returns the [`Innovation`]. Models are generic in the number of
//! states `N` and of readings `M`, and the same model serves every filter. Jacobians default to central differences.
//! The models of whiskers are in the crate `whisker`, which depends on this one.
//!
//! | module | algorithm |
//! | --- | --- |
//! | [`extended`] | extended Kalman filter |
//! | [`iterated`] | iterated extended Kalman filter |
//! | [`unscented`] | unscented Kalman filter |
//! | [`particle`] | particle filter on a [`ParticleSet`] |
//! | [`bank`] | Gaussian-sum filter: a [`Bank`] of hypotheses |
//! | [`imm`] | interacting-multiple-model estimator |
//! | [`robust`] | updates in which an outlier has bounded influence |
//! | [`smoother`] | Rauch-Tung-Striebel smoother |
//! | [`batch`] | maximum a posteriori trajectory by the Gauss-Newton method |
//! | [`bound`] | posterior Cramér–Rao bound |
//! | [`quantile`] | quantiles of samples, of the normal and of the chi-square distribution |
//! | [`least_squares`] | Levenberg-Marquardt and Gauss-Newton methods |
//!
//! # Notation
//!
//! After Thrun, Burgard and Fox, *Probabilistic Robotics* (2005), chapters 3 and 4; a prime at a matrix denotes its transpose.
//!
//! | symbol | quantity |
//! | --- | --- |
//! | `x`, `P` | state, its covariance |
//! | `x' = f(x) + w`, `w ~ N(0, Q)` | process model with Jacobian `F = df/dx` |
//! | `z = h(x) + v`, `v ~ N(0, R)` | measurement model with Jacobian `H = dh/dx` |
//! | `y = z - h(x)`, `S` | innovation, its covariance `H P H' + R` |
//! | `K` | Kalman gain `P H' S^-1` |
//!
//! # Example
//!
//! A cart moves along a line at unknown, nearly constant velocity. A sensor 2 m beside the line measures its distance
//! `sqrt(p^2 + 4)` ten times per second with a standard deviation of 0.05 m. The extended Kalman filter estimates
//! position `p` (m) and velocity `v` (m/s) from 50 readings.
//!
//! ```
//! use filters::{Gaussian, Measurement, Process, extended};
//! use nalgebra::{Matrix1, Matrix2, Vector1, Vector2, matrix, vector};
//!
//! const DT_S: f64 = 0.1;
//!
//! /// Constant velocity with a white-noise acceleration of spectral density 1e-4 m^2/s^3.
//! struct Cart;
//! impl Process<2> for Cart {
//!     fn predict(&self, x: &Vector2<f64>) -> Vector2<f64> {
//!         vector![x[0] + DT_S * x[1], x[1]]
//!     }
//!     fn noise(&self, _: &Vector2<f64>) -> Matrix2<f64> {
//!         1e-4 * matrix![DT_S.powi(3) / 3.0, DT_S.powi(2) / 2.0; DT_S.powi(2) / 2.0, DT_S]
//!     }
//! }
//!
//! /// Distance from the sensor.
//! struct Range;
//! impl Measurement<2, 1> for Range {
//!     fn predict(&self, x: &Vector2<f64>) -> Option<Vector1<f64>> {
//!         Some(Vector1::new(x[0].hypot(2.0)))
//!     }
//!     fn noise(&self, _: &Vector2<f64>) -> Matrix1<f64> {
//!         Matrix1::new(0.05_f64.powi(2))
//!     }
//! }
//!
//! // Data: readings of a cart that starts at 1 m with 0.5 m/s. The sine stands for the noise.
//! let position_m = |k: u32| 1.0 + 0.5 * DT_S * f64::from(k);
//! let readings_m = (1..=50).map(|k| position_m(k).hypot(2.0) + 0.05 * f64::from(7 * k).sin());
//!
//! // Prior: position known to 0.5 m, velocity to 1 m/s.
//! let mut belief = Gaussian::new(vector![1.3, 0.0], Matrix2::from_diagonal(&vector![0.25, 1.0]));
//! let mut nis = 0.0;
//! for z_m in readings_m {
//!     extended::predict(&mut belief, &Cart);
//!     let innovation = extended::update(&mut belief, &Range, &Vector1::new(z_m))?;
//!     nis += innovation.nis / 50.0;
//! }
//!
//! // Answer: estimate with its standard deviations, and a mean normalised innovation squared near or below 1.
//! let sd = belief.covariance.diagonal().map(f64::sqrt);
//! assert!((belief.mean[0] - position_m(50)).abs() < 2.0 * sd[0] && sd[0] < 0.05);
//! assert!((belief.mean[1] - 0.5).abs() < 2.0 * sd[1] && sd[1] < 0.05);
//! assert!(nis < 1.3);
//! # Ok::<(), filters::UpdateError>(())
//! ```

use std::sync::LazyLock;

use fearless_simd::Level;

pub mod bank;
pub mod batch;
pub mod bound;
mod cholesky;
pub mod extended;
mod gaussian;
pub mod imm;
pub mod iterated;
pub mod least_squares;
mod matrix;
mod model;
pub mod particle;
pub mod quantile;
pub mod robust;
mod simd;
pub mod smoother;
mod state_array;
pub mod unscented;

pub use bank::Bank;
pub use cholesky::{cholesky, inverse};
pub use gaussian::{Gaussian, Innovation, UpdateError};
pub use matrix::{congruence, product};
pub use model::{ConstantNoise, Measurement, Process};
pub use particle::ParticleSet;
pub use robust::Update;
pub use state_array::StateArray;

/// Used by the expansion of [`vectorised!`], and by functions of other crates that it calls.
#[doc(hidden)]
pub use fearless_simd;

/// Widest supported instruction set, cached: the query takes as long as a loop over hundreds of elements.
#[doc(hidden)]
pub static LEVEL: LazyLock<Level> = LazyLock::new(Level::new);
