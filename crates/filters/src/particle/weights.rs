//! Weights of particles: passes over columns that do not depend on the state.
//!
//! The functions that end in `_by` compute with the vectors of a given instruction set, the others with the widest. The latter have
//! no type parameters, so that they are compiled once, in this crate, and not for every model of a crate that uses it.

use fearless_simd::prelude::*;

use crate::simd::{self, Rows};
use crate::{StateArray, vectorised};

/// Weights before an update.
#[derive(Clone, Copy)]
pub(super) struct Before<'a> {
    pub(super) weights: &'a [f64],
    pub(super) logs: &'a [f64],
    pub(super) largest_log: f64,
}

/// Weighted sums over the particles at which the model is defined, and the largest logarithm of the updated weights.
#[derive(Debug, PartialEq)]
pub(super) struct Sums {
    /// Sum of the weights.
    pub(super) weight: f64,
    /// Sum of the residuals.
    pub(super) first: f64,
    /// Sum of the squared residuals.
    pub(super) second: f64,
    /// Sum of the measurement noise variances.
    pub(super) variance: f64,
    pub(super) largest_log: f64,
}

/// Writes the logarithms of the updated weights, up to a common constant, for a constant noise variance. A residual is NaN where
/// the model is undefined.
pub(super) fn log_weights_constant_noise(
    residuals: &StateArray<1>,
    variance: f64,
    before: Before<'_>,
    logs: &mut [f64],
) -> Sums {
    vectorised!(simd => log_weights_constant_noise_by(simd, residuals, variance, before, logs))
}

/// Writes the logarithms of the updated weights, up to a common constant, for a noise variance per particle. A residual is NaN
/// where the model is undefined.
pub(super) fn log_weights(residuals: &StateArray<1>, variances: &[f64], before: Before<'_>, logs: &mut [f64]) -> Sums {
    vectorised!(simd => log_weights_by(simd, residuals, variances, before, logs))
}

/// Largest of the first `count` logarithms.
pub(super) fn largest(count: usize, logs: &[f64]) -> f64 {
    vectorised!(simd => simd::largest(simd, count, logs))
}

/// Writes the normalised weights of given logarithms and returns their effective sample size.
pub(super) fn normalised(count: usize, logs: &[f64], largest_log: f64, weights: &mut [f64]) -> f64 {
    vectorised!(simd => normalised_by(simd, count, logs, largest_log, weights))
}

/// Writes the index of the particle into whose interval of the cumulative weights each of the evenly spaced pointers
/// `(i + start) / count` falls.
pub(super) fn systematic_sources(weights: &[f64], sources: &mut [usize], start: f64) {
    vectorised!(systematic_sources_as_wide_as_here(weights, sources, start));
}

/// Adds particles to the sums of the weights, the residuals and the squared residuals, and to the largest logarithm.
/// Returns the logarithms of their updated weights, minus infinity where the residual is NaN.
#[inline(always)]
fn weigh<S: Simd>(
    simd: S,
    [weight, residual, log]: [Rows<S>; 3],
    [sum, first, second, largest]: [&mut Rows<S>; 4],
) -> Rows<S> {
    let is_defined = residual.simd_eq(residual);
    let residual = is_defined.select(residual, Rows::splat(simd, 0.0));
    let log = is_defined.select(log, Rows::splat(simd, f64::NEG_INFINITY));
    let weighted = weight * residual;
    *sum = is_defined.select(*sum + weight, *sum);
    *first += weighted;
    *second = weighted.mul_add_precise(residual, *second);
    *largest = largest.max(log);
    log
}

/// Applies a scalar function to each row.
#[inline(always)]
fn each<S: Simd>(simd: S, rows: Rows<S>, function: impl Fn(f64) -> f64) -> Rows<S> {
    let mut values = rows.to_array();
    values.iter_mut().for_each(|value| *value = function(*value));
    Rows::load_array(simd, values)
}

