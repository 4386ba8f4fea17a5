//! Certainty on scenes that no setting was chosen on: the random suite, and pins with a calibration that is off.

use testbed::metrics::{Metric, bound, consistency, contour, error};
use testbed::results::TrialRow;
use testbed::statistics::{mean, median_of_scores, quantile};

use super::sets::{
    Set, allows, coverage_of, doubt_false_per_min, doubt_found, expected_above, nis_of_missed, overconfident, sets_of,
    share, sidecar,
};
use super::{Claim, Context, RECOMMENDED};

/// Run of the random suite.
const RANDOM: &str = "random";

/// Run of the standard suite's pins with miscalibrations.
const MISCALIBRATED: &str = "miscalibrated";

/// Runs that the claims of this file are measured on.
pub(super) const RUNS: &[&str] = &[RANDOM, MISCALIBRATED];

/// Shapes with corners; a plate is met at its edge.
const POLYGONS: [&str; 4] = ["rectangle", "regular_polygon", "convex_polygon", "plate"];

/// Steady error above which a trial counts as failed.
const FAILED_M: f64 = 0.5e-3;

/// Largest radius of a small circle.
const SMALL_RADIUS_M: f64 = 6e-3;

/// Mean distance of an accurate outline.
const OUTLINE_M: f64 = 0.05e-3;

/// Larger than any error, and number of halvings of an interval of errors.
const LONGEST_M: f64 = 1.0;
const HALVINGS: usize = 40;

/// Method that fits one convex outline to all readings of a touch.
const FITTED: &str = "outline-batch";

pub(super) fn claims() -> Vec<Claim> {
    let parts = [coverage(), errors(), outlines(), small_circles(), lift_offs(), doubts().into(), miscalibrations()];
    parts.into_iter().flatten().collect()
}

/// The sets of the random suite.
fn sets(context: &Context) -> Vec<Set<'_>> {
    sets_of(&context.run(RANDOM).trials)
}

fn is_polygon(set: &Set<'_>) -> bool {
    POLYGONS.contains(&set.object())
}

fn about(what: &str) -> String {
    format!("random suite, {RECOMMENDED}: {what}")
}

fn coverage() -> Vec<Claim> {
    let all = |context: &Context| Ok(coverage_of(&sets(context)));
    let ellipses = about("stated 95 % ellipses that hold the truth, mean over sets");
    vec![
        Claim::at_least("random_coverage_low".into(), ellipses.clone(), 88.0, "%", all),
        Claim::at_most("random_coverage_high".into(), ellipses, 99.0, "%", all),
        Claim::at_most(
            "random_overconfident".into(),
            about("sets in which fewer than 80 % of the ellipses hold the truth"),
            3.0,
            "%",
            |context| Ok(overconfident(&sets(context))),
        ),
        Claim::at_least(
            "random_answered".into(),
            about("instants of contact in the calibrated domain with an estimate, mean over sets"),
            90.0,
            "%",
            |context| {
                Ok(mean(sets(context).iter().filter_map(|set| set.mean(&error::ANSWERED))).map(|share| 100.0 * share))
            },
        ),
    ]
}

/// Trials of the smooth objects, or of the polygons, without those whose steady contact lies nowhere in the calibrated domain,
/// in which no estimate is expected.
fn trials(context: &Context, polygons: bool) -> Vec<&TrialRow> {
    let is_scorable = |trial: &&TrialRow| trial.get(&error::RMSE).is_some() || trial.head.missing > 0;
    let of_kind = sets(context).into_iter().filter(|set| is_polygon(set) == polygons);
    of_kind.flat_map(|set| set.trials).filter(is_scorable).collect()
}

/// Trials whose bound with unknown size and deviations does not exceed the largest error.
fn possible(context: &Context, polygons: bool) -> impl Iterator<Item = &TrialRow> {
    trials(context, polygons).into_iter().filter(|trial| is_possible(trial))
}

fn is_possible(trial: &TrialRow) -> bool {
    allows(trial, &bound::UNSIZED_RMSE, FAILED_M)
}

