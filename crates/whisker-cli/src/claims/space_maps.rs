//! Surfaces of the maps in space.

use testbed::space::rows::SpatialMapRow;
use testbed::statistics::mean;

use super::{Claim, Context, RECOMMENDED, space, space_random};

/// Estimators that a run of claims in space evaluates for its maps: `recommended`, and the same in hindsight.
const ESTIMATORS: [&str; 2] = [RECOMMENDED, "batch-recommended"];

/// Runs, in words.
const RUNS: [(&str, &str); 2] = [(space::RUN, "suite spatial"), (space_random::RUN, "random scenes in space")];

/// Kinds of solids: short name, words, and shapes.
const KINDS: [(&str, &str, &[&str]); 3] = [
    ("smooth", "spheres, cylinders, cones and tori", &["sphere", "cylinder", "cone", "torus"]),
    ("boxes", "boxes", &["box"]),
    ("rods", "pins and rods", &["pin"]),
];

pub(super) fn claims() -> Vec<Claim> {
    let of_run =
        |run| KINDS.into_iter().flat_map(move |kind| ESTIMATORS.map(|estimator| of_maps(run, kind, estimator)));
    RUNS.into_iter().flat_map(of_run).flatten().collect()
}

/// Claims about the maps of one run, of one kind of solids by one estimator.
fn of_maps(
    (run, run_in_words): (&'static str, &str),
    (kind, kind_in_words, shapes): (&str, &str, &'static [&'static str]),
    estimator: &'static str,
) -> [Claim; 2] {
    let about = |what: &str| format!("{run_in_words}, {estimator}: maps of {kind_in_words}: {what}");
    let mean_of = move |context: &Context, of: fn(&SpatialMapRow) -> Option<f64>| {
        mean(maps(context, run, shapes, estimator).filter_map(of))
    };
    [
        Claim::at_most(
            format!("{run}_map_{kind}_{estimator}_distance"),
            about(
                "mean distance from the true solid of the vertices with a standard deviation of at most 0.1 mm, mean over solids",
            ),
            0.05,
            "mm",
            move |context| Ok(mean_of(context, |map| map.surface_mean_m).map(|distance_m| 1e3 * distance_m)),
        ),
        Claim::at_least(
            format!("{run}_map_{kind}_{estimator}_coverage"),
            about("share of the vertices that lie within 1.96 standard deviations of the true solid, mean over solids"),
            88.0,
            "%",
            move |context| Ok(mean_of(context, |map| map.surface_coverage).map(|share| 100.0 * share)),
        ),
    ]
}

/// Maps of a run, of solids of some shapes by one estimator.
fn maps<'a>(
    context: &'a Context,
    run: &str,
    shapes: &'a [&str],
    estimator: &'a str,
) -> impl Iterator<Item = &'a SpatialMapRow> {
    let evaluation = context.spatial(run);
    let is_of_shapes = |solid: &serde_json::Value| {
        solid.get("shape").and_then(|shape| shape.as_str()).is_some_and(|shape| shapes.contains(&shape))
    };
    let solids = evaluation.run.solids();
    let traces: Vec<String> =
        solids.iter().filter(|swept| is_of_shapes(swept.solid)).map(|swept| swept.traces()).collect();
    evaluation.maps.iter().filter(move |map| map.estimator == estimator && traces.contains(&map.traces))
}