/// As [`log_weights_constant_noise`], by the vectors of an instruction set.
#[inline(always)]
pub(super) fn log_weights_constant_noise_by(
    simd: impl Simd,
    residuals: &StateArray<1>,
    variance: f64,
    before: Before<'_>,
    logs: &mut [f64],
) -> Sums {
    let factor = Rows::splat(simd, -0.5 / variance);
    let [of_particles] = residuals.padded_columns();
    let columns = (of_particles, [before.weights, before.logs]);
    let start = [[0.0, 0.0, 0.0, f64::NEG_INFINITY]];
    let [[weight, first, second, largest]] = simd::pass(
        simd,
        residuals.len(),
        columns,
        [logs],
        start,
        |residual, [weight, log], [[sum, first, second, largest]]| {
            let log = factor.mul_add_precise(residual * residual, log - before.largest_log);
            [weigh(simd, [weight, residual, log], [sum, first, second, largest])]
        },
    );
    let weight = simd::total(weight);
    Sums {
        weight,
        first: simd::total(first),
        second: simd::total(second),
        variance: variance * weight,
        largest_log: simd::largest_part(largest),
    }
}

/// As [`log_weights`], by the vectors of an instruction set.
#[inline(always)]
pub(super) fn log_weights_by(
    simd: impl Simd,
    residuals: &StateArray<1>,
    variances: &[f64],
    before: Before<'_>,
    logs: &mut [f64],
) -> Sums {
    let [of_particles] = residuals.padded_columns();
    let columns = (of_particles, [variances, before.weights, before.logs]);
    let start = [[0.0, 0.0, 0.0, 0.0, f64::NEG_INFINITY]];
    let [[variance, weight, first, second, largest]] = simd::pass(
        simd,
        residuals.len(),
        columns,
        [logs],
        start,
        |residual, [variance, weight, log], [[total, sum, first, second, largest]]| {
            let density = (residual * residual / variance + each(simd, variance, simd::ln)) * -0.5;
            let log = log - before.largest_log + density;
            *total = residual.is_nan().select(*total, weight.mul_add_precise(variance, *total));
            [weigh(simd, [weight, residual, log], [sum, first, second, largest])]
        },
    );
    Sums {
        weight: simd::total(weight),
        first: simd::total(first),
        second: simd::total(second),
        variance: simd::total(variance),
        largest_log: simd::largest_part(largest),
    }
}

/// As [`normalised`], by the vectors of an instruction set.
#[inline(always)]
pub(super) fn normalised_by(simd: impl Simd, count: usize, logs: &[f64], largest_log: f64, weights: &mut [f64]) -> f64 {
    let [[sum, squares]] =
        simd::pass(simd, count, (logs, []), [&mut *weights], [[0.0; 2]], |log, [], [[sum, squares]]| {
            let weight = simd::exp(simd, log - largest_log);
            *sum += weight;
            *squares = weight.mul_add_precise(weight, *squares);
            [weight]
        });
    let (sum, squares) = (simd::total(sum), simd::total(squares));
    let share = 1.0 / sum;
    weights.iter_mut().for_each(|weight| *weight *= share);
    sum * sum / squares
}

#[inline(always)]
fn systematic_sources_as_wide_as_here(weights: &[f64], sources: &mut [usize], start: f64) {
    let count = weights.len();
    sources.fill(0);
    let mut reached = 0.0;
    // Sums within chunks shorten the chain of dependent additions.
    for (chunk, weights) in weights.chunks(8).enumerate() {
        let mut within = 0.0;
        for (place, weight) in weights.iter().enumerate() {
            // First pointer within or after this particle's interval. A particle without pointers is overwritten by the
            // next one.
            let first = ((reached + within) * count as f64 - start).ceil() as usize;
            sources[first.min(count)] = 8 * chunk + place;
            within += weight;
        }
        reached += within;
    }
    let mut last = 0;
    for source in sources {
        last = last.max(*source);
        *source = last;
    }
}
