//! Bivariate polynomial of total degree `n` in the contact's coordinates in Base (Lin et al. 2022 use `n` = 5).
//!
//! With `u = (x - x0) / a`, `v = (y - y0) / b`, both within [-1, 1] over the calibration: `g(x, y) = sum c_ij T_i(u)
//! T_j(v)`, `i + j <= n`, `T_i` the Chebyshev polynomials. They span the same space as the monomials `x^i y^j`, but
//! remain well conditioned at high degrees.

use nalgebra::{DMatrix, DVector, Vector2};
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use super::regression::Triangle;
use super::{FittedModel, Loaded, ModelError, Prediction, Region, Sample, SensorModel};
use crate::frames::{Base, Point};
use crate::settings::typed;

pub(super) const KIND: &str = "polynomial";

/// Largest degree.
const MOST_DEGREE: usize = 24;

/// Settings of the fit.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub(super) struct PolynomialConfig {
    /// Total degree.
    degree: usize,
}

impl Default for PolynomialConfig {
    fn default() -> Self {
        Self { degree: 5 }
    }
}

/// The fitted polynomial.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Polynomial {
    kind: String,
    degree: usize,
    center_m: [f64; 2],
    scale_m: [f64; 2],
    /// `c_ij` with `i` ascending, within it `j` ascending.
    coefficients_n_m: Vec<f64>,
}

/// `T_0` to `T_(N-1)` of an argument, by `T_(m+n) = 2 T_m T_n - T_(m-n)` with `m - n` 0 or 1, a short chain of
/// dependent operations.
#[inline(always)]
fn chebyshev<const N: usize>(u: f64) -> [f64; N] {
    let mut values = [1.0; N];
    for i in 1..N {
        let (low, high) = (i / 2, i - i / 2);
        values[i] = if i == 1 { u } else { 2.0 * values[low] * values[high] - values[high - low] };
    }
    values
}

/// Their derivatives, by that of the recurrence `T_(i+1) = 2 u T_i - T_(i-1)`.
#[inline(always)]
fn chebyshev_slopes<const N: usize>(u: f64, values: &[f64; N]) -> [f64; N] {
    let mut slopes = [0.0; N];
    for i in 1..N {
        slopes[i] = if i == 1 { 1.0 } else { 2.0 * (values[i - 1] + u * slopes[i - 1]) - slopes[i - 2] };
    }
    slopes
}

/// `sum c_ij T_i(u) T_j(v)`, `i + j < count`, with `count` at most `N`.
#[inline(always)]
fn value<const N: usize>(count: usize, model: &Polynomial, contact: Point<Base>) -> f64 {
    let (u, v) = model.scaled(contact.x(), contact.y());
    let coefficients = model.coefficients(count);
    let (by_u, by_v) = (chebyshev::<N>(u), chebyshev::<N>(v));
    // In descending order: the values known first are added first, the longest row last.
    let (mut value, mut start) = (0.0, coefficients.len());
    for i in (0..count).rev() {
        start -= count - i;
        let mut row = coefficients[start] * by_v[0];
        for j in 1..count - i {
            row += coefficients[start + j] * by_v[j];
        }
        value = if i + 1 == count { by_u[i] * row } else { value + by_u[i] * row };
    }
    value
}

/// The result of [`value`], bit by bit, and the slopes from the same sums over `j`.
#[inline(always)]
fn value_and_slopes<const N: usize>(count: usize, model: &Polynomial, contact: Point<Base>) -> Prediction {
    let (u, v) = model.scaled(contact.x(), contact.y());
    let coefficients = model.coefficients(count);
    let (by_u, by_v) = (chebyshev::<N>(u), chebyshev::<N>(v));
    let (slopes_u, slopes_v) = (chebyshev_slopes(u, &by_u), chebyshev_slopes(v, &by_v));
    let (mut value, mut slope_u, mut slope_v, mut start) = (0.0, 0.0, 0.0, coefficients.len());
    for i in (0..count).rev() {
        start -= count - i;
        let (mut row, mut row_slope) = (coefficients[start] * by_v[0], 0.0);
        for j in 1..count - i {
            row += coefficients[start + j] * by_v[j];
            row_slope += coefficients[start + j] * slopes_v[j];
        }
        value = if i + 1 == count { by_u[i] * row } else { value + by_u[i] * row };
        slope_u += slopes_u[i] * row;
        slope_v += by_u[i] * row_slope;
    }
    Prediction { reading_n_m: value, gradient_n: Vector2::new(slope_u / model.scale_m[0], slope_v / model.scale_m[1]) }
}

