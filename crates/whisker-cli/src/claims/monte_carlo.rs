//! A hundred trials per whisker on a pin: error over the Cramér–Rao bound, consistency, and comparison with the published filters.

use testbed::consistency::{Average, NEES_FREEDOM, NIS_FREEDOM};
use testbed::metrics::{Metric, bound, consistency, error};
use testbed::results::TrialRow;
use whisker::estimators;

use super::{Claim, Evaluation, RECOMMENDED, WHISKERS, filters};

/// Suite and run.
pub(super) const RUN: &str = "pins100";

pub(super) const GROUP: &str = "pin";

pub(super) fn claims() -> Vec<Claim> {
    let topics = [limit, start, consistent];
    let of_whiskers = topics.into_iter().flat_map(|topic| WHISKERS.into_iter().flat_map(topic));
    of_whiskers.chain(published()).collect()
}

/// Error of the best filter relative to the Cramér–Rao bound.
fn limit(whisker: &'static str) -> Vec<Claim> {
    let most_mm = if whisker == "curved" { 0.06 } else { 0.1 };
    let best = move |run: &Evaluation, metric: &Metric| run.best(GROUP, whisker, filters(), metric);
    vec![
        Claim::at_most(
            format!("limit_{whisker}_rmse"),
            format!("100 trials on a pin, {whisker} whisker, best filter: steady RMSE, median over trials"),
            most_mm,
            "mm",
            move |context| Ok(best(context.run(RUN), &error::RMSE).map(|rmse_m| 1e3 * rmse_m)),
        ),
        Claim::at_most(
            format!("limit_{whisker}_ratio"),
            format!(
                "100 trials on a pin, {whisker} whisker, best filter: steady RMSE over the Cramér–Rao bound, over all trials"
            ),
            1.25,
            "times",
            move |context| Ok(best(context.run(RUN), &bound::RATIO)),
        ),
    ]
}

/// Time until the error stays below a millimetre.
fn start(whisker: &'static str) -> Vec<Claim> {
    let within = |estimator: &'static str, time_s: f64| {
        Claim::at_least(
            format!("start_{whisker}_{estimator}"),
            format!(
                "100 trials on a pin, {whisker} whisker, {estimator}: trials that stay below 1 mm within {time_s} s"
            ),
            99.0,
            "%",
            move |context| {
                let in_time = |trial: &TrialRow| trial.get(&error::TIME_TO_1MM).is_some_and(|time| time <= time_s);
                Ok(context.run(RUN).share(GROUP, whisker, estimator, in_time).map(|share| 100.0 * share))
            },
        )
    };
    let mut claims = vec![
        within(RECOMMENDED, 0.3),
        Claim::at_most(
            format!("start_{whisker}_{RECOMMENDED}_never"),
            format!("100 trials on a pin, {whisker} whisker, {RECOMMENDED}: trials that never stay below 1 mm"),
            0.0,
            "%",
            move |context| {
                let row = context.run(RUN).summary(GROUP, whisker, RECOMMENDED);
                Ok(row.and_then(|row| row.get(&error::NEVER_1MM)).map(|share| 100.0 * share))
            },
        ),
    ];
    claims.extend(with_hypotheses().map(|filter| within(filter, 0.6)));
    claims
}

/// Filters that start from several hypotheses.
fn with_hypotheses() -> impl Iterator<Item = &'static str> {
    filters().filter(|name| {
        let row = estimators::estimator(name).expect("a registered estimator");
        (row.defaults)()["start"]["kind"] == "hypotheses"
    })
}

/// Consistency of the recommended estimator (NEES, NIS, coverage).
fn consistent(whisker: &'static str) -> Vec<Claim> {
    let mut claims = Vec::new();
    for (metric, freedom) in [(consistency::NEES, NEES_FREEDOM), (consistency::NIS, NIS_FREEDOM)] {
        // The average over an end of its interval, which depends on how many independent samples the trials are worth.
        let over = move |run: &Evaluation, end: fn((f64, f64)) -> f64| {
            let of_trials = run.trials_of(GROUP, whisker, RECOMMENDED).filter_map(|trial| trial.get(&metric));
            let average = Average::of_trials(freedom, &of_trials.collect::<Vec<_>>())?;
            Some(average.value / end(average.interval))
        };
        let name = metric.name.to_uppercase();
        let claim = format!("100 trials on a pin, {whisker} whisker, {RECOMMENDED}: average {name} over the");
        claims.push(Claim::at_most(
            format!("consistency_{whisker}_{}_high", metric.name),
            format!("{claim} upper end of its 95 % interval"),
            1.0,
            "times",
            move |context| Ok(over(context.run(RUN), |(_, high)| high)),
        ));
        claims.push(Claim::at_least(
            format!("consistency_{whisker}_{}_low", metric.name),
            format!("{claim} lower end of its 95 % interval"),
            1.0,
            "times",
            move |context| Ok(over(context.run(RUN), |(low, _)| low)),
        ));
    }
    let coverage = move |run: &Evaluation| {
        let row = run.summary(GROUP, whisker, RECOMMENDED)?;
        row.get(&consistency::COVERAGE).map(|share| 100.0 * share)
    };
    let claim =
        format!("100 trials on a pin, {whisker} whisker, {RECOMMENDED}: stated 95 % ellipses that hold the truth");
    claims.push(Claim::at_least(
        format!("consistency_{whisker}_coverage_low"),
        claim.clone(),
        90.0,
        "%",
        move |context| Ok(coverage(context.run(RUN))),
    ));
    claims.push(Claim::at_most(format!("consistency_{whisker}_coverage_high"), claim, 98.0, "%", move |context| {
        Ok(coverage(context.run(RUN)))
    }));
    claims
}

/// The published observation: on the curved whisker the published EKF starts far slower than the other two.
fn published() -> Vec<Claim> {
    let ahead = |other: &'static str| {
        Claim::at_least(
            format!("published_{other}_ahead"),
            format!(
                "100 trials on a pin, curved whisker: time to stay below 1 mm of paper-ekf over that of {other}, medians"
            ),
            2.0,
            "times",
            move |context| {
                let time_s = |estimator| context.run(RUN).summary(GROUP, "curved", estimator)?.get(&error::TIME_TO_1MM);
                Ok(time_s("paper-ekf").zip(time_s(other)).map(|(ekf_s, other_s)| ekf_s / other_s))
            },
        )
    };
    ["paper-ukf", "paper-particle"].map(ahead).into()
}
