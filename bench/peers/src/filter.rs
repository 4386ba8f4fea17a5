//! What a filter answers.

use std::hint::black_box;
use std::time::Duration;

use nalgebra::{Matrix2, Vector2};
use rustix::time::{ClockId, clock_gettime};
use serde::Serialize;

use crate::problem::Problem;

/// The least time that a filter runs for, all its passes over the problem together.
const LEAST: Duration = Duration::from_millis(300);

/// What a filter believes after a reading.
#[derive(Clone, Copy, Serialize)]
pub(crate) struct Estimate {
    mean_m: Vector2<f64>,
    /// Written column by column.
    covariance_m2: Matrix2<f64>,
}

impl Estimate {
    pub(crate) fn of(mean_m: &Vector2<f64>, covariance_m2: &Matrix2<f64>) -> Self {
        Self { mean_m: *mean_m, covariance_m2: *covariance_m2 }
    }
}

/// One after each reading.
pub(crate) type Estimates = Vec<Estimate>;

/// A filter's estimates and its speed.
#[derive(Serialize)]
pub(crate) struct Answer {
    maker: &'static str,
    filter: &'static str,
    /// Time of one step: prediction, reading, and mean and covariance.
    step_s: f64,
    /// The estimates of each seed.
    estimates: Vec<Estimates>,
}

/// Runs a filter once a seed for its estimates, and then as often as it takes to time it.
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

/// Time that the processor has spent on this thread: other programs on the machine are not in it.
fn processor_time() -> Duration {
    let now = clock_gettime(ClockId::ThreadCPUTime);
    Duration::new(now.tv_sec as u64, now.tv_nsec as u32)
}
