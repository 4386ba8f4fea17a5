//! The logarithmic polynomial by Tukey's biweight, in iteratively reweighted least squares (Huber and Ronchetti, *Robust Statistics*, 2009, 7.8).
//!
//! A press whose label is off by many times the scatter of the others gets no weight.

use nalgebra::DVector;

use super::polynomial::Polynomial;
use super::{Regressor, log_slope};
use crate::calibration::learn::{SD_OVER_MAD, quantile};
use crate::calibration::{Error, LabelledPress};

const NAME: &str = "robust";

/// Residual without weight, in robust standard deviations: 95 % as efficient as least squares where the scatter is normal.
const TUKEY: f64 = 4.685;

/// Scatter below it is rounding, not scatter.
const SMALLEST_SCATTER_M: f64 = 1e-6;

const ROUNDS: usize = 50;

pub(super) fn fit(presses: &[LabelledPress]) -> Result<Box<dyn Regressor>, Error> {
    let mut weights = DVector::repeat(presses.len(), 1.0);
    let mut fitted = Polynomial::fit(presses, log_slope, &weights).ok_or(Error::Undetermined(NAME))?;
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
        fitted = Polynomial::fit(presses, log_slope, &weights).ok_or(Error::Undetermined(NAME))?;
        if change < 1e-9 {
            break;
        }
    }
    Ok(Box::new(fitted))
}
