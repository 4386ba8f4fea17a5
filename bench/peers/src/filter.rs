//! Estimates and run time of a filter.

use std::hint::black_box;
use std::time::Duration;

use nalgebra::{Matrix2, Vector2};
use rustix::time::{ClockId, clock_gettime};
use serde::Serialize;

use crate::problem::Problem;

/// Least total processor time of the timed passes over the problem.
const LEAST: Duration = Duration::from_millis(300);

/// Posterior after a reading.
#[derive(Clone, Copy, Serialize)]
pub(crate) struct Estimate {
    mean_m: Vector2<f64>,
    /// Serialised column by column.
    covariance_m2: Matrix2<f64>,
}

impl Estimate {
    pub(crate) fn of(mean_m: &Vector2<f64>, covariance_m2: &Matrix2<f64>) -> Self {
        Self { mean_m: *mean_m, covariance_m2: *covariance_m2 }
    }
}

/// Estimates, one per reading.
pub(crate) type Estimates = Vec<Estimate>;

/// Estimates and run time of one filter.
#[derive(Serialize)]
pub(crate) struct Answer {
    maker: &'static str,
    filter: &'static str,
    /// Processor time of one step (prediction, update, mean and covariance), fastest pass.
    step_s: f64,
    /// Estimates for each seed.
    estimates: Vec<Estimates>,
}

/// Runs a filter once per seed for its estimates, then repeatedly to measure its run time.
pub(crate) fn timed(
    maker: &'static str,
    filter: &'static str,
    seeds: u64,
    problem: &Problem,
    run: impl Fn(u64) -> Estimates,
) -> Answer {
    let estimates = (0..seeds).map(&run).collect();
    let (mut passes, started) = (0, processor_time());
    let mut fastest = Duration::MAX;
    while processor_time() - started < LEAST {
        let begun = processor_time();
        black_box(run(passes));
        fastest = fastest.min(processor_time() - begun);
        passes += 1;
    }
    Answer { maker, filter, step_s: fastest.as_secs_f64() / problem.steps.len() as f64, estimates }
}

/// Processor time of the current thread, unaffected by other processes.
fn processor_time() -> Duration {
    let now = clock_gettime(ClockId::ThreadCPUTime);
    Duration::new(now.tv_sec as u64, now.tv_nsec as u32)
}