/// Calls a function of the number of Chebyshev polynomials, one more than the degree. It is compiled for each number up to 13, so
/// that the compiler unrolls its loops, and once for all larger ones, whose unrolled loops would take long to compile.
macro_rules! by_degree {
    ($degree:expr, $function:ident($model:expr, $contact:expr)) => {
        by_degree!(@ $degree, $function, $model, $contact, 1 2 3 4 5 6 7 8 9 10 11 12 13)
    };
    (@ $degree:expr, $function:ident, $model:expr, $contact:expr, $($count:literal)*) => {
        match $degree + 1 {
            $($count => $function::<$count>($count, $model, $contact),)*
            count => $function::<{ MOST_DEGREE + 1 }>(count, $model, $contact),
        }
    };
}

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
    /// Least-squares fit, and the variance of its predictions.
    ///
    /// # Errors
    /// [`ModelError::Data`] if the samples do not determine the coefficients.
    fn fit(samples: &[Sample], degree: usize) -> Result<FittedModel, ModelError> {
        check_degree(degree)?;
        let count = terms(degree);
        if samples.len() <= count {
            return Err(ModelError::Data(format!(
                "samples of the calibration: found {}, expected more than the {count} coefficients of a polynomial of degree \
                {degree}",
                samples.len()
            )));
        }
        let (x0, a) = middle_and_half(samples.iter().map(|s| s.contact.x()));
        let (y0, b) = middle_and_half(samples.iter().map(|s| s.contact.y()));
        let mut model =
            Self { kind: KIND.into(), degree, center_m: [x0, y0], scale_m: [a, b], coefficients_n_m: vec![0.0; count] };
        let triangle = Triangle::new(count, samples, |sample, row| {
            model.basis(sample.contact, row);
            sample.reading_n_m
        });
        let estimate = triangle.estimate(&DMatrix::zeros(0, count)).ok_or_else(|| {
            ModelError::Data(format!(
                "the calibration's contacts do not determine a polynomial of degree {degree}: they must spread in both directions"
            ))
        })?;
        model.coefficients_n_m = estimate.coefficients.iter().copied().collect();
        let of_basis = model.clone();
        let variance_n2_m2 = move |contact| {
            let mut basis = DVector::zeros(count);
            of_basis.basis(contact, basis.as_mut_slice());
            estimate.variance(&basis)
        };
        Ok(FittedModel { model: Box::new(model), variance_n2_m2: Box::new(variance_n2_m2) })
    }

    /// The coefficients as a slice whose length the compiler knows if it knows `count`, so that it omits bounds checks.
    #[inline(always)]
    fn coefficients(&self, count: usize) -> &[f64] {
        &self.coefficients_n_m[..count * (count + 1) / 2]
    }

    /// The arguments of the Chebyshev polynomials. By the reciprocal: a division would change the last digits of all results.
    #[inline(always)]
    fn scaled(&self, x_m: f64, y_m: f64) -> (f64, f64) {
        ((x_m - self.center_m[0]) * (1.0 / self.scale_m[0]), (y_m - self.center_m[1]) * (1.0 / self.scale_m[1]))
    }

    /// The products `T_i T_j` in the order of the coefficients.
    fn basis(&self, contact: Point<Base>, row: &mut [f64]) {
        let (u, v) = self.scaled(contact.x(), contact.y());
        let (by_u, by_v) = (chebyshev::<{ MOST_DEGREE + 1 }>(u), chebyshev::<{ MOST_DEGREE + 1 }>(v));
        let pairs = (0..=self.degree).flat_map(|i| (0..=self.degree - i).map(move |j| (i, j)));
        for (product, (i, j)) in row.iter_mut().zip(pairs) {
            *product = by_u[i] * by_v[j];
        }
    }
}

