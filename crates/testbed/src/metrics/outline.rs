//! Distance of the estimated surface points from the object's true outline, unaligned.

use super::{Metric, START_UP_S, Scored, Summary};
use crate::statistics::quantile;

/// Median distance.
pub const MEDIAN: Metric = Metric {
    name: "outline_median_m",
    about: "median distance of the estimated surface points to the true outline, after two seconds of contact",
    summary: Summary::Median,
    measure: |scored| quantile(&distances_m(scored), 0.5),
};

/// 95th percentile of the distance.
pub const P95: Metric = Metric {
    name: "outline_p95_m",
    about: "95th percentile of that distance",
    summary: Summary::Median,
    measure: |scored| quantile(&distances_m(scored), 0.95),
};

fn distances_m(scored: &Scored<'_>) -> Vec<f64> {
    let trial = scored.trial;
    let Some(outline) = trial.outline.filter(|_| !scored.is_silent()) else { return Vec::new() };
    let instants = &trial.trace.recording.instants;
    instants
        .iter()
        .zip(trial.readings_n_m)
        .zip(scored.estimates)
        .filter(|((known, _), _)| known.t_s >= scored.touch_s + START_UP_S)
        .filter_map(|((known, &reading), estimate)| {
            let surface = trial.knowledge.surface(estimate.as_ref()?, reading);
            Some(outline.distance_m(known.base.apply(surface)))
        })
        .collect()
}