/// Expected share (%) of the trials whose error exceeds `error_m`, for an estimator at the bound with unknown size and deviations.
fn expected_failures(context: &Context, polygons: bool, error_m: f64) -> Option<f64> {
    expected_above(trials(context, polygons).into_iter(), &bound::UNSIZED_RMSE, error_m)
}

/// The error that this estimator is expected to exceed in `share` (%) of the trials.
fn expected_quantile_m(context: &Context, polygons: bool, share: f64) -> Option<f64> {
    let (mut low_m, mut high_m) = (0.0, LONGEST_M);
    for _ in 0..HALVINGS {
        let middle_m = 0.5 * (low_m + high_m);
        let is_exceeded = expected_failures(context, polygons, middle_m)? > share;
        *(if is_exceeded { &mut low_m } else { &mut high_m }) = middle_m;
    }
    Some(high_m)
}

/// Whether the calibration of a trial is exact.
fn is_exact(trial: &TrialRow) -> anyhow::Result<bool> {
    Ok(sidecar(RANDOM, trial)?.replay.is_none_or(|effects| effects.miscalibration.is_none()))
}

/// Whether the steady error of a trial is too large, or too many of its estimates are missing.
fn has_failed(trial: &TrialRow) -> bool {
    trial.get(&error::RMSE).is_none_or(|error_m| error_m > FAILED_M)
}

/// Limits of any estimator: ids, the metric of the bound, and the prior information of the estimator.
const LIMITS: [(&str, Metric, &str); 3] = [
    ("bound", bound::RMSE, "with known shape and calibration"),
    ("deviating_bound", bound::DEVIATING_RMSE, "with known shape and unknown deviations"),
    ("unsized_bound", bound::UNSIZED_RMSE, "with unknown size and deviations"),
];

/// Claims on the errors of smooth objects or of polygons, of which at most `most_failed` % may fail.
fn errors_of(kind: &'static str, objects: &'static str, polygons: bool, most_failed: f64) -> Vec<Claim> {
    let failed = format!("{objects}: trials with a steady RMSE above 0.5 mm");
    let mut claims = vec![
        Claim::at_most(format!("random_{kind}_failed"), about(&failed), most_failed, "%", move |context| {
            Ok(share(trials(context, polygons), |trial| has_failed(trial)))
        }),
        Claim::at_most(
            format!("random_{kind}_avoidable"),
            about(&format!("{failed}, of those whose bound with unknown size and deviations does not exceed it")),
            most_failed,
            "%",
            move |context| Ok(share(possible(context, polygons), |trial| has_failed(trial))),
        ),
        Claim::at_least(
            format!("random_{kind}_expected"),
            format!(
                "random suite, {objects}: trials in which the RMSE of an estimator at the bound with unknown size and deviations exceeds 0.5 mm"
            ),
            most_failed,
            "%",
            move |context| Ok(expected_failures(context, polygons, FAILED_M)),
        ),
        Claim::at_most(
            format!("random_{kind}_unanswered"),
            about(&format!("{objects}: trials in which more than a tenth of the steady contact has no estimate")),
            most_failed,
            "%",
            move |context| Ok(share(trials(context, polygons), |trial| trial.get(&error::RMSE).is_none())),
        ),
        Claim::at_most(
            format!("random_{kind}_exact_failed"),
            about(&format!(
                "{failed}, of those with an exact calibration, an estimate, and a bound that does not exceed it"
            )),
            most_failed,
            "%",
            move |context| {
                let mut exact = Vec::new();
                for trial in possible(context, polygons).filter(|trial| trial.get(&error::RMSE).is_some()) {
                    exact.extend(is_exact(trial)?.then_some(trial));
                }
                Ok(share(exact, |trial| has_failed(trial)))
            },
        ),
    ];
    claims.extend(LIMITS.map(|(id, metric, known)| {
        let text = format!("random suite, {objects}: trials whose Cramér–Rao bound, {known}, exceeds 0.5 mm");
        Claim::at_least(format!("random_{kind}_{id}"), text, most_failed, "%", move |context| {
            let bounds = trials(context, polygons).into_iter().filter_map(|trial| trial.get(&metric));
            Ok(share(bounds, |bound_m| *bound_m > FAILED_M))
        })
    }));
    claims
}

