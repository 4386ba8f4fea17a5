//! Trivariate polynomials of total degree `n` in the contact's coordinates in Base, one for each bending moment (Lin et al. 2024
//! use `n` = 5).
//!
//! With `u = (x - x0) / a` within [-1, 1] over the calibration, and `v`, `w` likewise: `g(x, y, z) = sum c_ijk T_i(u) T_j(v)
//! T_k(w)`, `i + j + k <= n`, `T_i` the Chebyshev polynomials, as in the plane.

use std::array;

use nalgebra::{DMatrix, Matrix2x3, Vector2, Vector3};
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use super::{
    FittedSpatialModel, SpatialLoaded, SpatialModel, SpatialPrediction, SpatialRegion, SpatialSample,
    check_coefficients,
};
use crate::frames::Base;
use crate::sensor::ModelError;
use crate::sensor::regression::Triangle;
use crate::settings::typed;
use crate::space::frames::Point;

pub(super) const KIND: &str = "polynomial";

/// Largest degree.
const MOST_DEGREE: usize = 12;

/// Settings of the fit.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
struct Config {
    /// Total degree.
    degree: usize,
}

impl Default for Config {
    fn default() -> Self {
        Self { degree: 5 }
    }
}

/// The fitted polynomials.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Polynomial {
    kind: String,
    degree: usize,
    center_m: [f64; 3],
    scale_m: [f64; 3],
    /// `c_ijk` of the moments about y and z, with `i` ascending, within it `j`, within it `k`.
    coefficients_n_m: [Vec<f64>; 2],
}

/// `T_0` to `T_n` of an argument, and their derivatives.
fn chebyshev(u: f64, degree: usize) -> ([f64; MOST_DEGREE + 1], [f64; MOST_DEGREE + 1]) {
    let (mut values, mut slopes) = ([1.0; MOST_DEGREE + 1], [0.0; MOST_DEGREE + 1]);
    for i in 1..=degree {
        let (before, slope_before) = if i == 1 { (u, 0.0) } else { (values[i - 2], slopes[i - 2]) };
        values[i] = if i == 1 { u } else { 2.0 * u * values[i - 1] - before };
        slopes[i] = if i == 1 { 1.0 } else { 2.0 * (values[i - 1] + u * slopes[i - 1]) - slope_before };
    }
    (values, slopes)
}

/// Number of coefficients.
fn count(degree: usize) -> usize {
    (degree + 1) * (degree + 2) * (degree + 3) / 6
}

/// Exponents of the terms, in order.
fn terms(degree: usize) -> impl Iterator<Item = [usize; 3]> {
    (0..=degree).flat_map(move |i| (0..=degree - i).flat_map(move |j| (0..=degree - i - j).map(move |k| [i, j, k])))
}

impl Polynomial {
    fn scaled(&self, contact: Point<Base>) -> [f64; 3] {
        array::from_fn(|axis| (contact.vector()[axis] - self.center_m[axis]) / self.scale_m[axis])
    }

    /// Writes the terms at a contact.
    fn fill(&self, contact: Point<Base>, row: &mut [f64]) {
        let [x, y, z] = self.scaled(contact).map(|u| chebyshev(u, self.degree).0);
        for (term, [i, j, k]) in row.iter_mut().zip(terms(self.degree)) {
            *term = x[i] * y[j] * z[k];
        }
    }
}

impl SpatialModel for Polynomial {
    fn kind(&self) -> &'static str {
        KIND
    }

    fn label(&self) -> String {
        format!("{KIND}-{}", self.degree)
    }

    fn predict(&self, contact: Point<Base>) -> SpatialPrediction {
        let [(x, dx), (y, dy), (z, dz)] = self.scaled(contact).map(|u| chebyshev(u, self.degree));
        let (mut reading_n_m, mut slopes) = (Vector2::zeros(), Matrix2x3::zeros());
        for (term, [i, j, k]) in terms(self.degree).enumerate() {
            let by_channel = Vector2::new(self.coefficients_n_m[0][term], self.coefficients_n_m[1][term]);
            reading_n_m += by_channel * (x[i] * y[j] * z[k]);
            let row = Vector3::new(dx[i] * y[j] * z[k], x[i] * dy[j] * z[k], x[i] * y[j] * dz[k]);
            slopes += by_channel * row.transpose();
        }
        let [a, b, c] = self.scale_m;
        let gradient_n = Matrix2x3::from_columns(&[slopes.column(0) / a, slopes.column(1) / b, slopes.column(2) / c]);
        SpatialPrediction { reading_n_m, gradient_n }
    }

    fn to_json(&self) -> Value {
        serde_json::to_value(self).expect("numbers and names serialise")
    }
}

