//! Certainty on random contacts with friction, on random objects that are not convex, and on random objects that move.

use serde_json::Value;
use testbed::metrics::{bound, error, second};
use testbed::results::TrialRow;
use testbed::statistics::mean;

use super::hollow::{ACCURATE_M, HOLLOW, expected_accurate, is_accurate_or_in_doubt};
use super::sets::{Set, allows, coverage_of, doubt_false_per_min, doubt_found, overconfident, sets_of, share};
use super::{Claim, Context, RECOMMENDED, percent};

/// Name of the suite and of its run.
pub(super) const RUN: &str = "random_contacts";

/// A condition that ideal contacts do not have.
#[derive(Clone, Copy)]
struct Condition {
    id: &'static str,
    /// Upper bound (%) of the claim on the share of ellipses that hold the truth.
    most_covered: f64,
    description: &'static str,
    /// Whether a scene has this condition.
    is_in: fn(&Value) -> bool,
}

const FRICTION: Condition = Condition {
    id: "friction",
    most_covered: 98.0,
    description: "contacts with friction",
    is_in: |scene| scene.get("friction").is_some(),
};
const NOT_CONVEX: Condition = Condition {
    id: "non_convex",
    most_covered: 99.0,
    description: "objects that are not convex",
    is_in: |scene| scene["object"]["shape"].as_str().is_some_and(|shape| HOLLOW.contains(&shape)),
};
const MOVING: Condition = Condition {
    id: "moving",
    most_covered: 99.0,
    description: "objects that move",
    is_in: |scene| scene.get("object_velocity_m_s").is_some(),
};

impl Condition {
    fn sets<'a>(&self, context: &'a Context) -> anyhow::Result<Vec<Set<'a>>> {
        let mut found = Vec::new();
        for set in sets_of(&context.run(RUN).trials) {
            if (self.is_in)(&set.sidecar(RUN)?.scene) {
                found.push(set);
            }
        }
        Ok(found)
    }

    fn trials<'a>(&self, context: &'a Context) -> anyhow::Result<impl Iterator<Item = &'a TrialRow>> {
        Ok(self.sets(context)?.into_iter().flat_map(|set| set.trials))
    }

    fn about(&self, what: &str) -> String {
        format!("random contacts, {RECOMMENDED}: {}: {what}", self.description)
    }
}

pub(super) fn claims() -> Vec<Claim> {
    let mut claims: Vec<Claim> = [FRICTION, NOT_CONVEX, MOVING].into_iter().flat_map(certainty).collect();
    claims.extend(second_contacts());
    claims.extend(accuracy_of_moving());
    claims.extend(doubts());
    claims
}

/// Claims on the stated certainty.
fn certainty(condition: Condition) -> [Claim; 4] {
    let id = condition.id;
    let ellipses = condition.about("stated 95 % ellipses that hold the truth, mean over sets");
    let covered = move |context: &Context| Ok(coverage_of(&condition.sets(context)?));
    [
        Claim::at_least(format!("contacts_{id}_coverage_low"), ellipses.clone(), 88.0, "%", covered),
        Claim::at_most(format!("contacts_{id}_coverage_high"), ellipses, condition.most_covered, "%", covered),
        Claim::at_most(
            format!("contacts_{id}_overconfident"),
            condition.about("sets in which fewer than 80 % of the ellipses hold the truth"),
            3.0,
            "%",
            move |context| Ok(overconfident(&condition.sets(context)?)),
        ),
        Claim::at_least(
            format!("contacts_{id}_answered"),
            condition.about("instants of contact in the calibrated domain with an estimate, mean over sets"),
            90.0,
            "%",
            move |context| {
                let sets = condition.sets(context)?;
                Ok(mean(sets.iter().filter_map(|set| set.mean(&error::ANSWERED))).map(|share| 100.0 * share))
            },
        ),
    ]
}

fn second_contacts() -> [Claim; 3] {
    [
        Claim::at_least(
            "contacts_second_recall".into(),
            NOT_CONVEX.about("second contacts that are signalled within 0.2 s, mean over trials"),
            95.0,
            "%",
            |context| Ok(percent(NOT_CONVEX.trials(context)?, &second::RECALL)),
        ),
        Claim::at_least(
            "contacts_second_ideal_recall".into(),
            format!(
                "random contacts: {}: second contacts that an ideal test detects within 0.2 s, mean over trials",
                NOT_CONVEX.description
            ),
            95.0,
            "%",
            |context| Ok(percent(NOT_CONVEX.trials(context)?, &second::IDEAL_RECALL)),
        ),
        Claim::at_least(
            "contacts_second_precision".into(),
            NOT_CONVEX.about(
                "signals of a second contact that are raised during one or within 0.2 s after it, mean over trials with signals",
            ),
            95.0,
            "%",
            |context| Ok(percent(NOT_CONVEX.trials(context)?, &second::PRECISION)),
        ),
    ]
}

/// Trials with a moving object whose bound with unknown velocity, size and deviations is at most [`ACCURATE_M`].
fn observable(context: &Context) -> anyhow::Result<impl Iterator<Item = &TrialRow>> {
    Ok(MOVING.trials(context)?.filter(|trial| allows(trial, &bound::MOVING_RMSE, ACCURATE_M)))
}

/// Claims on the trials with a moving object whose bound allows an accurate estimate: how many are accurate, or in doubt in time,
/// and how many are expected to be accurate.
fn accuracy_of_moving() -> [Claim; 2] {
    let observable_trials = "of the trials whose Cramér–Rao bound with unknown velocity and size is at most 0.3 mm";
    [
        Claim::at_least(
            "contacts_moving_accurate_or_doubtful".into(),
            MOVING.about(&format!(
                "{observable_trials}: those with a steady RMSE of at most 0.3 mm, or in doubt within 0.5 s"
            )),
            90.0,
            "%",
            |context| Ok(share(observable(context)?, |trial| is_accurate_or_in_doubt(trial))),
        ),
        Claim::at_least(
            "contacts_moving_expected".into(),
            format!(
                "random contacts: {}: {observable_trials}: expected share with an error of at most 0.3 mm, if the error is normally \
                 distributed and its standard deviation is this bound",
                MOVING.description
            ),
            90.0,
            "%",
            |context| Ok(expected_accurate(observable(context)?)),
        ),
    ]
}

/// Claims on `model_doubtful`. If the object moves, the signal does not count as a false alarm.
fn doubts() -> [Claim; 2] {
    let about = |what: &str| format!("random contacts, {RECOMMENDED}: {what}");
    [
        Claim::at_least(
            "contacts_doubt_found".into(),
            about("trials of sets with a coverage below 60 % whose models are in doubt within 2 s"),
            90.0,
            "%",
            |context| Ok(doubt_found(&sets_of(&context.run(RUN).trials))),
        ),
        Claim::at_most(
            "contacts_doubt_false".into(),
            about("objects at rest: signals of doubt per minute of contact, in sets with a coverage of at least 80 %"),
            0.02,
            "per minute",
            |context| {
                let mut at_rest = FRICTION.sets(context)?;
                at_rest.extend(NOT_CONVEX.sets(context)?);
                Ok(doubt_false_per_min(&at_rest))
            },
        ),
    ]
}