fn errors() -> Vec<Claim> {
    let mut claims = errors_of("smooth", "smooth objects", false, 3.0);
    claims.extend(errors_of("polygon", "polygons", true, 6.0));
    claims.push(Claim::at_most(
        "random_smooth_p90".into(),
        about("smooth objects: 90th percentile over trials of the steady RMSE"),
        0.25,
        "mm",
        |context| {
            let errors: Vec<f64> = trials(context, false)
                .into_iter()
                .map(|trial| trial.get(&error::RMSE).unwrap_or(f64::INFINITY))
                .collect();
            Ok(quantile(&errors, 0.9).filter(|error_m| error_m.is_finite()).map(|error_m| 1e3 * error_m))
        },
    ));
    claims.push(Claim::at_least(
        "random_smooth_expected_p90".into(),
        "random suite, smooth objects: 90th percentile of the RMSE of an estimator at the bound with unknown size and deviations".into(),
        0.25,
        "mm",
        |context| Ok(expected_quantile_m(context, false, 10.0).map(|error_m| 1e3 * error_m)),
    ));
    claims.push(Claim::at_least(
        "random_outline_explains".into(),
        format!(
            "random suite, {FITTED}: failed trials with an exact calibration and a bound of at most 0.5 mm whose outline explains the \
             readings at least as well as the true one"
        ),
        50.0,
        "%",
        explained,
    ));
    claims
}

/// Of the trials with an exact calibration and a bound that does not exceed the largest error in which [`FITTED`] fails, those
/// whose outline explains the readings at least as well as the true one (%). In the others, the search may have missed it.
fn explained(context: &Context) -> anyhow::Result<Option<f64>> {
    let fitted = context.run(RANDOM).trials.iter().filter(|trial| trial.head.estimator == FITTED);
    let mut failed = Vec::new();
    for trial in fitted.filter(|trial| is_possible(trial) && has_failed(trial)) {
        failed.extend(is_exact(trial)?.then(|| trial.get(&consistency::RESIDUAL_RATIO)).flatten());
    }
    Ok(share(failed, |ratio| *ratio <= 1.0))
}

fn outlines() -> Vec<Claim> {
    let band = |context: &Context| {
        let of_sets = sets(context);
        Ok(mean(of_sets.iter().filter_map(|set| set.mean(&contour::BAND_COVERAGE))).map(|share| 100.0 * share))
    };
    let held = about("outline: true points in the stated 95 % band, mean over sets");
    vec![
        Claim::at_least(
            "random_outline".into(),
            about("sets with an outline in every trial that is off by at most 0.05 mm in the mean"),
            90.0,
            "%",
            |context| {
                let is_complete = |set: &Set<'_>| set.trials.iter().all(|trial| trial.get(&contour::MEAN).is_some());
                let is_near = |set: &Set<'_>| set.mean(&contour::MEAN).is_some_and(|mean_m| mean_m <= OUTLINE_M);
                let is_accurate = |set: &Set<'_>| is_complete(set) && is_near(set);
                Ok(share(sets(context), is_accurate))
            },
        ),
        Claim::at_least("random_band_low".into(), held.clone(), 88.0, "%", band),
        Claim::at_most("random_band_high".into(), held, 99.0, "%", band),
    ]
}

/// Sets of circles of at most 6 mm.
fn small(context: &Context) -> anyhow::Result<Vec<Set<'_>>> {
    let mut found = Vec::new();
    for set in sets(context).into_iter().filter(|set| set.object() == "circle") {
        let radius_m = set.sidecar(RANDOM)?.scene["object"]["radius_m"].as_f64();
        if radius_m.is_some_and(|radius_m| radius_m <= SMALL_RADIUS_M) {
            found.push(set);
        }
    }
    Ok(found)
}

