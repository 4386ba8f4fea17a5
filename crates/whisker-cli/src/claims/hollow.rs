//! Objects that are not convex, and objects that move: outlines, second contacts, accuracy and its bounds, and doubt.

use testbed::metrics::{bound, consistency, contour, doubt, error, second};
use testbed::results::TrialRow;

use super::sets::expected_above;
use super::{Claim, Context, RECOMMENDED, WHISKERS, in_words, percent};

/// Run of the suite of objects that are not convex or move.
pub(super) const RUN: &str = "hollow";

/// Objects that are not convex.
pub(super) const HOLLOW: [&str; 5] = ["l", "star", "cup", "discs", "step"];

/// Objects that move, with their speeds in mm/s.
const MOVING: [(&str, &str); 6] = [
    ("pin_0p2", "pin at 0.2 mm/s"),
    ("pin_0p5", "pin at 0.5 mm/s"),
    ("pin_2p0", "pin at 2 mm/s"),
    ("circle_0p2", "circle at 0.2 mm/s"),
    ("circle_0p5", "circle at 0.5 mm/s"),
    ("circle_2p0", "circle at 2 mm/s"),
];

/// Largest error of an accurate contact on a moving object, and time within which the other trials must be in doubt.
pub(super) const ACCURATE_M: f64 = 0.3e-3;
const DOUBT_WITHIN_S: f64 = 0.5;

pub(super) fn claims() -> Vec<Claim> {
    let outlines = HOLLOW.into_iter().flat_map(|object| WHISKERS.map(|whisker| outlines(object, whisker))).flatten();
    let moving = MOVING.into_iter().flat_map(|object| WHISKERS.map(|whisker| accurate_or_in_doubt(object, whisker)));
    let expected =
        MOVING.into_iter().flat_map(|object| WHISKERS.map(|whisker| expected_to_be_accurate(object, whisker)));
    let covered = |context: &Context| Ok(percent(of_hollow(context), &consistency::COVERAGE));
    let ellipses = about("objects that are not convex: stated 95 % ellipses that hold the truth, mean over trials");
    let others = [
        Claim::at_least("hollow_coverage_low".into(), ellipses.clone(), 88.0, "%", covered),
        Claim::at_most("hollow_coverage_high".into(), ellipses, 99.0, "%", covered),
        Claim::at_least(
            "hollow_second_recall".into(),
            about("second contacts that are signalled within 0.2 s, mean over trials"),
            95.0,
            "%",
            |context| Ok(percent(of_hollow(context), &second::RECALL)),
        ),
        Claim::at_least(
            "hollow_second_ideal_recall".into(),
            format!(
                "suite {RUN}: second contacts that an ideal test detects within 0.2 s, at a precision of about 95 %"
            ),
            95.0,
            "%",
            |context| Ok(percent(of_hollow(context), &second::IDEAL_RECALL)),
        ),
        Claim::at_least(
            "hollow_second_precision".into(),
            about("signals raised during a second contact or within 0.2 s after it, mean over trials with signals"),
            95.0,
            "%",
            |context| Ok(percent(of_hollow(context), &second::PRECISION)),
        ),
    ];
    outlines.chain(moving).chain(expected).chain(others).collect()
}

fn about(what: &str) -> String {
    format!("suite {RUN}, {RECOMMENDED}: {what}")
}

/// Outline of an object that is not convex: its distance from what was touched, and its depth in what the whisker has swept.
fn outlines(object: &'static str, whisker: &'static str) -> [Claim; 2] {
    let parts = [
        ("outline", "mean distance of the touched places from the outline", 0.2, contour::TOUCHED_MEAN),
        (
            "free_space",
            "largest depth of the outline in the space that the whisker has swept",
            0.3,
            contour::IN_FREE_SPACE,
        ),
    ];
    parts.map(|(id, what, most_mm, metric)| {
        Claim::at_most(
            format!("hollow_{id}_{object}_{whisker}"),
            about(&format!("{}, {whisker} whisker: {what}, median over trials", in_words(object))),
            most_mm,
            "mm",
            move |context| {
                let summary = context.run(RUN).summary(&format!("hollow_{object}"), whisker, RECOMMENDED);
                Ok(summary.and_then(|row| row.get(&metric)).map(|found_m| 1e3 * found_m))
            },
        )
    })
}

/// Whether the steady RMSE of a trial on a moving object is at most [`ACCURATE_M`], or `model_doubtful` is raised within
/// [`DOUBT_WITHIN_S`].
pub(super) fn is_accurate_or_in_doubt(trial: &TrialRow) -> bool {
    trial.get(&error::RMSE).is_some_and(|rmse_m| rmse_m <= ACCURATE_M)
        || trial.get(&doubt::DOUBT_TIME).is_some_and(|time_s| time_s <= DOUBT_WITHIN_S)
}

/// Share of the trials on a moving object whose contacts are accurate or whose models are in doubt in time.
fn accurate_or_in_doubt((object, words): (&'static str, &'static str), whisker: &'static str) -> Claim {
    Claim::at_least(
        format!("moving_{object}_{whisker}"),
        about(&format!(
            "{words}, {whisker} whisker: trials with a steady RMSE of at most 0.3 mm, or in doubt within 0.5 s"
        )),
        90.0,
        "%",
        move |context| {
            let group = format!("moving_{object}");
            let share = context.run(RUN).share(&group, whisker, RECOMMENDED, is_accurate_or_in_doubt);
            Ok(share.map(|share| 100.0 * share))
        },
    )
}

/// Expected share (%) of accurate trials, not counting those in doubt, if the error of each trial is normally distributed with the
/// bound of a moving object as its standard deviation.
pub(super) fn expected_accurate<'a>(trials: impl Iterator<Item = &'a TrialRow>) -> Option<f64> {
    expected_above(trials, &bound::MOVING_RMSE, ACCURATE_M).map(|share| 100.0 - share)
}

/// The expected share of accurate trials on a moving object, which depends on scenes and noise, not on the estimator.
fn expected_to_be_accurate((object, words): (&'static str, &'static str), whisker: &'static str) -> Claim {
    Claim::at_least(
        format!("moving_{object}_{whisker}_expected"),
        format!(
            "suite {RUN}: {words}, {whisker} whisker: expected share of trials with an error of at most 0.3 mm, if the error is normally \
             distributed and its standard deviation is the Cramér–Rao bound with unknown velocity and size"
        ),
        90.0,
        "%",
        move |context| {
            let group = format!("moving_{object}");
            Ok(expected_accurate(context.run(RUN).trials_of(&group, whisker, RECOMMENDED)))
        },
    )
}

/// Trials on objects that are not convex.
fn of_hollow(context: &Context) -> impl Iterator<Item = &TrialRow> {
    let is_hollow = |group: &str| group.strip_prefix("hollow_").is_some_and(|object| HOLLOW.contains(&object));
    context.run(RUN).trials_in(RECOMMENDED, is_hollow)
}
