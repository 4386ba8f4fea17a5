//! A thin pin: contact error of every filter, alone and relative to the baseline.

use std::ops::Range;

use testbed::baseline::{self, START_UP, STEADY};
use testbed::metrics::error;
use whisker::estimators::MethodClass;

use super::{Claim, WHISKERS, filters};

const GROUP: &str = "pin";

pub(super) fn claims() -> Vec<Claim> {
    let mut claims = Vec::new();
    for whisker in WHISKERS {
        for filter in filters() {
            claims.push(Claim::at_most(
                format!("pin_{whisker}_{filter}_rmse"),
                format!("pin, {whisker} whisker, {filter}: steady RMSE, median over trials"),
                0.6,
                "mm",
                move |context| {
                    let row = context.standard().summary(GROUP, whisker, filter);
                    Ok(row.and_then(|row| row.get(&error::RMSE)).map(|rmse_m| 1e3 * rmse_m))
                },
            ));
            claims.push(Claim::at_most(
                format!("pin_{whisker}_{filter}_time_to_1mm"),
                format!("pin, {whisker} whisker, {filter}: time to stay below 1 mm, median over trials"),
                0.7,
                "s",
                move |context| {
                    let row = context.standard().summary(GROUP, whisker, filter);
                    Ok(row.and_then(|row| row.get(&error::TIME_TO_1MM)))
                },
            ));
            claims.push(factor(whisker, filter, "start-up", START_UP));
            claims.push(factor(whisker, filter, "steady", STEADY));
        }
        claims.push(Claim::at_most(
            format!("pin_{whisker}_baseline_rmse"),
            format!("pin, {whisker} whisker, better baseline: steady RMSE, median over trials"),
            // Error of the baseline in the publication of the filters.
            3.3,
            "mm",
            move |context| {
                let standard = context.standard();
                let baselines = standard.run.estimators.iter().filter(|row| row.class == MethodClass::Baseline);
                let best = standard.best(GROUP, whisker, baselines.map(|row| row.name.as_str()), &error::RMSE);
                Ok(best.map(|rmse_m| 1e3 * rmse_m))
            },
        ));
    }
    claims
}

fn factor(whisker: &'static str, filter: &'static str, phase: &'static str, when_s: Range<f64>) -> Claim {
    Claim::at_least(
        format!("pin_{whisker}_{filter}_{phase}_factor"),
        format!("pin, {whisker} whisker, {filter}: {phase} error of the better baseline over that of the filter"),
        1.0,
        "times",
        move |context| {
            let standard = context.standard();
            Ok(baseline::factor(&standard.run, &standard.bands, GROUP, whisker, filter, &when_s))
        },
    )
}
