//! Smooth map without mechanics: a penalised tensor-product spline (P-spline; Eilers and Marx, "Flexible smoothing with
//! B-splines and penalties", Statistical Science 11, 1996).
//!
//! ```text
//! g(u, v) = sum c_ij B_i(u) B_j(v)    penalty = w_u sum (c_i-1,j - 2 c_ij + c_i+1,j)^2 + w_v sum (c_i,j-1 - 2 c_ij + c_i,j+1)^2
//! ```
//!
//! `B_i` are cubic B-splines on even knots over the region's extent in the coordinates of [`super::polar`]. The weights
//! `w_u`, `w_v` are those with the least generalised cross-validation score `n |e|^2 / (n - f)^2`, where `e` are the
//! residuals of the `n` samples and `f` the degrees of freedom (Golub, Heath and Wahba, Technometrics 21, 1979).

use nalgebra::{DMatrix, DVector, Vector2};
use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::polar::Frame;
use super::regression::{Estimate, Triangle};
use super::{FittedModel, Loaded, ModelError, Prediction, Region, Sample, SensorModel};
use crate::frames::{Base, Point};
use crate::settings::typed;

pub(super) const KIND: &str = "spline";

/// Largest number of knot intervals in one direction.
const MOST_INTERVALS: usize = 20;

/// Exponents of ten that are tried as weights, relative to an average sample's square in the basis.
const WEIGHTS: std::ops::RangeInclusive<i32> = -7..=3;

#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
struct Config {
    /// Knot intervals along the whisker.
    along: usize,
    /// Knot intervals away from it.
    away: usize,
}

impl Default for Config {
    fn default() -> Self {
        Self { along: 9, away: 6 }
    }
}

/// The fitted spline.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Stored {
    kind: String,
    /// Knot intervals along and away.
    intervals: [usize; 2],
    /// Weights of the two penalties.
    weights: [f64; 2],
    /// `c_ij` with `i` (along) ascending, within it `j` ascending.
    coefficients_n_m: Vec<f64>,
}

#[derive(Debug)]
struct Spline {
    frame: Frame,
    stored: Stored,
}

/// The four splines that differ from zero in an interval, at the position `t` in it, and their derivatives.
pub(crate) fn basis(t: f64) -> ([f64; 4], [f64; 4]) {
    let r = 1.0 - t;
    let values = [
        r * r * r / 6.0,
        (4.0 - 6.0 * t * t + 3.0 * t * t * t) / 6.0,
        (4.0 - 6.0 * r * r + 3.0 * r * r * r) / 6.0,
        t * t * t / 6.0,
    ];
    let slopes = [-0.5 * r * r, 1.5 * t * t - 2.0 * t, 2.0 * r - 1.5 * r * r, 0.5 * t * t];
    (values, slopes)
}

/// A position among the knots.
struct Spot {
    /// First of the four splines in each direction.
    first: [usize; 2],
    values: [[f64; 4]; 2],
    slopes: [[f64; 4]; 2],
    /// Distance beyond the knots, in intervals.
    beyond: Vector2<f64>,
}

fn spot(frame: &Frame, intervals: [usize; 2], at: [f64; 2]) -> Spot {
    let mut spot = Spot { first: [0; 2], values: [[0.0; 4]; 2], slopes: [[0.0; 4]; 2], beyond: Vector2::zeros() };
    for axis in 0..2 {
        let position = (at[axis] - frame.first[axis]) * per_unit(frame, intervals, axis);
        let held = position.clamp(0.0, intervals[axis] as f64);
        spot.first[axis] = (held as usize).min(intervals[axis] - 1);
        (spot.values[axis], spot.slopes[axis]) = basis(held - spot.first[axis] as f64);
        spot.beyond[axis] = position - held;
    }
    spot
}

/// Knot intervals per unit of a coordinate.
fn per_unit(frame: &Frame, intervals: [usize; 2], axis: usize) -> f64 {
    intervals[axis] as f64 / (frame.last[axis] - frame.first[axis])
}

fn count(intervals: [usize; 2]) -> usize {
    (intervals[0] + 3) * (intervals[1] + 3)
}

/// Row of the products `B_i B_j` at a contact.
fn fill(frame: &Frame, intervals: [usize; 2], contact: Point<Base>, row: &mut [f64]) {
    let spot = spot(frame, intervals, frame.polar(contact).at);
    for (i, along) in spot.values[0].into_iter().enumerate() {
        for (j, away) in spot.values[1].into_iter().enumerate() {
            row[(spot.first[0] + i) * (intervals[1] + 3) + spot.first[1] + j] = along * away;
        }
    }
}

/// Second differences of the coefficients along and away, multiplied by the roots of their weights.
fn penalty(intervals: [usize; 2], weights: [f64; 2]) -> DMatrix<f64> {
    let [along, away] = intervals.map(|n| n + 3);
    let index = |i: usize, j: usize| i * away + j;
    let mut triples = Vec::new();
    for i in 0..along {
        for j in 0..away {
            if i + 2 < along {
                triples.push((weights[0], [index(i, j), index(i + 1, j), index(i + 2, j)]));
            }
            if j + 2 < away {
                triples.push((weights[1], [index(i, j), index(i, j + 1), index(i, j + 2)]));
            }
        }
    }
    let mut rows = DMatrix::zeros(triples.len(), along * away);
    for (row, (weight, indices)) in triples.into_iter().enumerate() {
        for (column, factor) in indices.into_iter().zip([1.0, -2.0, 1.0]) {
            rows[(row, column)] = factor * weight.sqrt();
        }
    }
    rows
}

