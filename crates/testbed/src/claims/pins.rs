//! A thin pin: how well the filters find the contact, and by how much they beat the baseline.

use std::ops::Range;

use super::{Claim, Context, Relation, WHISKERS, filters};
use crate::baseline::{self, START_UP, STEADY};

const GROUP: &str = "pin";

pub(super) fn claims() -> Vec<Claim> {
    let mut claims = Vec::new();
    for whisker in WHISKERS {
        for filter in filters() {
            claims.push(Claim {
                id: format!("pin_{whisker}_{filter}_rmse"),
                claim: format!("pin, {whisker} whisker, {filter}: steady RMSE, median over trials"),
                unit: "mm",
                relation: Relation::AtMost,
                bound: 0.6,
                measure: Box::new(move |context| {
                    Ok(context.summary(GROUP, whisker, filter).and_then(|row| row.rmse_m).map(|rmse| rmse * 1e3))
                }),
            });
        }
        for filter in filters() {
            claims.push(Claim {
                id: format!("pin_{whisker}_{filter}_time_to_1mm"),
                claim: format!("pin, {whisker} whisker, {filter}: time to stay below 1 mm, median over trials"),
                unit: "s",
                relation: Relation::AtMost,
                bound: 0.7,
                measure: Box::new(move |context| {
                    Ok(context.summary(GROUP, whisker, filter).and_then(|row| row.time_to_1mm_s))
                }),
            });
        }
        claims.push(Claim {
            id: format!("pin_{whisker}_baseline_rmse"),
            claim: format!("pin, {whisker} whisker, better baseline: steady RMSE, median over trials"),
            unit: "mm",
            relation: Relation::AtMost,
            // What the baseline reached in the publication that the filters come from.
            bound: 3.3,
            measure: Box::new(move |context| {
                let baselines = context.run.estimators.iter().filter(|row| row.is_baseline);
                Ok(baselines
                    .filter_map(|row| context.summary(GROUP, whisker, &row.name)?.rmse_m)
                    .min_by(f64::total_cmp)
                    .map(|rmse| rmse * 1e3))
            }),
        });
        for filter in filters() {
            claims.push(factor(whisker, filter, "start-up", START_UP));
            claims.push(factor(whisker, filter, "steady", STEADY));
        }
    }
    claims
}

fn factor(whisker: &'static str, filter: &'static str, phase: &'static str, when_s: Range<f64>) -> Claim {
    Claim {
        id: format!("pin_{whisker}_{filter}_{phase}_factor"),
        claim: format!(
            "pin, {whisker} whisker, {filter}: {phase} error of the better baseline over that of the filter"
        ),
        unit: "times",
        relation: Relation::AtLeast,
        bound: 1.0,
        measure: Box::new(move |context: &Context| {
            Ok(baseline::factor(&context.run, &context.bands, (GROUP, whisker), filter, &when_s))
        }),
    }
}
