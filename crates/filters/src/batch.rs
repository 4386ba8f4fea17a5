//! Maximum a posteriori trajectory given all readings, by the Gauss-Newton method over all states at once. The normal
//! equations are block tridiagonal; a Kalman filter and a smoother, linearised along the current trajectory, solve them
//! exactly (Bell, "The iterated Kalman smoother as a Gauss-Newton method", SIAM Journal on Optimization 4(3), 1994).
//! Each step is shortened by a backtracking line search until the posterior density increases.

use nalgebra::{SMatrix, SVector};

use crate::gaussian::symmetrised;
use crate::iterated::Search;
use crate::smoother::{Step, smooth};
use crate::{Gaussian, Measurement, Process, UpdateError};

/// Step lengths that the line search tries, each half of the last.
const HALVINGS: usize = 8;

/// One instant: the process that leads to it, and its reading.
#[derive(Clone, Copy, Debug)]
pub struct Instant<Motion, Model, const M: usize> {
    /// Process from the previous instant; at the first instant, from the prior.
    pub process: Motion,
    /// Measurement model.
    pub measurement: Model,
    /// Reading.
    pub reading: SVector<f64, M>,
}

/// Maximum a posteriori trajectory with the covariance of each state, from a prior and an initial trajectory `guess`,
/// one state per instant. [`Search::tolerance_sds`] is in standard deviations of the linearised posterior.
///
/// # Errors
/// [`UpdateError`] if the measurement model is undefined along the trajectory or a covariance is not positive definite.
pub fn solve<const N: usize, const M: usize, Motion: Process<N>, Model: Measurement<N, M>>(
    prior: &Gaussian<N>,
    instants: &[Instant<Motion, Model, M>],
    guess: Vec<SVector<f64, N>>,
    search: &Search,
) -> Result<Vec<Gaussian<N>>, UpdateError> {
    let mut trajectory = guess;
    let mut least = cost(prior, instants, &trajectory)?;
    let mut found = linearised(prior, instants, &trajectory)?;
    for _ in 0..search.iterations {
        let better = (0..HALVINGS).find_map(|halving| {
            let share = 0.5f64.powi(halving as i32);
            let shorter: Vec<_> = trajectory.iter().zip(&found).map(|(x, to)| x + (to.mean - x) * share).collect();
            cost(prior, instants, &shorter).ok().filter(|&cost| cost < least).map(|cost| (shorter, cost))
        });
        let Some((moved, lower)) = better else { break };
        let sds = |(i, to): (usize, &SVector<f64, N>)| {
            let factor = found[i].covariance.cholesky()?;
            Some((to - trajectory[i]).dot(&factor.solve(&(to - trajectory[i]))))
        };
        let largest = moved.iter().enumerate().filter_map(sds).fold(0.0, f64::max);
        (trajectory, least) = (moved, lower);
        found = linearised(prior, instants, &trajectory)?;
        if largest < search.tolerance_sds * search.tolerance_sds {
            break;
        }
    }
    Ok(trajectory.into_iter().zip(found).map(|(mean, to)| Gaussian::new(mean, to.covariance)).collect())
}

/// Twice the negative logarithm of the trajectory's posterior density, up to a constant.
fn cost<const N: usize, const M: usize, Motion: Process<N>, Model: Measurement<N, M>>(
    prior: &Gaussian<N>,
    instants: &[Instant<Motion, Model, M>],
    trajectory: &[SVector<f64, N>],
) -> Result<f64, UpdateError> {
    let mut total = 0.0;
    for (k, (instant, x)) in instants.iter().zip(trajectory).enumerate() {
        let (from, spread) = match k.checked_sub(1) {
            None => transition(&instant.process, &prior.mean, &prior.covariance),
            Some(last) => (instant.process.predict(&trajectory[last]), instant.process.noise(&trajectory[last])),
        };
        let expected = instant.measurement.predict(x).ok_or(UpdateError::NoPrediction)?;
        let residual = instant.measurement.residual(&instant.reading, &expected);
        let noise = instant.measurement.noise(x).cholesky().ok_or(UpdateError::NotPositiveDefinite)?;
        let spread = spread.cholesky().ok_or(UpdateError::NotPositiveDefinite)?;
        total += residual.dot(&noise.solve(&residual)) + (x - from).dot(&spread.solve(&(x - from)));
    }
    Ok(total)
}

/// Mean and covariance after one step from a Gaussian.
fn transition<const N: usize>(
    process: &impl Process<N>,
    mean: &SVector<f64, N>,
    covariance: &SMatrix<f64, N, N>,
) -> (SVector<f64, N>, SMatrix<f64, N, N>) {
    let f = process.jacobian(mean);
    (process.predict(mean), symmetrised(f * covariance * f.transpose() + process.noise(mean)))
}

/// Smoothed trajectory under the models linearised along another: extended Kalman filter, then smoother.
fn linearised<const N: usize, const M: usize, Motion: Process<N>, Model: Measurement<N, M>>(
    prior: &Gaussian<N>,
    instants: &[Instant<Motion, Model, M>],
    along: &[SVector<f64, N>],
) -> Result<Vec<Gaussian<N>>, UpdateError> {
    let mut steps: Vec<Step<N>> = Vec::with_capacity(instants.len());
    for (k, (Instant { process, measurement, reading }, x)) in instants.iter().zip(along).enumerate() {
        let (last, at) = match k.checked_sub(1) {
            None => (*prior, prior.mean),
            Some(before) => (steps[before].filtered, along[before]),
        };
        let f = process.jacobian(&at);
        let mean = process.predict(&at) + f * (last.mean - at);
        let covariance = symmetrised(f * last.covariance * f.transpose() + process.noise(&at));
        let predicted = Gaussian::new(mean, covariance);

        let h = measurement.jacobian(x).ok_or(UpdateError::NoPrediction)?;
        let expected = measurement.predict(x).ok_or(UpdateError::NoPrediction)?;
        let residual = measurement.residual(reading, &expected) - h * (mean - x);
        let r = measurement.noise(x);
        let cross = h * covariance;
        let factor = symmetrised(cross * h.transpose() + r).cholesky().ok_or(UpdateError::NotPositiveDefinite)?;
        let gain = factor.solve(&cross).transpose();
        let keep = SMatrix::<f64, N, N>::identity() - gain * h;
        let posterior = symmetrised(keep * covariance * keep.transpose() + gain * r * gain.transpose());
        steps.push(Step { jacobian: f, predicted, filtered: Gaussian::new(mean + gain * residual, posterior) });
    }
    Ok(smooth(&steps))
}
