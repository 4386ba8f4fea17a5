//! Sliding contacts: error of the stated radius, detection of a wrong model, and loss of accuracy on pins.

use testbed::consistency::NIS_TEST;
use testbed::metrics::{Metric, error, radius};

use super::{Claim, Evaluation, RECOMMENDED, WHISKERS, contours, in_words, monte_carlo};

/// A filter that assumes a thin object.
const STATIC: &str = "ukf";

pub(super) fn claims() -> Vec<Claim> {
    let circles = contours::CIRCLES.into_iter().flat_map(|group| WHISKERS.map(|whisker| (group, whisker)));
    let of_circles =
        circles.flat_map(|(group, whisker)| [sized, noticed].into_iter().flat_map(move |topic| topic(group, whisker)));
    of_circles.chain(WHISKERS.into_iter().flat_map(price)).collect()
}

/// A claim on the summary of one estimator on one circle. One unit of the metric is `per_unit` units of the claim.
fn value(run: &Evaluation, group: &str, whisker: &str, estimator: &str, metric: &Metric, per_unit: f64) -> Option<f64> {
    Some(per_unit * run.summary(group, whisker, estimator)?.get(metric)?)
}

/// Error and coverage of the stated radius.
fn sized(group: &'static str, whisker: &'static str) -> Vec<Claim> {
    let claim = format!("{}, {whisker} whisker, {RECOMMENDED}: radius at the end", in_words(group));
    vec![
        Claim::at_most(
            format!("motion_{group}_{whisker}_radius"),
            format!("{claim}, error, median over trials"),
            5.0,
            "%",
            move |context| Ok(value(context.run(contours::RUN), group, whisker, RECOMMENDED, &radius::ERROR, 100.0)),
        ),
        Claim::at_least(
            format!("motion_{group}_{whisker}_radius_covered"),
            format!("{claim}, trials whose 95 % interval holds the true radius"),
            90.0,
            "%",
            move |context| Ok(value(context.run(contours::RUN), group, whisker, RECOMMENDED, &radius::COVERED, 100.0)),
        ),
    ]
}

/// Innovations of a wrong model.
fn noticed(group: &'static str, whisker: &'static str) -> Vec<Claim> {
    vec![Claim::at_least(
        format!("motion_{group}_{whisker}_noticed"),
        format!(
            "{}, {whisker} whisker, {STATIC}: NIS over the upper end of its 95 % interval: the wrong model",
            in_words(group)
        ),
        1.1,
        "times",
        move |context| {
            let trials = context.run(contours::RUN).trials_of(group, whisker, STATIC);
            Ok(NIS_TEST.average(trials).map(|average| average.value / average.interval.1))
        },
    )]
}

/// Loss of accuracy on a pin from not knowing that the object is thin.
fn price(whisker: &'static str) -> Vec<Claim> {
    let times = |id: &str, score: &str, metric: Metric| {
        Claim::at_most(
            format!("motion_pin_{whisker}_{id}"),
            format!("100 trials on a pin, {whisker} whisker: {score} of {RECOMMENDED} over that of {STATIC}, medians"),
            1.1,
            "times",
            move |context| {
                let of = |estimator| {
                    value(context.run(monte_carlo::RUN), monte_carlo::GROUP, whisker, estimator, &metric, 1.0)
                };
                Ok(of(RECOMMENDED).zip(of(STATIC)).map(|(own, other)| own / other))
            },
        )
    };
    vec![times("rmse", "steady RMSE", error::RMSE), times("time_to_1mm", "time to stay below 1 mm", error::TIME_TO_1MM)]
}
