//! Filters of the crate `smelly`, used as in its documentation.

use nalgebra::{Const, Dyn, Matrix1, Matrix2, OMatrix, Vector1, Vector2};
use rand::{RngExt, SeedableRng};
use rand_distr::StandardNormal;
use rand_pcg::Pcg64;
use smelly::{FilterError, MerweScaledSigmaPoints, ParticleFilter, SExtendedKalmanFilter, SUnscentedKalmanFilter};

use crate::filter::{Estimate, Estimates};
use crate::problem::Problem;

pub(crate) fn extended(problem: &Problem) -> Estimates {
    run_extended(problem).expect("a problem without singular matrices")
}

pub(crate) fn unscented(problem: &Problem) -> Estimates {
    run_unscented(problem).expect("a problem without singular matrices")
}

pub(crate) fn particle(problem: &Problem, seed: u64) -> Estimates {
    run_particle(problem, seed).expect("particles of positive weight")
}

fn run_extended(problem: &Problem) -> Result<Estimates, FilterError> {
    let start = problem.start();
    let mut filter = SExtendedKalmanFilter::<f64, 2, 1>::new();
    filter.set_state(start.mean)?;
    filter.set_covariance(start.covariance)?;
    filter.set_process_noise(Matrix2::identity() * problem.wander_m2)?;
    filter.set_measurement_noise(Matrix1::new(problem.variance_n2_m2))?;
    let steps = problem.steps.iter().map(|step| {
        // The filter's process is linear; the translation is added to the state.
        filter.set_transition(step.turn)?;
        filter.predict()?;
        filter.set_state(filter.state() + step.shift_m)?;
        let z = Vector1::new(step.reading_n_m);
        filter.update(&z, |x| Vector1::new(problem.reading_n_m(x)), |x| problem.gradient_n(x))?;
        Ok(Estimate::of(filter.state(), filter.covariance()))
    });
    steps.collect()
}

fn run_unscented(problem: &Problem) -> Result<Estimates, FilterError> {
    let start = problem.start();
    let points = MerweScaledSigmaPoints::new(problem.alpha, problem.beta, problem.kappa);
    let mut filter = SUnscentedKalmanFilter::<f64, 2, 1>::new(points);
    filter.set_state(start.mean)?;
    filter.set_covariance(start.covariance)?;
    filter.set_process_noise(Matrix2::identity() * problem.wander_m2)?;
    filter.set_measurement_noise(Matrix1::new(problem.variance_n2_m2))?;
    let steps = problem.steps.iter().map(|step| {
        filter.predict(|x| step.moved(x))?;
        filter.update(&Vector1::new(step.reading_n_m), |x| Vector1::new(problem.reading_n_m(x)))?;
        Ok(Estimate::of(filter.state(), filter.covariance()))
    });
    steps.collect()
}

fn run_particle(problem: &Problem, seed: u64) -> Result<Estimates, FilterError> {
    let mut rng = Pcg64::seed_from_u64(seed);
    let (start_sd_m, wander_m) = (problem.start_m2.sqrt(), problem.wander_m2.sqrt());
    let particles = OMatrix::<f64, Const<2>, Dyn>::from_fn(problem.particles, |number, _| {
        problem.start_m[number] + start_sd_m * rng.sample::<f64, _>(StandardNormal)
    });
    let mut filter = ParticleFilter::new(particles)?;
    let fewest = problem.resample_share * problem.particles as f64;
    let steps = problem.steps.iter().map(|step| {
        filter.predict(|before, after| {
            let moved = step.moved(&Vector2::new(before[0], before[1]));
            after[0] = moved.x + wander_m * rng.sample::<f64, _>(StandardNormal);
            after[1] = moved.y + wander_m * rng.sample::<f64, _>(StandardNormal);
        })?;
        filter.update_log_likelihood(|x| {
            let residual_n_m = step.reading_n_m - problem.reading_n_m(&Vector2::new(x[0], x[1]));
            -0.5 * residual_n_m * residual_n_m / problem.variance_n2_m2
        })?;
        let estimate = Estimate::of(&filter.state(), &filter.covariance());
        if filter.effective_sample_size() < fewest {
            filter.resample(rng.random())?;
        }
        Ok(estimate)
    });
    steps.collect()
}
