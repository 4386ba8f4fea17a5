//! Outlines of objects: how far the best filter's surface points lie from the truth.

use super::{Claim, Context, Relation, WHISKERS, filters};
use crate::statistics::median_of_scores;

/// The objects, and how far a filter that takes the contact to rest may be from the contact itself, in mm.
const GROUPS: [(&str, f64); 4] = [("circle_15", 3.0), ("circle_50", 13.0), ("rectangle", 0.6), ("octagon", 6.0)];

pub(super) fn claims() -> Vec<Claim> {
    let mut claims = Vec::new();
    for (group, contact_mm) in GROUPS {
        for whisker in WHISKERS {
            claims.push(Claim {
                id: format!("contact_{group}_{whisker}"),
                claim: format!(
                    "{group}, {whisker} whisker, best filter: median distance of surface points to the outline"
                ),
                unit: "mm",
                relation: Relation::AtMost,
                bound: 1.0,
                measure: Box::new(move |context: &Context| {
                    Ok(filters()
                        .filter_map(|filter| {
                            median_of_scores(context.trials(group, whisker, filter).map(|row| row.outline_median_m))
                        })
                        .min_by(f64::total_cmp)
                        .map(|distance| distance * 1e3))
                }),
            });
            claims.push(Claim {
                id: format!("contact_{group}_{whisker}"),
                claim: format!(
                    "{group}, {whisker} whisker, best filter: steady RMSE of the contact, median over trials"
                ),
                unit: "mm",
                relation: Relation::AtMost,
                bound: contact_mm,
                measure: Box::new(move |context: &Context| {
                    Ok(filters()
                        .filter_map(|filter| context.summary(group, whisker, filter)?.rmse_m)
                        .min_by(f64::total_cmp)
                        .map(|rmse| rmse * 1e3))
                }),
            });
        }
    }
    claims
}
