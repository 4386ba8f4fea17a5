//! A thin pin: how well the filters find the contact, and by how much they beat the baseline.

use std::collections::BTreeMap;
use std::ops::Range;

use super::{BASELINES, Claim, Context, FILTERS, Relation, WHISKERS};
use crate::metrics::START_UP_S;
use crate::statistics::rms;

const GROUP: &str = "pin";

pub(super) fn claims() -> Vec<Claim> {
    let mut claims = Vec::new();
    for whisker in WHISKERS {
        for filter in FILTERS {
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
        for filter in FILTERS {
            claims.push(factor(whisker, filter, "start-up", 0.0..START_UP_S));
            claims.push(factor(whisker, filter, "steady", START_UP_S..f64::INFINITY));
        }
    }
    for filter in ["ukf", "particle"] {
        claims.push(Claim {
            id: format!("pin_curved_{filter}_time_to_1mm"),
            claim: format!("pin, curved whisker, {filter}: time to stay below 1 mm, median over trials"),
            unit: "s",
            relation: Relation::AtMost,
            bound: 0.7,
            measure: Box::new(move |context| {
                Ok(context.summary(GROUP, "curved", filter).and_then(|row| row.time_to_1mm_s))
            }),
        });
    }
    claims
}

/// By which factor a filter beats the better of the baselines, at the instants at which all trials of both have an estimate: the baselines
/// answer only after a push.
fn factor(whisker: &'static str, filter: &'static str, phase: &'static str, when_s: Range<f64>) -> Claim {
    Claim {
        id: format!("pin_{whisker}_{filter}_{phase}_factor"),
        claim: format!("pin, {whisker} whisker, {filter}: {phase} error of the better baseline over that of the filter"),
        unit: "times",
        relation: Relation::AtLeast,
        bound: 1.0,
        measure: Box::new(move |context: &Context| {
            let ratios = BASELINES.iter().filter_map(|baseline| ratio(context, whisker, baseline, filter, &when_s));
            Ok(ratios.min_by(f64::total_cmp))
        }),
    }
}

/// Root mean square over time of the baseline's median error, over that of the filter.
fn ratio(context: &Context, whisker: &str, baseline: &str, filter: &str, when_s: &Range<f64>) -> Option<f64> {
    let bands = |estimator: &str| -> BTreeMap<u64, f64> {
        let trials = context.trials(GROUP, whisker, estimator).count();
        context
            .bands
            .iter()
            .filter(|row| row.group == GROUP && row.whisker == whisker && row.estimator == estimator)
            .filter(|row| row.noise == context.run.noise[0] && row.trials == trials)
            .filter(|row| when_s.contains(&row.t_contact_s))
            .map(|row| (row.t_contact_s.to_bits(), row.median_m))
            .collect()
    };
    let (baseline, filter) = (bands(baseline), bands(filter));
    let both: Vec<(f64, f64)> = baseline.iter().filter_map(|(t, b)| Some((*b, *filter.get(t)?))).collect();
    let (baseline, filter): (Vec<f64>, Vec<f64>) = both.into_iter().unzip();
    Some(rms(&baseline)? / rms(&filter)?)
}
