//! Certainty in space on random scenes, which no setting was chosen on.

use std::collections::BTreeMap;

use testbed::metrics::MOST_MISSING;
use testbed::space::rows::SpatialTrialRow;
use testbed::statistics::{mean, median};

use super::sets::{Set, coverage_of, doubt_false_per_min, doubt_found, overconfident, sets_of, share};
use super::{Claim, Context, RECOMMENDED};

/// Run of the random suite in space.
pub(super) const RUN: &str = "random_space";

/// Solids without edges where they are touched.
const SMOOTH: [&str; 4] = ["pin", "sphere", "cylinder", "torus"];

/// Error above which a replay counts as failed.
const FAILED_M: f64 = 0.5e-3;

/// Angle of the normal above which a replay counts as failed.
const FAILED_NORMAL_RAD: f64 = 2.0_f64.to_radians();

/// A way in which a replay fails.
struct Failing {
    id: &'static str,
    what: &'static str,
    has_failed: fn(&SpatialTrialRow) -> bool,
}

const FAILING: [Failing; 2] = [
    Failing {
        id: "failed",
        what: "replays with an RMSE above 0.5 mm, or without an estimate at more than a tenth of the instants in the calibrated domain",
        has_failed: |trial| {
            let is_silent = trial.answered.is_some_and(|answered| 1.0 - answered > MOST_MISSING);
            is_silent || trial.rmse_m.is_none_or(|rmse_m| rmse_m > FAILED_M)
        },
    },
    Failing {
        id: "normal",
        what: "replays whose normal is off by more than 2 degrees (root mean square)",
        has_failed: |trial| trial.normal_rad.is_none_or(|angle_rad| angle_rad > FAILED_NORMAL_RAD),
    },
];

/// A kind of solids.
struct Kind {
    name: &'static str,
    what: &'static str,
    /// Solids for which the bound of an unknown object is defined.
    with_bound: &'static str,
    /// Largest share of failed replays, and smallest one of those whose bound exceeds the error of a failure (%).
    most: f64,
    is_smooth: bool,
}

const KINDS: [Kind; 2] = [
    Kind {
        name: "smooth",
        what: "rods, spheres, cylinders and tori",
        with_bound: "rods, spheres and cylinders",
        most: 3.0,
        is_smooth: true,
    },
    Kind { name: "edged", what: "boxes and cones", with_bound: "edges of boxes", most: 6.0, is_smooth: false },
];

pub(super) fn claims() -> Vec<Claim> {
    let covered = "stated 95 % ellipsoids that hold the true contact, mean over sets";
    let mut claims = vec![
        Claim::at_least("space_random_coverage_low".into(), about(covered), 88.0, "%", |context| {
            Ok(coverage_of(&sets(context)))
        }),
        Claim::at_most("space_random_coverage_high".into(), about(covered), 99.0, "%", |context| {
            Ok(coverage_of(&sets(context)))
        }),
        Claim::at_least(
            "space_random_early_coverage".into(),
            about("95 % ellipsoids of the first second of each touch that hold the true contact, mean over replays"),
            88.0,
            "%",
            |context| Ok(percent_of(context, |trial| trial.early_coverage)),
        ),
        Claim::at_most(
            "space_random_overconfident".into(),
            about("sets in which fewer than 80 % of the ellipsoids hold the true contact"),
            3.0,
            "%",
            |context| Ok(overconfident(&sets(context))),
        ),
        Claim::at_least(
            "space_random_answered".into(),
            about(
                "instants of contact in the calibrated domain after the first second with an estimate, mean over replays",
            ),
            90.0,
            "%",
            |context| Ok(percent_of(context, |trial| trial.answered)),
        ),
    ];
    claims.extend(KINDS.into_iter().flat_map(of_kind));
    claims.push(Claim::at_least(
        "space_random_radius_coverage".into(),
        about("spheres and cylinders: 95 % intervals of the last radius that contain the true one"),
        88.0,
        "%",
        |context| Ok(percent_of(context, |trial| trial.radius_coverage)),
    ));
    claims.push(Claim::at_least(
        "space_random_doubt_found".into(),
        about("replays of sets with a coverage below 60 % whose models are in doubt within 2 s"),
        90.0,
        "%",
        |context| Ok(doubt_found(&sets(context))),
    ));
    claims.push(Claim::at_most(
        "space_random_doubt_false".into(),
        about("replays in doubt per minute of contact, in sets with a coverage of at least 80 %"),
        0.02,
        "per minute",
        |context| Ok(doubt_false_per_min(&sets(context))),
    ));
    claims
}

