//! Contacts that slide: how well the estimators follow them round circles, what they say of the radius, and what it costs on pins.

use super::{Claim, Evaluation, RECOMMENDED, WHISKERS, monte_carlo};
use crate::consistency::{Average, NIS_FREEDOM};
use crate::metrics::{Metric, consistency, error, radius};
use crate::results::PAPER;

/// The circles.
const CIRCLES: [&str; 2] = ["circle_15", "circle_50"];

/// What looks back over the contact.
const HINDSIGHT: &str = "batch-recommended";

/// A filter that takes the object for thin.
const STATIC: &str = "ekf";

pub(super) fn claims() -> Vec<Claim> {
    let circles = CIRCLES.into_iter().flat_map(|group| WHISKERS.map(|whisker| (group, whisker)));
    let of_circles = circles.flat_map(|(group, whisker)| {
        [followed, sized, sure, against_static].into_iter().flat_map(move |topic| topic(group, whisker))
    });
    of_circles.chain(WHISKERS.into_iter().flat_map(price)).collect()
}

/// A claim about the summary of one estimator on one circle, in a unit that is `per_unit` of the metric's.
fn value(
    run: &Evaluation,
    (group, whisker): (&str, &str),
    estimator: &str,
    metric: &Metric,
    per_unit: f64,
) -> Option<f64> {
    Some(per_unit * run.summary(group, whisker, estimator)?.get(metric)?)
}

/// The contact itself.
fn followed(group: &'static str, whisker: &'static str) -> Vec<Claim> {
    // The concave side of the curved whisker all but embraces the large circle.
    let online_mm = if (group, whisker) == ("circle_50", "curved") { 0.4 } else { 0.3 };
    let of = |estimator: &'static str, bound_mm: f64| {
        Claim::at_most(
            format!("motion_{group}_{whisker}_{estimator}"),
            format!("{group}, {whisker} whisker, {estimator}: RMSE of the contact after 1 s, median over trials"),
            bound_mm,
            "mm",
            move |context| Ok(value(context.standard(), (group, whisker), estimator, &error::RMSE_AFTER_1S, 1e3)),
        )
    };
    vec![of(RECOMMENDED, online_mm), of(HINDSIGHT, 0.2)]
}

/// The radius.
fn sized(group: &'static str, whisker: &'static str) -> Vec<Claim> {
    let claim = format!("{group}, {whisker} whisker, {RECOMMENDED}: radius at the end");
    vec![
        Claim::at_most(
            format!("motion_{group}_{whisker}_radius"),
            format!("{claim}, error, median over trials"),
            5.0,
            "%",
            move |context| Ok(value(context.standard(), (group, whisker), RECOMMENDED, &radius::ERROR, 100.0)),
        ),
        Claim::at_least(
            format!("motion_{group}_{whisker}_radius_covered"),
            format!("{claim}, trials whose 95 % interval holds the true one"),
            90.0,
            "%",
            move |context| Ok(value(context.standard(), (group, whisker), RECOMMENDED, &radius::COVERED, 100.0)),
        ),
    ]
}

/// How sure the estimator is, and whether it is noticed that another model is wrong.
fn sure(group: &'static str, whisker: &'static str) -> Vec<Claim> {
    let claim = format!("{group}, {whisker} whisker, {RECOMMENDED}: stated 95 % ellipses that hold the truth");
    let covered = move |run: &Evaluation| value(run, (group, whisker), RECOMMENDED, &consistency::COVERAGE, 100.0);
    vec![
        Claim::at_least(format!("motion_{group}_{whisker}_coverage_low"), claim.clone(), 85.0, "%", move |context| {
            Ok(covered(context.standard()))
        }),
        Claim::at_most(format!("motion_{group}_{whisker}_coverage_high"), claim, 98.0, "%", move |context| {
            Ok(covered(context.standard()))
        }),
        Claim::at_least(
            format!("motion_{group}_{whisker}_noticed"),
            format!(
                "{group}, {whisker} whisker, {STATIC}: NIS over the upper end of its 95 % interval: the wrong model"
            ),
            1.1,
            "times",
            move |context| {
                let trials = context.standard().trials_of(group, whisker, STATIC);
                let of_trials: Vec<f64> = trials.filter_map(|trial| trial.get(&consistency::NIS)).collect();
                let average = Average::of_trials(NIS_FREEDOM, &of_trials);
                Ok(average.map(|average| average.value / average.interval.1))
            },
        ),
    ]
}

/// How much better than contacts taken to rest.
fn against_static(group: &'static str, whisker: &'static str) -> Vec<Claim> {
    let times = move |run: &Evaluation, is_static: fn(&str) -> bool| {
        let own_m = value(run, (group, whisker), RECOMMENDED, &error::RMSE_AFTER_1S, 1.0)?;
        let others = run.run.estimators.iter().map(|row| row.name.as_str()).filter(|name| is_static(name));
        Some(run.best(group, whisker, others, &error::RMSE_AFTER_1S)? / own_m)
    };
    let claim = format!("{group}, {whisker} whisker: RMSE of the contact after 1 s of the best");
    vec![
        Claim::at_least(
            format!("motion_{group}_{whisker}_over_published"),
            format!("{claim} published filter (static, fading 1.004) over that of {RECOMMENDED}"),
            5.0,
            "times",
            move |context| Ok(times(context.standard(), |name| name.starts_with(PAPER))),
        ),
        Claim::at_least(
            format!("motion_{group}_{whisker}_over_static"),
            format!("{claim} filter that takes the object for thin over that of {RECOMMENDED}"),
            3.0,
            "times",
            move |context| {
                Ok(times(context.standard(), |name| {
                    name.starts_with(PAPER) || [STATIC, "iekf", "ukf", "particle"].contains(&name)
                }))
            },
        ),
    ]
}

/// What it costs on a pin not to know that it is one.
fn price(whisker: &'static str) -> Vec<Claim> {
    let times = |id: &str, score: &str, metric: Metric| {
        Claim::at_most(
            format!("motion_pin_{whisker}_{id}"),
            format!("100 trials on a pin, {whisker} whisker: {score} of {RECOMMENDED} over that of {STATIC}, medians"),
            1.1,
            "times",
            move |context| {
                let of = |estimator| {
                    value(context.run(monte_carlo::RUN), (monte_carlo::GROUP, whisker), estimator, &metric, 1.0)
                };
                Ok(of(RECOMMENDED).zip(of(STATIC)).map(|(own, other)| own / other))
            },
        )
    };
    vec![times("rmse", "steady RMSE", error::RMSE), times("time_to_1mm", "time to stay below 1 mm", error::TIME_TO_1MM)]
}
