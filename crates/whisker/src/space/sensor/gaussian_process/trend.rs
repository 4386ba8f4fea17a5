//! The quadratic trend of a Gaussian process.

use nalgebra::{Matrix2x3, SMatrix, SVector, Vector2, Vector3};
use serde::{Deserialize, Serialize};

use super::kernel::Sample;

/// Number of terms.
const TERMS: usize = 10;

/// The quadratic trend, relative to the largest reading.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Trend {
    /// Centre and half the extent of the samples along each axis, 3x1.
    center_m: Vector3<f64>,
    scale_m: Vector3<f64>,
    /// Coefficients of [`Self::terms`], by channel, 10x2.
    coefficients: SMatrix<f64, TERMS, 2>,
}

impl Trend {
    /// Checks stored numbers.
    ///
    /// # Errors
    /// The key that is wrong, with what is expected.
    pub(super) fn check(&self) -> Result<(), String> {
        if !self.coefficients.iter().all(|coefficient| coefficient.is_finite()) {
            return Err("`trend.coefficients`: found a number that is not finite, expected finite ones".into());
        }
        let is_scale = |scale: &f64| scale.is_finite() && *scale > 0.0;
        if !(self.scale_m.iter().all(is_scale) && self.center_m.iter().all(|center| center.is_finite())) {
            let Self { center_m, scale_m, .. } = self;
            let found = format!("{:?}, {:?}", center_m.as_slice(), scale_m.as_slice());
            return Err(format!(
                "`trend.center_m`, `trend.scale_m`: found {found}, expected finite ones, the scales positive"
            ));
        }
        Ok(())
    }

    /// Coordinates of a contact, from -1 to 1 over the samples.
    fn scaled(&self, contact_m: &Vector3<f64>) -> Vector3<f64> {
        (contact_m - self.center_m).component_div(&self.scale_m)
    }

    /// The terms at scaled coordinates, 10x1.
    fn terms(u: &Vector3<f64>) -> SVector<f64, TERMS> {
        let [x, y, z] = (*u).into();
        SVector::from([1.0, x, y, z, x * x, y * y, z * z, x * y, y * z, z * x])
    }

    /// Derivatives of [`Self::terms`] by the scaled coordinates, 10x3.
    fn slopes(u: &Vector3<f64>) -> SMatrix<f64, TERMS, 3> {
        let [x, y, z] = (*u).into();
        SMatrix::<f64, 3, TERMS>::from_column_slice(&[
            0.0,
            0.0,
            0.0,
            1.0,
            0.0,
            0.0,
            0.0,
            1.0,
            0.0,
            0.0,
            0.0,
            1.0,
            2.0 * x,
            0.0,
            0.0,
            0.0,
            2.0 * y,
            0.0,
            0.0,
            0.0,
            2.0 * z,
            y,
            x,
            0.0,
            0.0,
            z,
            y,
            z,
            0.0,
            x,
        ])
        .transpose()
    }

    /// The trend of samples by least squares. `None` if they do not determine it.
    pub(super) fn new(samples: &[Sample], largest: f64) -> Option<Self> {
        let fold = |pick: fn(f64, f64) -> f64, from: f64| {
            Vector3::from_fn(|axis, _| samples.iter().map(|sample| sample.contact_m[axis]).fold(from, pick))
        };
        let (low, high) = (fold(f64::min, f64::INFINITY), fold(f64::max, f64::NEG_INFINITY));
        let mut trend =
            Self { center_m: (low + high) * 0.5, scale_m: (high - low) * 0.5, coefficients: SMatrix::zeros() };
        let mut square = SMatrix::<f64, TERMS, TERMS>::zeros();
        let mut mixed = SMatrix::<f64, TERMS, 2>::zeros();
        for sample in samples {
            let terms = Self::terms(&trend.scaled(&sample.contact_m));
            square += terms * terms.transpose();
            mixed += terms * sample.reading.transpose() / largest;
        }
        trend.coefficients = square.cholesky()?.solve(&mixed);
        Some(trend)
    }

    /// The trend at a contact, 2x1, and its derivatives by the contact (1/m), 2x3.
    pub(super) fn at(&self, contact_m: &Vector3<f64>) -> (Vector2<f64>, Matrix2x3<f64>) {
        let u = self.scaled(contact_m);
        let mut slopes = self.coefficients.tr_mul(&Self::slopes(&u));
        for axis in 0..3 {
            slopes.column_mut(axis).scale_mut(1.0 / self.scale_m[axis]);
        }
        (self.coefficients.tr_mul(&Self::terms(&u)), slopes)
    }
}
