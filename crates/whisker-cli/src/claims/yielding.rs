//! Objects that give way: accuracy and its bounds, doubt, and misleading estimates.

use testbed::metrics::{consistency, doubt, error};

use super::hollow::{expected_accurate, is_accurate_or_in_doubt};
use super::{Claim, Context, RECOMMENDED, WHISKERS, percent};

/// Run of the suite of objects that give way.
pub(super) const RUN: &str = "yielding";

/// Estimator of objects that are pushed along.
const PUSHED: &str = "pushed";

/// Groups of objects that give way, with their descriptions. The friction is that with the table.
const OBJECTS: [(&str, &str); 16] = [
    ("free_pin_0p2g_0p1", "free pin, 0.2 g, coefficient of friction 0.1"),
    ("free_pin_0p2g_slow", "free pin, 0.2 g, coefficient of friction 0.1, slow stroke"),
    ("free_pin_0p2g_0p3", "free pin, 0.2 g, coefficient of friction 0.3"),
    ("free_pin_2g_0p06", "free pin, 2 g, coefficient of friction 0.06"),
    ("free_pin_20g_0p3", "free pin, 20 g, coefficient of friction 0.3"),
    ("free_circle_0p2g_0p1", "free circle, 0.2 g, coefficient of friction 0.1"),
    ("free_circle_0p2g_slow", "free circle, 0.2 g, coefficient of friction 0.1, slow stroke"),
    ("free_circle_0p2g_0p3", "free circle, 0.2 g, coefficient of friction 0.3"),
    ("free_circle_2g_0p06", "free circle, 2 g, coefficient of friction 0.06"),
    ("free_circle_20g_0p3", "free circle, 20 g, coefficient of friction 0.3"),
    ("soft_pin_5", "pin, 5 N/m"),
    ("soft_pin_20", "pin, 20 N/m"),
    ("soft_pin_100", "pin, 100 N/m"),
    ("soft_circle_5", "circle, 5 N/m"),
    ("soft_circle_20", "circle, 20 N/m"),
    ("soft_circle_100", "circle, 100 N/m"),
];

pub(super) fn claims() -> Vec<Claim> {
    let sets = OBJECTS.into_iter().flat_map(|object| WHISKERS.map(|whisker| (object, whisker)));
    let of_sets = sets.flat_map(|(object, whisker)| {
        [accurate_or_in_doubt(object, whisker), expected_to_be_accurate(object, whisker), misleading(object, whisker)]
    });
    let free = OBJECTS.into_iter().filter(|(group, _)| group.starts_with("free_"));
    let pushed = free.flat_map(|object| WHISKERS.map(|whisker| accurate_alone(object, whisker)));
    let covered =
        |context: &Context| Ok(percent(context.run(RUN).trials_in(RECOMMENDED, |_| true), &consistency::COVERAGE));
    let ellipses = about("stated 95 % ellipses that hold the truth, mean over trials");
    let coverage = [
        Claim::at_least("yielding_coverage_low".into(), ellipses.clone(), 88.0, "%", covered),
        Claim::at_most("yielding_coverage_high".into(), ellipses, 99.0, "%", covered),
    ];
    of_sets.chain(pushed).chain(coverage).collect()
}

fn about(what: &str) -> String {
    format!("suite {RUN}, {RECOMMENDED}: {what}")
}

/// Share of the trials whose contacts are accurate or whose models are in doubt in time.
fn accurate_or_in_doubt((group, words): (&'static str, &'static str), whisker: &'static str) -> Claim {
    let what = format!(
        "{words}, {whisker} whisker: trials with a steady RMSE of at most 0.3 mm, or in doubt within 0.5 s of the displacement by 0.3 mm, \
         or else of the touch"
    );
    Claim::at_least(format!("{group}_{whisker}"), about(&what), 90.0, "%", move |context| {
        let share = context.run(RUN).share(group, whisker, RECOMMENDED, is_accurate_or_in_doubt);
        Ok(share.map(|share| 100.0 * share))
    })
}

/// The error of the estimator of objects that are pushed along, without the average's until it is known that the object slides.
fn accurate_alone((group, words): (&'static str, &'static str), whisker: &'static str) -> Claim {
    let what = format!("suite {RUN}, {PUSHED}: {words}, {whisker} whisker: steady RMSE, median over trials");
    Claim::at_most(format!("{group}_{whisker}_pushed"), what, 0.3, "mm", move |context| {
        let summary = context.run(RUN).summary(group, whisker, PUSHED);
        Ok(summary.and_then(|row| row.get(&error::RMSE)).map(|rmse_m| 1e3 * rmse_m))
    })
}

/// The expected share of accurate trials, which depends on scenes and noise, not on the estimator.
fn expected_to_be_accurate((group, words): (&'static str, &'static str), whisker: &'static str) -> Claim {
    let what = format!(
        "suite {RUN}: {words}, {whisker} whisker: expected share of trials with an error of at most 0.3 mm, if the error is normally \
         distributed and its standard deviation is the Cramér–Rao bound with unknown displacement and size"
    );
    Claim::at_least(format!("{group}_{whisker}_expected"), what, 90.0, "%", move |context| {
        Ok(expected_accurate(context.run(RUN).trials_of(group, whisker, RECOMMENDED)))
    })
}

/// Share of misleading estimates.
fn misleading((group, words): (&'static str, &'static str), whisker: &'static str) -> Claim {
    let what = format!(
        "{words}, {whisker} whisker: estimates with an error above 0.3 mm outside of the stated 95 % ellipse and without doubt, mean \
         over trials"
    );
    Claim::at_most(format!("{group}_{whisker}_misleading"), about(&what), 1.0, "%", move |context| {
        Ok(percent(context.run(RUN).trials_of(group, whisker, RECOMMENDED), &doubt::MISLEADING))
    })
}
