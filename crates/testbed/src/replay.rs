//! Replay: a recording through an estimator, in order of time, without looking ahead.

use std::time::Instant as Clock;

use trace::Recording;
use whisker::estimators::{Estimate, Estimator, Sample};
use whisker::frames::Pose;

/// The samples that a robot would have had: base motion from the recorded poses, readings from the front end.
pub fn samples(recording: &Recording, readings_n_m: &[f64]) -> Vec<Sample> {
    let mut last: Option<&trace::Instant> = None;
    recording
        .instants
        .iter()
        .zip(readings_n_m)
        .map(|(now, &reading_n_m)| {
            let (motion, dt_s) = match last {
                Some(before) => (before.base.then(&now.base.inverse()), now.t_s - before.t_s),
                None => (Pose::new(0.0, 0.0, 0.0), 0.0),
            };
            last = Some(now);
            Sample { motion, dt_s, reading_n_m }
        })
        .collect()
}

/// Estimates of a replay, and how long it took.
#[derive(Clone, Debug)]
pub struct Replay {
    /// One entry a sample; none while the estimator saw no contact.
    pub estimates: Vec<Option<Estimate>>,
    /// Wall-clock time of all steps.
    pub elapsed_ns: u128,
}

/// Runs an estimator over samples.
pub fn replay(estimator: &mut Estimator, samples: &[Sample]) -> Replay {
    let start = Clock::now();
    let estimates = samples.iter().map(|sample| estimator.step(sample)).collect();
    Replay { estimates, elapsed_ns: start.elapsed().as_nanos() }
}
