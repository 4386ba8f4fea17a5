//! Certainty on random contacts with friction, on random objects that are not convex, and on random objects that move.

use serde_json::Value;
use testbed::metrics::{bound, doubt, error, second};
use testbed::results::TrialRow;
use testbed::statistics::mean;

use super::hollow::HOLLOW;
use super::sets::{Set, coverage_of, doubt_false_per_min, doubt_found, overconfident, sets_of, share};
use super::{Claim, Context, RECOMMENDED, percent};

/// Run of the suite, and its name.
pub(super) const RUN: &str = "random_contacts";

/// Largest error of an accurate contact on a moving object, and time within which the other trials must be in doubt.
const ACCURATE_M: f64 = 0.3e-3;
const DOUBT_WITHIN_S: f64 = 0.5;

/// A departure from ideal contacts.
struct Departure {
    id: &'static str,
    words: &'static str,
    /// Whether a scene has it.
    is_in: fn(&Value) -> bool,
}

const FRICTION: Departure =
    Departure { id: "friction", words: "contacts with friction", is_in: |scene| scene.get("friction").is_some() };
const NOT_CONVEX: Departure = Departure {
    id: "hollow",
    words: "objects that are not convex",
    is_in: |scene| scene["object"]["shape"].as_str().is_some_and(|shape| HOLLOW.contains(&shape)),
};
const MOVING: Departure =
    Departure { id: "moving", words: "objects that move", is_in: |scene| scene.get("object_velocity_m_s").is_some() };

impl Departure {
    fn sets<'a>(&self, context: &'a Context) -> anyhow::Result<Vec<Set<'a>>> {
        let mut found = Vec::new();
        for set in sets_of(context, RUN, RUN) {
            if (self.is_in)(&set.sidecar()?.scene) {
                found.push(set);
            }
        }
        Ok(found)
    }

    fn trials<'a>(&self, context: &'a Context) -> anyhow::Result<impl Iterator<Item = &'a TrialRow>> {
        Ok(self.sets(context)?.into_iter().flat_map(|set| set.trials))
    }

    fn about(&self, what: &str) -> String {
        format!("random contacts, {RECOMMENDED}: {}: {what}", self.words)
    }
}

pub(super) fn claims() -> Vec<Claim> {
    let mut claims: Vec<Claim> = [FRICTION, NOT_CONVEX, MOVING].into_iter().flat_map(certainty).collect();
    claims.extend(second_contacts());
    claims.push(accurate_or_in_doubt());
    claims.extend(doubts());
    claims
}

/// Claims on the stated certainty.
fn certainty(of: Departure) -> [Claim; 4] {
    let Departure { id, is_in, words } = of;
    let of = move || Departure { id, is_in, words };
    let ellipses = of().about("stated 95 % ellipses that hold the truth, mean over sets");
    let covered = move |context: &Context| Ok(coverage_of(&of().sets(context)?));
    [
        Claim::at_least(format!("contacts_{id}_coverage_low"), ellipses.clone(), 88.0, "%", covered),
        Claim::at_most(format!("contacts_{id}_coverage_high"), ellipses, 99.0, "%", covered),
        Claim::at_most(
            format!("contacts_{id}_overconfident"),
            of().about("sets in which fewer than 80 % of the ellipses hold the truth"),
            3.0,
            "%",
            move |context| Ok(overconfident(&of().sets(context)?)),
        ),
        Claim::at_least(
            format!("contacts_{id}_answered"),
            of().about("instants of contact in the calibrated domain with an estimate, mean over sets"),
            90.0,
            "%",
            move |context| {
                let sets = of().sets(context)?;
                Ok(mean(sets.iter().filter_map(|set| set.mean(&error::ANSWERED))).map(|share| 100.0 * share))
            },
        ),
    ]
}

fn second_contacts() -> [Claim; 2] {
    [
        Claim::at_least(
            "contacts_second_recall".into(),
            NOT_CONVEX.about("second contacts that are signalled within 0.2 s, mean over trials"),
            95.0,
            "%",
            |context| Ok(percent(NOT_CONVEX.trials(context)?, &second::RECALL)),
        ),
        Claim::at_least(
            "contacts_second_precision".into(),
            NOT_CONVEX.about(
                "signals raised during a second contact or within 0.2 s after it, mean over trials with signals",
            ),
            95.0,
            "%",
            |context| Ok(percent(NOT_CONVEX.trials(context)?, &second::PRECISION)),
        ),
    ]
}

/// Share of the trials on moving objects whose contacts are accurate, as far as the bound allows, or whose models are in doubt in time.
fn accurate_or_in_doubt() -> Claim {
    Claim::at_least(
        "contacts_moving_accurate".into(),
        MOVING.about(
            "trials with a steady RMSE of at most 0.3 mm, or in doubt within 0.5 s, of those whose bound does not exceed 0.3 mm",
        ),
        90.0,
        "%",
        |context| {
            let is_at_most = |metric: Option<f64>| metric.is_some_and(|rmse_m| rmse_m <= ACCURATE_M);
            let possible = MOVING.trials(context)?.filter(|trial| is_at_most(trial.get(&bound::MOVING_RMSE)));
            Ok(share(possible, |trial| {
                is_at_most(trial.get(&error::RMSE))
                    || trial.get(&doubt::DOUBT_TIME).is_some_and(|time_s| time_s <= DOUBT_WITHIN_S)
            }))
        },
    )
}

/// Claims on the signal of doubt. On an object that moves it is no false alarm.
fn doubts() -> [Claim; 2] {
    let about = |what: &str| format!("random contacts, {RECOMMENDED}: {what}");
    [
        Claim::at_least(
            "contacts_doubt_found".into(),
            about("trials of sets with a coverage below 60 % whose models are in doubt within 2 s"),
            90.0,
            "%",
            |context| Ok(doubt_found(sets_of(context, RUN, RUN))),
        ),
        Claim::at_most(
            "contacts_doubt_false".into(),
            about("objects at rest: signals of doubt per minute of contact, in sets with a coverage of at least 80 %"),
            0.02,
            "per minute",
            |context| {
                let mut at_rest = FRICTION.sets(context)?;
                at_rest.extend(NOT_CONVEX.sets(context)?);
                Ok(doubt_false_per_min(at_rest))
            },
        ),
    ]
}
