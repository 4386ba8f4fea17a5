//! Lost contacts on a vibrating arm: precision, recall and delay of their detection.

use testbed::metrics::{Metric, contact_events};
use testbed::statistics::{mean, median};

use super::{Claim, Context, WHISKERS};

/// Suite and run.
pub(super) const RUN: &str = "contact_events";

pub(super) fn claims() -> Vec<Claim> {
    WHISKERS.into_iter().flat_map(of_whisker).collect()
}

fn of_whisker(whisker: &'static str) -> Vec<Claim> {
    let about = format!("lift-offs, {whisker} whisker, vibration of 3 % of the signal: lost contacts");
    vec![
        Claim::at_least(format!("lost_{whisker}_precision"), format!("{about}, precision"), 0.98, "", move |context| {
            Ok(mean(of_trials(context, whisker, &contact_events::LOST_PRECISION)))
        }),
        Claim::at_least(format!("lost_{whisker}_recall"), format!("{about}, recall"), 0.98, "", move |context| {
            Ok(mean(of_trials(context, whisker, &contact_events::LOST_RECALL)))
        }),
        Claim::at_most(
            format!("lost_{whisker}_delay"),
            format!("{about}, median delay, median over trials"),
            40.0,
            "ms",
            move |context| {
                Ok(median(of_trials(context, whisker, &contact_events::LOST_DELAY)).map(|delay_s| 1e3 * delay_s))
            },
        ),
    ]
}

/// A metric of every trial with a whisker. Contact events do not depend on the estimator, so any one serves.
fn of_trials(context: &Context, whisker: &str, metric: &Metric) -> Vec<f64> {
    let evaluation = context.run(RUN);
    let estimator = &evaluation.run.estimators[0].name;
    let trials = evaluation.trials.iter().filter(|trial| {
        trial.head.whisker == whisker
            && trial.head.estimator == *estimator
            && trial.head.noise == evaluation.run.noise[0]
    });
    trials.filter_map(|trial| trial.get(metric)).collect()
}
