//! A Gaussian process (Rasmussen and Williams, *Gaussian Processes for Machine Learning*, 2006, chapters 2 and 5).
//!
//! With `x` the scaled logarithm of the slope, and distances of mean zero and variance one, the covariance of two presses is
//! `s (w (1 + x x') + exp(-(x - x')^2 / 2 l^2) + r [same press])`: a straight line with a wide prior, a smooth departure from it, and
//! scatter. `s` has a best value in closed form; `l` and `r` are the likeliest of a grid.

use nalgebra::{Cholesky, DMatrix, DVector, Dyn};

use super::{Regressor, Scale, log_slope};
use crate::calibration::{Error, Features, LabelledPress};

const NAME: &str = "gaussian-process";

/// Prior variance of the line's coefficients over that of the departure.
const LINE: f64 = 100.0;

const LENGTHS: [f64; 5] = [0.3, 0.5, 0.8, 1.3, 2.0];
const SCATTERS: [f64; 6] = [1e-5, 1e-4, 1e-3, 1e-2, 1e-1, 1.0];

#[derive(Clone, Debug)]
struct GaussianProcess {
    scale: Scale,
    mean_m: f64,
    length: f64,
    at: Vec<f64>,
    weights_m: DVector<f64>,
}

fn covariance(length: f64, a: f64, b: f64) -> f64 {
    LINE * (1.0 + a * b) + (-0.5 * ((a - b) / length).powi(2)).exp()
}

impl Regressor for GaussianProcess {
    fn distance_m(&self, features: &Features) -> f64 {
        let x = self.scale.scaled(log_slope(features));
        let weighted = self.at.iter().zip(&self.weights_m).map(|(&at, weight)| covariance(self.length, x, at) * weight);
        self.mean_m + weighted.sum::<f64>()
    }
}

pub(super) fn fit(presses: &[LabelledPress]) -> Result<Box<dyn Regressor>, Error> {
    let count = presses.len();
    let scale = Scale::of(presses.iter().map(|press| log_slope(&press.features))).ok_or(Error::Undetermined(NAME))?;
    let at: Vec<f64> = presses.iter().map(|press| scale.scaled(log_slope(&press.features))).collect();
    let distances_m = DVector::from_iterator(count, presses.iter().map(|press| press.distance_m));
    let mean_m = distances_m.mean();
    let values_m = distances_m.add_scalar(-mean_m);

    let mut best: Option<(f64, f64, DVector<f64>)> = None;
    for length in LENGTHS {
        let smooth = DMatrix::from_fn(count, count, |i, j| covariance(length, at[i], at[j]));
        for scatter in SCATTERS {
            let Some(cholesky) = Cholesky::new(&smooth + DMatrix::identity(count, count) * scatter) else { continue };
            let weights_m = cholesky.solve(&values_m);
            let likelihood = log_likelihood(&cholesky, values_m.dot(&weights_m));
            if best.as_ref().is_none_or(|(known, ..)| likelihood > *known) {
                best = Some((likelihood, length, weights_m));
            }
        }
    }
    let (_, length, weights_m) = best.ok_or(Error::Undetermined(NAME))?;
    Ok(Box::new(GaussianProcess { scale, mean_m, length, at, weights_m }))
}

/// Logarithm of the marginal likelihood with the best `s`, up to a constant: `-(n ln s + ln |K|) / 2` with `s = y' K^-1 y / n`.
fn log_likelihood(cholesky: &Cholesky<f64, Dyn>, squares: f64) -> f64 {
    let count = cholesky.l_dirty().nrows() as f64;
    let log_determinant: f64 = 2.0 * cholesky.l_dirty().diagonal().iter().map(|value| value.ln()).sum::<f64>();
    -0.5 * (count * (squares / count).ln() + log_determinant)
}