/// The powers of ten of two penalty weights with the smallest score, and the result that `score` returns with it: each is varied in
/// turn until neither changes. `None` if the first ones have no score.
pub(crate) fn best_weights<T>(score: impl Fn([i32; 2]) -> Option<(f64, T)>) -> Option<([i32; 2], T)> {
    let mut powers = [*WEIGHTS.start() / 2; 2];
    let mut best = score(powers)?;
    loop {
        let before = powers;
        for (axis, step) in [(0, -1), (0, 1), (1, -1), (1, 1)] {
            loop {
                let mut next = powers;
                next[axis] += step;
                let Some(tried) = WEIGHTS.contains(&next[axis]).then(|| score(next)).flatten() else { break };
                if tried.0 >= best.0 {
                    break;
                }
                (best, powers) = (tried, next);
            }
        }
        if powers == before {
            return Some((powers, best.1));
        }
    }
}

/// The estimate with the weights of the smallest score of the generalised cross-validation.
fn smooth(triangle: &Triangle, intervals: [usize; 2], samples: usize) -> Option<([f64; 2], Estimate)> {
    let scale = samples as f64 / count(intervals) as f64;
    let weights = |powers: [i32; 2]| powers.map(|power| scale * 10_f64.powi(power));
    let score = |powers: [i32; 2]| {
        let estimate = triangle.estimate(&penalty(intervals, weights(powers)))?;
        // n |e|^2 / (n - f)^2 is the noise's variance over 1 - f / n.
        let score = estimate.noise_variance / (1.0 - estimate.freedom / samples as f64);
        Some((score, estimate))
    };
    best_weights(score).map(|(powers, estimate)| (weights(powers), estimate))
}

impl SensorModel for Spline {
    fn kind(&self) -> &'static str {
        KIND
    }

    fn reading_n_m(&self, contact: Point<Base>) -> f64 {
        self.predict(contact).reading_n_m
    }

    fn to_json(&self) -> Value {
        serde_json::to_value(&self.stored).expect("a struct of numbers serialises")
    }

    fn about(&self) -> String {
        let [along, away] = self.stored.intervals;
        format!("penalised cubic spline on {along} x {away} intervals")
    }

    fn predict(&self, contact: Point<Base>) -> Prediction {
        let intervals = self.stored.intervals;
        let polar = self.frame.polar(contact);
        let spot = spot(&self.frame, intervals, polar.at);
        let (mut value, mut slopes) = (0.0, Vector2::zeros());
        for i in 0..4 {
            let start = (spot.first[0] + i) * (intervals[1] + 3) + spot.first[1];
            let row = &self.stored.coefficients_n_m[start..start + 4];
            let sum = |weights: &[f64; 4]| -> f64 { row.iter().zip(weights).map(|(c, weight)| c * weight).sum() };
            let (level, steep) = (sum(&spot.values[1]), sum(&spot.slopes[1]));
            value += spot.values[0][i] * level;
            slopes += Vector2::new(spot.slopes[0][i] * level, spot.values[0][i] * steep);
        }
        let units = Vector2::new(per_unit(&self.frame, intervals, 0), per_unit(&self.frame, intervals, 1));
        Prediction {
            reading_n_m: value + slopes.dot(&spot.beyond),
            gradient_n: polar.by_place(slopes.component_mul(&units)),
        }
    }
}

pub(super) fn defaults() -> Value {
    serde_json::to_value(Config::default()).expect("a struct of numbers serialises")
}

pub(super) fn candidates() -> Vec<Value> {
    vec![defaults()]
}

fn check(intervals: [usize; 2]) -> Result<(), ModelError> {
    for (key, found) in [("along", intervals[0]), ("away", intervals[1])] {
        if !(1..=MOST_INTERVALS).contains(&found) {
            return Err(ModelError::Data(format!("`{key}`: found {found}, expected 1 to {MOST_INTERVALS} intervals")));
        }
    }
    Ok(())
}

fn frame(region: &Region<'_>) -> Result<Frame, ModelError> {
    Frame::new(region).ok_or_else(|| ModelError::Data("the calibrated domain has no extent".into()))
}

pub(super) fn fit(region: &Region<'_>, samples: &[Sample], config: &Value) -> Result<FittedModel, ModelError> {
    let config: Config = typed(config).map_err(|reason| ModelError::Settings { kind: KIND, reason })?;
    let intervals = [config.along, config.away];
    check(intervals)?;
    let frame = frame(region)?;
    let triangle = Triangle::new(count(intervals), samples, |sample, row| {
        fill(&frame, intervals, sample.contact, row);
        sample.reading_n_m
    });
    let (weights, estimate) = smooth(&triangle, intervals, samples.len()).ok_or_else(|| {
        ModelError::Data(
            "the calibration's contacts do not determine a spline: they must spread in both directions".into(),
        )
    })?;
    let coefficients_n_m = estimate.coefficients.iter().copied().collect();
    let stored = Stored { kind: KIND.into(), intervals, weights, coefficients_n_m };
    let own = frame.clone();
    let variance_n2_m2 = move |contact| {
        let mut row = DVector::zeros(count(intervals));
        fill(&own, intervals, contact, row.as_mut_slice());
        estimate.variance(&row)
    };
    Ok(FittedModel { model: Box::new(Spline { frame, stored }), variance_n2_m2: Box::new(variance_n2_m2) })
}

pub(super) fn load(region: &Region<'_>, value: &Value) -> Loaded {
    let stored: Stored = typed(value).map_err(|reason| ModelError::Settings { kind: KIND, reason })?;
    check(stored.intervals)?;
    let (found, expected) = (stored.coefficients_n_m.len(), count(stored.intervals));
    if found != expected {
        return Err(ModelError::Data(format!("`coefficients_n_m`: found {found}, expected {expected}")));
    }
    Ok(Box::new(Spline { frame: frame(region)?, stored }))
}
