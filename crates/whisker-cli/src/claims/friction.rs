//! Contacts with friction: errors against those without friction, stated certainty, and the coefficient of friction.

use testbed::metrics::{consistency, error, friction};
use testbed::results::TrialRow;
use testbed::statistics::{mean, median};

use super::{Claim, Context, RECOMMENDED, WHISKERS, in_words, percent};

/// Run of the suite of contacts with friction.
pub(super) const RUN: &str = "friction";

/// Objects that the whisker rubs along with each coefficient of friction.
const OBJECTS: [&str; 7] = ["pin_35", "pin_50", "pin_62", "circle_5", "circle_15", "circle_50", "octagon"];

/// Coefficients of friction in percent, as in the names of the groups.
const COEFFICIENTS: [u32; 2] = [30, 50];

pub(super) fn claims() -> Vec<Claim> {
    let mut claims: Vec<Claim> =
        WHISKERS.into_iter().flat_map(|whisker| OBJECTS.map(|object| (whisker, object))).flat_map(factors).collect();
    claims.extend(WHISKERS.into_iter().flat_map(means));
    let ellipses = "stated 95 % ellipses that hold the truth, mean over trials";
    let coverage = |context: &Context| Ok(percent(rubbing(context), &consistency::COVERAGE));
    claims.extend([
        Claim::at_least("friction_coverage_low".into(), about(ellipses), 88.0, "%", coverage),
        Claim::at_most("friction_coverage_high".into(), about(ellipses), 98.0, "%", coverage),
        Claim::at_least(
            "friction_coefficient_stated".into(),
            about("curved whisker: trials in which the coefficient of friction is stated"),
            50.0,
            "%",
            |context| {
                let curved = rubbing(context).filter(|trial| trial.head.whisker == "curved");
                Ok(mean(curved.map(|trial| f64::from(trial.get(&friction::ERROR).is_some())))
                    .map(|share| 100.0 * share))
            },
        ),
        Claim::at_most(
            "friction_coefficient_error".into(),
            about("error of the coefficient of friction where it is stated, median over trials"),
            0.1,
            "",
            |context| Ok(median(rubbing(context).filter_map(|trial| trial.get(&friction::ERROR)))),
        ),
        Claim::at_least(
            "friction_coefficient_covered".into(),
            about("95 % intervals of the coefficient of friction that hold the true one, of those stated"),
            90.0,
            "%",
            |context| Ok(percent(rubbing(context), &friction::COVERED)),
        ),
    ]);
    claims
}

fn about(what: &str) -> String {
    format!("friction, {RECOMMENDED}: {what}")
}

/// Name of the group of an object that is touched with a coefficient of friction.
fn group(object: &str, percent: u32) -> String {
    format!("{object}_mu{percent:02}")
}

/// Error with each coefficient relative to that on the same object without friction.
fn factors((whisker, object): (&'static str, &'static str)) -> [Claim; 2] {
    COEFFICIENTS.map(|percent| {
        let coefficient = f64::from(percent) / 100.0;
        Claim::at_most(
            format!("friction_{object}_{whisker}_{percent}"),
            about(&format!(
                "{}, {whisker} whisker, coefficient {coefficient}: steady RMSE over that without friction, medians over trials",
                in_words(object)
            )),
            1.5,
            "times",
            move |context| {
                let rmse_m = |percent| {
                    context.run(RUN).summary(&group(object, percent), whisker, RECOMMENDED)?.get(&error::RMSE)
                };
                Ok(rmse_m(percent).zip(rmse_m(0)).map(|(with_m, without_m)| with_m / without_m))
            },
        )
    })
}

/// Error with each coefficient relative to that without friction, as means over the trials of all objects: unlike medians, these
/// increase with a few large errors.
fn means(whisker: &'static str) -> [Claim; 2] {
    COEFFICIENTS.map(|percent| {
        let coefficient = f64::from(percent) / 100.0;
        Claim::at_most(
            format!("friction_mean_{whisker}_{percent}"),
            about(&format!(
                "all objects, {whisker} whisker, coefficient {coefficient}: steady RMSE over that without friction, means over trials"
            )),
            1.5,
            "times",
            move |context| {
                let rmse_m = |percent| {
                    let groups = OBJECTS.map(|object| group(object, percent));
                    let trials = context.run(RUN).trials_in(RECOMMENDED, move |of| groups.iter().any(|group| group == of));
                    let errors: Option<Vec<f64>> =
                        trials.filter(|trial| trial.head.whisker == whisker).map(|trial| trial.get(&error::RMSE)).collect();
                    errors.and_then(mean)
                };
                Ok(rmse_m(percent).zip(rmse_m(0)).map(|(with_m, without_m)| with_m / without_m))
            },
        )
    })
}

/// Trials in which the whisker rubs along an object with friction.
fn rubbing(context: &Context) -> impl Iterator<Item = &TrialRow> {
    let groups: Vec<_> = OBJECTS.iter().flat_map(|object| COEFFICIENTS.map(|percent| group(object, percent))).collect();
    context.run(RUN).trials_in(RECOMMENDED, move |of| groups.iter().any(|group| group == of))
}
