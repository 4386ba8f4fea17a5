//! The regression of the published pipeline: a polynomial of third order in *slope times true distance*.
//!
//! The true distance is the quantity to be estimated, so the regression cannot run live, and its cross-validated error
//! is not that of an estimate from the slope alone. It is kept as the reference for the published figures.

use nalgebra::{DMatrix, DVector};

use super::regressor::LeakingRegressor;
use crate::calibration::least_squares::solve;
use crate::calibration::{Error, LabelledPress};

pub(super) const NAME: &str = "published";

const DEGREE: usize = 3;

/// A polynomial in slope times true distance.
#[derive(Clone, Debug)]
struct Published {
    scale: f64,
    coefficients_m: DVector<f64>,
}

/// The feature that contains the true distance.
fn feature(press: &LabelledPress) -> f64 {
    press.features.slope_counts_per_s * press.distance_m
}

impl LeakingRegressor for Published {
    fn distance_m(&self, press: &LabelledPress) -> f64 {
        let x = feature(press) / self.scale;
        self.coefficients_m.iter().rev().fold(0.0, |sum, coefficient| sum * x + coefficient)
    }
}

pub(super) fn fit(presses: &[LabelledPress]) -> Result<Box<dyn LeakingRegressor>, Error> {
    let scale = presses.iter().map(|press| feature(press).abs()).fold(0.0, f64::max);
    let rows =
        DMatrix::from_fn(presses.len(), DEGREE + 1, |i, power| (feature(&presses[i]) / scale).powi(power as i32));
    let distances_m = DVector::from_iterator(presses.len(), presses.iter().map(|press| press.distance_m));
    let equal = DVector::repeat(presses.len(), 1.0);
    let coefficients_m = solve(&rows, &distances_m, &equal).ok_or(Error::Undetermined(NAME))?;
    Ok(Box::new(Published { scale, coefficients_m }))
}