impl SensorModel for Polynomial {
    fn kind(&self) -> &'static str {
        KIND
    }

    fn label(&self) -> String {
        format!("{KIND}-{}", self.degree)
    }

    fn reading_n_m(&self, contact: Point<Base>) -> f64 {
        by_degree!(self.degree, value(self, contact))
    }

    fn predict(&self, contact: Point<Base>) -> Prediction {
        by_degree!(self.degree, value_and_slopes(self, contact))
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

pub(super) fn candidates() -> Vec<Value> {
    [5, 7, 9].map(|degree| json!({ "degree": degree })).into()
}

pub(super) fn fit(_: &Region<'_>, samples: &[Sample], config: &Value) -> Result<FittedModel, ModelError> {
    let config: PolynomialConfig = typed(config).map_err(|reason| ModelError::Settings { kind: KIND, reason })?;
    Polynomial::fit(samples, config.degree)
}

pub(super) fn load(_: &Region<'_>, value: &Value) -> Loaded {
    let model: Polynomial = typed(value).map_err(|reason| ModelError::Settings { kind: KIND, reason })?;
    check_degree(model.degree)?;
    let expected = terms(model.degree);
    let found = model.coefficients_n_m.len();
    if found != expected {
        return Err(ModelError::Data(format!(
            "a polynomial of degree {} has {expected} coefficients, found {found}",
            model.degree
        )));
    }
    // A scale is half the extent of a calibration; one below a nanometre is invalid.
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
            for j in 0..24 {
                let (x, y) = (0.02 + 0.002 * f64::from(i), -0.02 + 0.75e-3 * f64::from(j) + 0.2e-3 * f64::from(i));
                samples.push(Sample { contact: Point::new(x, y), reading_n_m: g(x, y) });
            }
        }
        samples
    }

    #[test]
    fn val_recovers_a_polynomial_of_its_own_degree() {
        let g = |x: f64, y: f64| 3e-5 + 2e-3 * y + 40.0 * x * y * y - 900.0 * x.powi(3) * y * y;
        let model = Polynomial::fit(&samples(g), 5).unwrap().model;
        for (x, y) in [(0.031_f64, -0.011_f64), (0.055, -0.004), (0.077, -0.016)] {
            let by_x = 40.0 * y * y - 2700.0 * x * x * y * y;
            let by_y = 2e-3 + 80.0 * x * y - 1800.0 * x.powi(3) * y;
            let found = model.predict(Point::new(x, y));
            assert!((found.reading_n_m - g(x, y)).abs() < 1e-16);
            assert!((found.gradient_n - Vector2::new(by_x, by_y)).norm() < 1e-12);
        }
    }

    #[test]
    fn verif_a_prediction_has_the_value_of_the_reading_alone() {
        let contacts = samples(|x, y| (60.0 * x).sin() * (80.0 * y).exp());
        for degree in [0, 1, 5, 6, 7, 9, 12, 13, 24] {
            let model = Polynomial::fit(&contacts, degree).unwrap().model;
            for sample in &contacts {
                let reading_n_m = model.reading_n_m(sample.contact);
                assert_eq!(reading_n_m, model.predict(sample.contact).reading_n_m, "{degree}");
            }
        }
    }

    #[test]
    fn val_high_degrees_are_well_conditioned() {
        let g = |x: f64, y: f64| (60.0 * x).sin() * (80.0 * y).exp();
        let worst = |degree: usize| {
            let model = Polynomial::fit(&samples(g), degree).unwrap().model;
            let miss = |s: &Sample| (model.reading_n_m(s.contact) - s.reading_n_m).abs();
            samples(g).iter().map(miss).fold(0.0, f64::max)
        };
        assert!(worst(6) > 1e-6 && worst(18) < 1e-12, "{} {}", worst(6), worst(18));
    }

    #[test]
    fn robust_too_few_samples_are_counted() {
        let reason =
            Polynomial::fit(&samples(|_, y| y)[..1], 5).err().map(|error| error.to_string()).unwrap_or_default();
        let expected =
            "samples of the calibration: found 1, expected more than the 21 coefficients of a polynomial of degree 5";
        assert!(reason.ends_with(expected), "{reason}");
    }
}
