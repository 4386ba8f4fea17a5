//! Bivariate polynomial of total degree `n` in the scaled coordinates of the contact (Lin et al. 2022 use `n` = 5).
//!
//! With `u = (x - x0) / a`, `v = (y - y0) / b`, both within [-1, 1] over the calibration: `g(x, y) = sum c_ij u^i v^j`, `i + j <= n`.
//! Scaling keeps the least-squares problem well conditioned, which raw metres to the fifth power would not be.

use nalgebra::{DMatrix, DVector, Vector2};
use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::{Made, ModelError, Prediction, Sample, SensorModel};
use crate::frames::{Base, Point};

pub(super) const KIND: &str = "polynomial";

/// Settings of the fit.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct PolynomialConfig {
    /// Total degree.
    pub degree: usize,
}

impl Default for PolynomialConfig {
    fn default() -> Self {
        Self { degree: 5 }
    }
}

/// The fitted polynomial.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Polynomial {
    kind: String,
    degree: usize,
    center_m: [f64; 2],
    scale_m: [f64; 2],
    /// `c_ij` with `i` ascending, within it `j` ascending.
    coefficients_n_m: Vec<f64>,
}

/// Largest degree: beyond it the coefficients of monomials lose all digits.
const MOST_DEGREE: usize = 20;

fn check_degree(degree: usize) -> Result<(), ModelError> {
    if degree > MOST_DEGREE {
        return Err(ModelError::Data(format!("`degree`: found {degree}, expected at most {MOST_DEGREE}")));
    }
    Ok(())
}

fn terms(degree: usize) -> usize {
    (degree + 1) * (degree + 2) / 2
}

/// Middle and half of the range of some values.
fn middle_and_half(values: impl Iterator<Item = f64> + Clone) -> (f64, f64) {
    let low = values.clone().fold(f64::INFINITY, f64::min);
    let high = values.fold(f64::NEG_INFINITY, f64::max);
    (0.5 * (low + high), 0.5 * (high - low))
}

impl Polynomial {
    /// Least-squares fit by a QR decomposition.
    ///
    /// # Errors
    /// [`ModelError::Data`] where the samples do not determine the coefficients.
    pub fn fit(samples: &[Sample], config: PolynomialConfig) -> Result<Self, ModelError> {
        let degree = config.degree;
        check_degree(degree)?;
        let count = terms(degree);
        if samples.len() < count {
            return Err(ModelError::Data(format!(
                "a polynomial of degree {degree} has {count} coefficients, the calibration only {} samples",
                samples.len()
            )));
        }
        let (x0, a) = middle_and_half(samples.iter().map(|s| s.contact.x()));
        let (y0, b) = middle_and_half(samples.iter().map(|s| s.contact.y()));
        let mut design = DMatrix::zeros(samples.len(), count);
        for (row, sample) in samples.iter().enumerate() {
            let (u, v) = ((sample.contact.x() - x0) / a, (sample.contact.y() - y0) / b);
            let mut column = 0;
            for i in 0..=degree {
                for j in 0..=degree - i {
                    design[(row, column)] = u.powi(i as i32) * v.powi(j as i32);
                    column += 1;
                }
            }
        }
        let readings = DVector::from_iterator(samples.len(), samples.iter().map(|s| s.reading_n_m));
        let qr = design.qr();
        let r = qr.r();
        let diagonal = r.diagonal().abs();
        let is_determined = diagonal.min() > 1e-12 * diagonal.max();
        // Samples without extent have no scale, and NaN for a diagonal, which is not greater either.
        if !is_determined {
            return Err(ModelError::Data(format!(
                "the calibration's contacts do not determine a polynomial of degree {degree}: they must spread in both directions"
            )));
        }
        let projected = qr.q().transpose() * readings;
        let coefficients = r.solve_upper_triangular(&projected).ok_or_else(|| {
            ModelError::Data(format!("the calibration does not determine a polynomial of degree {degree}"))
        })?;
        Ok(Self {
            kind: KIND.into(),
            degree,
            center_m: [x0, y0],
            scale_m: [a, b],
            coefficients_n_m: coefficients.iter().copied().collect(),
        })
    }
}

