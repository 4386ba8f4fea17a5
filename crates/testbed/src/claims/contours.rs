//! Outlines of objects: how far the best filter's surface points lie from the truth.

use super::{Claim, Context, FILTERS, Relation, WHISKERS};
use crate::statistics::median_of_scores;

const GROUPS: [&str; 4] = ["circle_15", "circle_50", "rectangle", "octagon"];

pub(super) fn claims() -> Vec<Claim> {
    let mut claims = Vec::new();
    for group in GROUPS {
        for whisker in WHISKERS {
            claims.push(Claim {
                id: format!("contour_{group}_{whisker}"),
                claim: format!(
                    "{group}, {whisker} whisker, best filter: median distance of surface points to the outline"
                ),
                unit: "mm",
                relation: Relation::AtMost,
                bound: 1.0,
                measure: Box::new(move |context: &Context| {
                    Ok(FILTERS
                        .iter()
                        .filter_map(|filter| {
                            median_of_scores(context.trials(group, whisker, filter).map(|row| row.outline_median_m))
                        })
                        .min_by(f64::total_cmp)
                        .map(|distance| distance * 1e3))
                }),
            });
        }
    }
    claims
}