pub(super) fn defaults() -> Value {
    serde_json::to_value(Config::default()).expect("a struct of numbers serialises")
}

pub(super) fn candidates(_: bool) -> Vec<Value> {
    vec![json!({ "degree": 3 }), json!({ "degree": 5 })]
}

fn check_degree(degree: usize) -> Result<(), ModelError> {
    if (1..=MOST_DEGREE).contains(&degree) {
        return Ok(());
    }
    Err(ModelError::Data(format!("`degree`: found {degree}, expected 1 to {MOST_DEGREE}")))
}

/// The polynomial of some samples, on the scale of `frame`.
fn fitted(frame: &Polynomial, samples: &[SpatialSample]) -> Result<Polynomial, ModelError> {
    let count = count(frame.degree);
    let undetermined = || {
        let (found, degree) = (samples.len(), frame.degree);
        ModelError::Data(format!(
            "the calibration's {found} places do not determine the {count} coefficients of degree {degree}"
        ))
    };
    let mut coefficients_n_m = [const { Vec::new() }; 2];
    for (channel, coefficients) in coefficients_n_m.iter_mut().enumerate() {
        let triangle = Triangle::new(count, samples, |sample, row| {
            let weight = sample.count.sqrt();
            frame.fill(sample.contact, row);
            row.iter_mut().for_each(|term| *term *= weight);
            sample.reading_n_m[channel] * weight
        });
        let estimate = triangle.estimate(&DMatrix::zeros(0, count)).ok_or_else(undetermined)?;
        *coefficients = estimate.coefficients.as_slice().to_vec();
    }
    Ok(Polynomial { coefficients_n_m, ..frame.clone() })
}

pub(super) fn fit(
    _: &SpatialRegion<'_>,
    lines: &[Vec<SpatialSample>],
    config: &Value,
) -> Result<FittedSpatialModel, ModelError> {
    let Config { degree } = typed::<Config>(config).map_err(|reason| ModelError::Settings { kind: KIND, reason })?;
    check_degree(degree)?;
    let all = lines.concat();
    let extreme = |axis: usize, pick: fn(f64, f64) -> f64, from: f64| {
        all.iter().map(|sample| sample.contact.vector()[axis]).fold(from, pick)
    };
    let range = array::from_fn::<_, 3, _>(|axis| {
        (extreme(axis, f64::min, f64::INFINITY), extreme(axis, f64::max, f64::NEG_INFINITY))
    });
    let frame = Polynomial {
        kind: KIND.into(),
        degree,
        center_m: range.map(|(low, high)| 0.5 * (low + high)),
        scale_m: range.map(|(low, high)| 0.5 * (high - low)),
        coefficients_n_m: [const { Vec::new() }; 2],
    };
    let model = fitted(&frame, &all)?;
    let lines = lines.to_vec();
    let without = move |line: usize, heldout: &[usize]| {
        let training = lines.iter().enumerate().filter(|(other, _)| !heldout.contains(other));
        let training: Vec<SpatialSample> = training.flat_map(|(_, samples)| samples).copied().collect();
        let learnt = fitted(&frame, &training)?;
        Ok(lines[line].iter().map(|sample| learnt.predict(sample.contact).reading_n_m).collect())
    };
    Ok(FittedSpatialModel { model: Box::new(model), without: Box::new(without), correlations: None })
}

pub(super) fn load(_: &SpatialRegion<'_>, value: &Value) -> SpatialLoaded {
    let model: Polynomial = typed(value).map_err(|reason| ModelError::Settings { kind: KIND, reason })?;
    check_degree(model.degree)?;
    check_coefficients(&model.coefficients_n_m, count(model.degree))?;
    let is_scale = |scale: &f64| scale.is_finite() && *scale > 0.0;
    if !(model.scale_m.iter().all(is_scale) && model.center_m.iter().all(|center| center.is_finite())) {
        return Err(ModelError::Data("`center_m`, `scale_m`: expected finite numbers, the scales positive".into()));
    }
    Ok(Box::new(model))
}