fn small_circles() -> Vec<Claim> {
    vec![
        Claim::at_most(
            "random_small_circle_rmse".into(),
            about("circles of 1 to 6 mm: steady RMSE, median over trials"),
            0.2,
            "mm",
            |context| {
                let trials = small(context)?.into_iter().flat_map(|set| set.trials);
                Ok(median_of_scores(trials.map(|trial| trial.get(&error::RMSE))).map(|error_m| 1e3 * error_m))
            },
        ),
        Claim::at_least(
            "random_small_circle_coverage".into(),
            about("circles of 1 to 6 mm: stated 95 % ellipses that hold the truth"),
            88.0,
            "%",
            |context| Ok(coverage_of(&small(context)?)),
        ),
    ]
}

fn lift_offs() -> Vec<Claim> {
    vec![Claim::at_most(
        "random_later_touches".into(),
        about("lift-offs: contact error after the first touch over that of the first touch, median over trials"),
        1.2,
        "times",
        |context| {
            let mut ratios = Vec::new();
            for set in sets(context) {
                if set.sidecar(RANDOM)?.scene["motion"]["kind"] != "lift_offs" {
                    continue;
                }
                let ratio = |trial: &&TrialRow| {
                    let first_m = trial.get(&contour::FIRST_TOUCH_RMSE)?;
                    Some(trial.get(&contour::LATER_TOUCHES_RMSE).map(|later_m| later_m / first_m))
                };
                ratios.extend(set.trials.iter().filter_map(ratio));
            }
            Ok(median_of_scores(ratios.into_iter()))
        },
    )]
}

fn doubts() -> [Claim; 3] {
    [
        Claim::at_least(
            "random_doubt_found".into(),
            about("trials of sets with a coverage below 60 % whose models are in doubt within 2 s"),
            90.0,
            "%",
            |context| Ok(doubt_found(&sets(context))),
        ),
        Claim::at_most(
            "random_doubt_nis".into(),
            about(
                "mean normalised innovation squared of the sets with a coverage below 60 %, over that of those with at least 80 %",
            ),
            1.0,
            "times",
            |context| Ok(nis_of_missed(&sets(context))),
        ),
        Claim::at_most(
            "random_doubt_false".into(),
            about("signals of doubt per minute of contact, in sets with a coverage of at least 80 %"),
            0.02,
            "per minute",
            |context| Ok(doubt_false_per_min(&sets(context))),
        ),
    ]
}

/// Miscalibrations of the pins: ids, labels in the groups' names, and descriptions.
const MISCALIBRATIONS: [(&str, &str, &str); 5] = [
    ("gain_1", "gain 1e-2", "gain of the sensor off by 1 %"),
    ("gain_5", "gain 5e-2", "gain of the sensor off by 5 %"),
    ("mount_angle", "mount rad 8.7e-3", "mount turned by 0.5 degrees"),
    ("mount_place", "mount y m 3e-4", "mount displaced sideways by 0.3 mm"),
    ("stiffness_5", "stiffness 5e-2", "Young's modulus off by 5 %"),
];

fn miscalibrations() -> Vec<Claim> {
    let of_case = |(id, label, what): (&'static str, &'static str, &'static str)| {
        let rows = move |context: &Context| -> Vec<TrialRow> {
            let group = format!("pin, {label}");
            context.run(MISCALIBRATED).trials_in(RECOMMENDED, |of| of == group).cloned().collect()
        };
        let about = format!("pins of the standard suite, {what}, {RECOMMENDED}");
        [
            Claim::at_least(
                format!("miscalibrated_{id}_coverage"),
                format!("{about}: stated 95 % ellipses that hold the truth"),
                85.0,
                "%",
                move |context| {
                    let coverages =
                        rows(context).into_iter().map(|trial| trial.get(&consistency::COVERAGE).unwrap_or_default());
                    Ok(mean(coverages).map(|coverage| 100.0 * coverage))
                },
            ),
            Claim::at_most(
                format!("miscalibrated_{id}_stated"),
                format!("{about}: stated RMS error over the true one, median over trials"),
                2.0,
                "times",
                move |context| {
                    let ratio =
                        |trial: TrialRow| Some(trial.get(&consistency::STATED_RMSE)? / trial.get(&error::RMSE)?);
                    Ok(median_of_scores(rows(context).into_iter().map(ratio)))
                },
            ),
        ]
    };
    MISCALIBRATIONS.into_iter().flat_map(of_case).collect()
}
