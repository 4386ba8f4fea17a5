//! The sensor model for many contacts at once: a bivariate polynomial of degree 5 in a product basis of Chebyshev polynomials.

use anyhow::Context;
use filters::vectorised;
use serde::Deserialize;
use serde_json::Value;

/// Number of Chebyshev polynomials in each coordinate, one more than the degree.
const COUNT: usize = 6;

/// Number of coefficients.
const TERMS: usize = COUNT * (COUNT + 1) / 2;

/// Polynomial with the parameters of a calibration file; see `datasets/FORMAT.md`.
#[derive(Clone, Copy, Debug, Deserialize)]
pub(crate) struct Polynomial {
    center_m: [f64; 2],
    scale_m: [f64; 2],
    coefficients_n_m: [f64; TERMS],
}

impl Polynomial {
    /// Polynomial of a model in a calibration file.
    pub(crate) fn of(model: &Value) -> anyhow::Result<Self> {
        Self::deserialize(model).context("the model is not a polynomial of degree 5")
    }

    /// Writes the expected readings of contacts, given by their coordinates in Base.
    pub(crate) fn readings_n_m(&self, x_m: &[f64], y_m: &[f64], readings_n_m: &mut [f64]) {
        vectorised!(self.readings_as_wide_as_here(x_m, y_m, readings_n_m));
    }

    #[inline(always)]
    fn readings_as_wide_as_here(&self, x_m: &[f64], y_m: &[f64], readings_n_m: &mut [f64]) {
        for ((reading_n_m, &x_m), &y_m) in readings_n_m.iter_mut().zip(x_m).zip(y_m) {
            let u = (x_m - self.center_m[0]) * (1.0 / self.scale_m[0]);
            let v = (y_m - self.center_m[1]) * (1.0 / self.scale_m[1]);
            *reading_n_m = self.sum(&chebyshev(u), &chebyshev(v));
        }
    }

    /// `sum a_i c_ij b_j`, `i + j < COUNT`.
    #[inline(always)]
    fn sum(&self, by_u: &[f64; COUNT], by_v: &[f64; COUNT]) -> f64 {
        let (mut value, mut start) = (0.0, TERMS);
        for i in (0..COUNT).rev() {
            start -= COUNT - i;
            // The first polynomial is 1.
            let mut row = self.coefficients_n_m[start];
            for j in 1..COUNT - i {
                row = self.coefficients_n_m[start + j].mul_add(by_v[j], row);
            }
            value = if i + 1 == COUNT { by_u[i] * row } else { by_u[i].mul_add(row, value) };
        }
        value
    }
}

/// Chebyshev polynomials of an argument.
#[inline(always)]
fn chebyshev(u: f64) -> [f64; COUNT] {
    let (mut values, doubled) = ([1.0; COUNT], u + u);
    for i in 1..COUNT {
        values[i] = if i == 1 { u } else { doubled.mul_add(values[i - 1], -values[i - 2]) };
    }
    values
}