/// Claims about the replays on one kind of solids.
fn of_kind(Kind { name, what: kind, with_bound, most, is_smooth }: Kind) -> Vec<Claim> {
    let mut claims = Vec::new();
    let is_of_kind = move |shape: &str| SMOOTH.contains(&shape) == is_smooth;
    claims.push(Claim::at_most(
        format!("space_random_{name}_median"),
        about(&format!("{kind}: RMSE of the contact, median over replays")),
        0.25,
        "mm",
        move |context| {
            Ok(median(replays(context, is_of_kind).filter_map(|trial| trial.rmse_m)).map(|error_m| 1e3 * error_m))
        },
    ));
    for Failing { id, what, has_failed } in FAILING {
        claims.push(Claim::at_most(
            format!("space_random_{name}_{id}"),
            about(&format!("{kind}: {what}")),
            most,
            "%",
            move |context| Ok(share(scorable(context, is_of_kind), |trial| has_failed(trial))),
        ));
    }
    let [Failing { what, has_failed, .. }, _] = FAILING;
    claims.push(Claim::at_most(
        format!("space_random_{name}_avoidable"),
        about(&format!("{with_bound}: {what}, of those whose bound of an unknown object does not exceed 0.5 mm")),
        most,
        "%",
        move |context| {
            let is_possible =
                |trial: &&SpatialTrialRow| trial.object_bound_m.is_some_and(|bound_m| bound_m <= FAILED_M);
            Ok(share(scorable(context, is_of_kind).filter(is_possible), |trial| has_failed(trial)))
        },
    ));
    claims.push(Claim::at_least(
        format!("space_random_{name}_bound"),
        format!("random scenes in space, {with_bound}: replays whose bound of an unknown object exceeds 0.5 mm"),
        most,
        "%",
        move |context| {
            let bounds = scorable(context, is_of_kind).filter_map(|trial| trial.object_bound_m);
            Ok(share(bounds, |bound_m| *bound_m > FAILED_M))
        },
    ));
    claims
}

fn about(what: &str) -> String {
    format!("random scenes in space, {RECOMMENDED}: {what}")
}

/// Replays of `recommended` on solids of some shapes.
fn replays(context: &Context, of: impl Fn(&str) -> bool) -> impl Iterator<Item = &SpatialTrialRow> {
    let evaluation = context.spatial(RUN);
    let shapes = evaluation
        .run
        .trials
        .iter()
        .filter_map(|trial| Some((trial.trace.as_str(), trial.solid.get("shape")?.as_str()?)));
    let shapes: BTreeMap<&str, &str> = shapes.collect();
    evaluation.trials.iter().filter(move |trial| {
        trial.estimator == RECOMMENDED && shapes.get(trial.trace.as_str()).is_some_and(|shape| of(shape))
    })
}

/// These replays without those whose contacts lie nowhere in the calibrated domain, in which no estimate is expected.
fn scorable(context: &Context, of: impl Fn(&str) -> bool) -> impl Iterator<Item = &SpatialTrialRow> {
    replays(context, of).filter(|trial| trial.answered.is_some())
}

/// The sets of the random suite in space.
fn sets(context: &Context) -> Vec<Set<'_, SpatialTrialRow>> {
    sets_of(&context.spatial(RUN).trials)
}

/// Mean (%) of a score over the replays.
fn percent_of(context: &Context, score: fn(&SpatialTrialRow) -> Option<f64>) -> Option<f64> {
    mean(replays(context, |_| true).filter_map(score)).map(|share| 100.0 * share)
}
