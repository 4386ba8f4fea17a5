//! Polynomial of third order in the logarithm of the slope by Tukey's biweight, in iteratively reweighted least squares
//! (Huber and Ronchetti, *Robust Statistics*, 2009, 7.8).
//!
//! The distance of a whisker's contact is a nearly straight function of that logarithm. A press whose residual exceeds
//! [`TUKEY`] robust standard deviations, such as a mislabelled one, has zero weight.

use nalgebra::{DMatrix, DVector};

use super::regressor::{LiveFit, Quantity, Regressor, Scale, log_ramp, log_slope, with_ramps};
use crate::calibration::learn::{SD_OVER_MAD, quantile};
use crate::calibration::least_squares::solve;
use crate::calibration::{Error, Features, LabelledPress};

const ORDER: usize = 3;

/// Residual with zero weight, in robust standard deviations: 95 % of the efficiency of least squares for normal errors.
const TUKEY: f64 = 4.685;

/// Lower bound of the scatter: below it there is only rounding.
const SMALLEST_SCATTER_M: f64 = 1e-6;

const ROUNDS: usize = 50;

const COEFFICIENTS: &[&str] =
    &["log_slope_middle", "log_slope_half", "constant_m", "linear_m", "quadratic_m", "cubic_m"];

pub(super) const LIVE: LiveFit = LiveFit {
    coefficients: COEFFICIENTS,
    quantities: &[log_slope],
    fit: |presses| fit("robust", presses, log_slope),
    restore: |coefficients| restore(coefficients, log_slope),
};

/// As [`LIVE`], with the slope before the low-pass.
pub(super) const RAMP: LiveFit = LiveFit {
    coefficients: COEFFICIENTS,
    quantities: &[log_ramp],
    fit: |presses| {
        with_ramps("robust-ramp", presses)?;
        fit("robust-ramp", presses, log_ramp)
    },
    restore: |coefficients| restore(coefficients, log_ramp),
};

/// A polynomial in the scaled logarithm of the slope.
#[derive(Clone, Debug)]
struct Polynomial {
    measured: Quantity,
    scale: Scale,
    coefficients_m: DVector<f64>,
}

impl Polynomial {
    /// Weighted least-squares fit. `None` if the presses do not determine it.
    fn fit(presses: &[LabelledPress], weights: &DVector<f64>, measured: Quantity) -> Option<Self> {
        let values: Vec<f64> = presses.iter().map(|press| measured(&press.features)).collect();
        let scale = Scale::of(values.iter().copied())?;
        let rows = DMatrix::from_fn(values.len(), ORDER + 1, |i, power| scale.scaled(values[i]).powi(power as i32));
        let distances_m = DVector::from_iterator(presses.len(), presses.iter().map(|press| press.distance_m));
        Some(Self { measured, scale, coefficients_m: solve(&rows, &distances_m, weights)? })
    }
}

impl Regressor for Polynomial {
    fn distance_m(&self, features: &Features) -> f64 {
        let x = self.scale.scaled((self.measured)(features));
        self.coefficients_m.iter().rev().fold(0.0, |sum, coefficient| sum * x + coefficient)
    }

    fn coefficients(&self) -> Vec<f64> {
        [self.scale.middle, self.scale.half].into_iter().chain(self.coefficients_m.iter().copied()).collect()
    }
}

fn restore(coefficients: &[f64], measured: Quantity) -> Result<Box<dyn Regressor>, (usize, &'static str)> {
    let scale = Scale { middle: coefficients[0], half: coefficients[1] };
    if scale.half <= 0.0 {
        return Err((1, Scale::HALF));
    }
    Ok(Box::new(Polynomial { measured, scale, coefficients_m: DVector::from_column_slice(&coefficients[2..]) }))
}

fn fit(name: &'static str, presses: &[LabelledPress], measured: Quantity) -> Result<Box<dyn Regressor>, Error> {
    let mut weights = DVector::repeat(presses.len(), 1.0);
    let mut fitted = Polynomial::fit(presses, &weights, measured).ok_or(Error::Undetermined(name))?;
    for _ in 0..ROUNDS {
        let residuals_m: Vec<f64> =
            presses.iter().map(|press| press.distance_m - fitted.distance_m(&press.features)).collect();
        let absolute: Vec<f64> = residuals_m.iter().map(|residual| residual.abs()).collect();
        let scatter_m = (SD_OVER_MAD * quantile(absolute, 0.5)).max(SMALLEST_SCATTER_M);
        let biweight = |residual_m: &f64| {
            let share = (residual_m / (TUKEY * scatter_m)).powi(2);
            if share < 1.0 { (1.0 - share).powi(2) } else { 0.0 }
        };
        let next = DVector::from_iterator(presses.len(), residuals_m.iter().map(biweight));
        let change = (&next - &weights).amax();
        weights = next;
        fitted = Polynomial::fit(presses, &weights, measured).ok_or(Error::Undetermined(name))?;
        if change < 1e-9 {
            break;
        }
    }
    Ok(Box::new(fitted))
}