impl SensorModel for Polynomial {
    fn kind(&self) -> &'static str {
        KIND
    }

    fn reading_n_m(&self, contact: Point<Base>) -> f64 {
        self.predict(contact).reading_n_m
    }

    /// Value and gradient together by Horner's rule, in `u` over polynomials in `v`.
    fn predict(&self, contact: Point<Base>) -> Prediction {
        let u = (contact.x() - self.center_m[0]) / self.scale_m[0];
        let v = (contact.y() - self.center_m[1]) / self.scale_m[1];
        let (mut value, mut by_u, mut by_v) = (0.0, 0.0, 0.0);
        let mut end = self.coefficients_n_m.len();
        for i in (0..=self.degree).rev() {
            let start = end - (self.degree - i + 1);
            let (mut row, mut row_by_v) = (0.0, 0.0);
            for &coefficient in self.coefficients_n_m[start..end].iter().rev() {
                row_by_v = row_by_v * v + row;
                row = row * v + coefficient;
            }
            by_u = by_u * u + value;
            by_v = by_v * u + row_by_v;
            value = value * u + row;
            end = start;
        }
        Prediction { reading_n_m: value, gradient_n: Vector2::new(by_u / self.scale_m[0], by_v / self.scale_m[1]) }
    }

    fn to_json(&self) -> Value {
        serde_json::to_value(self).expect("a struct of numbers serialises")
    }

    fn about(&self) -> String {
        format!("polynomial of degree {}", self.degree)
    }
}

pub(super) fn defaults() -> Value {
    serde_json::to_value(PolynomialConfig::default()).expect("a struct of numbers serialises")
}

pub(super) fn fit(samples: &[Sample], config: &Value) -> Made {
    let config = PolynomialConfig::deserialize(config).map_err(|reason| ModelError::Settings { kind: KIND, reason })?;
    Ok(Box::new(Polynomial::fit(samples, config)?))
}

pub(super) fn load(value: &Value) -> Made {
    let model = Polynomial::deserialize(value).map_err(|reason| ModelError::Settings { kind: KIND, reason })?;
    check_degree(model.degree)?;
    let expected = terms(model.degree);
    let found = model.coefficients_n_m.len();
    if found != expected {
        return Err(ModelError::Data(format!(
            "a polynomial of degree {} has {expected} coefficients, found {found}",
            model.degree
        )));
    }
    // A scale is half the extent of a calibration; one below a nanometre is none.
    if !model.scale_m.iter().all(|scale| *scale > 1e-9) {
        return Err(ModelError::Data(format!(
            "`scale_m`: found {:?}, expected half the extent of the calibration",
            model.scale_m
        )));
    }
    Ok(Box::new(model))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn samples(g: impl Fn(f64, f64) -> f64) -> Vec<Sample> {
        let mut samples = Vec::new();
        for i in 0..30 {
            for j in 0..12 {
                let (x, y) = (0.02 + 0.002 * f64::from(i), -0.02 + 0.0015 * f64::from(j) + 0.1 * 0.002 * f64::from(i));
                samples.push(Sample { contact: Point::new(x, y), reading_n_m: g(x, y) });
            }
        }
        samples
    }

    #[test]
    fn val_recovers_a_polynomial_of_its_own_degree() {
        let g = |x: f64, y: f64| 3e-5 + 2e-3 * y + 40.0 * x * y * y - 900.0 * x.powi(3) * y * y;
        let model = Polynomial::fit(&samples(g), PolynomialConfig { degree: 5 }).unwrap();
        for (x, y) in [(0.031_f64, -0.011_f64), (0.055, -0.004), (0.077, -0.016)] {
            let by_x = 40.0 * y * y - 2700.0 * x * x * y * y;
            let by_y = 2e-3 + 80.0 * x * y - 1800.0 * x.powi(3) * y;
            let found = model.predict(Point::new(x, y));
            assert!((found.reading_n_m - g(x, y)).abs() < 1e-16);
            assert!((found.gradient_n - Vector2::new(by_x, by_y)).norm() < 1e-12);
        }
    }

    #[test]
    fn verif_survives_writing_and_reading() {
        let model = Polynomial::fit(&samples(|x, y| x * y), PolynomialConfig { degree: 3 }).unwrap();
        let text = serde_json::to_string(&model.to_json()).unwrap();
        let again = load(&serde_json::from_str(&text).unwrap()).unwrap();
        assert_eq!(again.to_json(), model.to_json());
    }

    #[test]
    fn robust_refuses_data_that_do_not_determine_it() {
        let on_a_line: Vec<_> =
            (0..100).map(|i| Sample { contact: Point::new(f64::from(i) * 1e-3, 0.0), reading_n_m: 0.0 }).collect();
        for samples in [&on_a_line[..], &on_a_line[..3]] {
            let error = Polynomial::fit(samples, PolynomialConfig::default()).unwrap_err();
            assert!(matches!(error, ModelError::Data(_)));
        }
    }
}
