//! Polynomials in a function of the slope.

use nalgebra::{DMatrix, DVector};

use super::{Regressor, Scale, log_slope};
use crate::calibration::least_squares::solve;
use crate::calibration::{Error, Features, LabelledPress};

const ORDER: usize = 3;

/// A polynomial in one variable, and what the variable is.
#[derive(Clone, Debug)]
pub(super) struct Polynomial {
    variable: fn(&Features) -> f64,
    scale: Scale,
    coefficients_m: DVector<f64>,
}

impl Polynomial {
    /// The polynomial of third order with the least weighted squares; none where it is not determined.
    pub(super) fn fit(
        presses: &[LabelledPress],
        variable: fn(&Features) -> f64,
        weights: &DVector<f64>,
    ) -> Option<Self> {
        let values: Vec<f64> = presses.iter().map(|press| variable(&press.features)).collect();
        let scale = Scale::of(values.iter().copied())?;
        let rows = DMatrix::from_fn(values.len(), ORDER + 1, |i, power| scale.scaled(values[i]).powi(power as i32));
        let distances_m = DVector::from_iterator(presses.len(), presses.iter().map(|press| press.distance_m));
        Some(Self { variable, scale, coefficients_m: solve(&rows, &distances_m, weights)? })
    }
}

impl Regressor for Polynomial {
    fn distance_m(&self, features: &Features) -> f64 {
        let x = self.scale.scaled((self.variable)(features));
        self.coefficients_m.iter().rev().fold(0.0, |sum, coefficient| sum * x + coefficient)
    }
}

fn fit(
    name: &'static str,
    variable: fn(&Features) -> f64,
    presses: &[LabelledPress],
) -> Result<Box<dyn Regressor>, Error> {
    let equal = DVector::repeat(presses.len(), 1.0);
    let polynomial = Polynomial::fit(presses, variable, &equal).ok_or(Error::Undetermined(name))?;
    Ok(Box::new(polynomial))
}

/// In the slope.
pub(super) fn cubic(presses: &[LabelledPress]) -> Result<Box<dyn Regressor>, Error> {
    fit("cubic", |features| features.slope_counts_per_s, presses)
}

/// In the logarithm of the slope, in which the curve of a whisker is nearly straight.
pub(super) fn logarithmic(presses: &[LabelledPress]) -> Result<Box<dyn Regressor>, Error> {
    fit("logarithmic", log_slope, presses)
}
