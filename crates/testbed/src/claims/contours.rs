//! Outlines of objects: how far the best filter's surface points lie from the truth.

use super::{Claim, WHISKERS, filters};
use crate::metrics::{error, outline};

/// The objects, and how far the best filter may be from the contact itself, in mm: on the octagon's flats no filter here follows it.
const GROUPS: [(&str, f64); 4] = [("circle_15", 0.5), ("circle_50", 1.5), ("rectangle", 0.6), ("octagon", 6.0)];

/// How far its surface points may lie from the outline, in mm.
const OUTLINE_MM: f64 = 1.0;

pub(super) fn claims() -> Vec<Claim> {
    let mut claims = Vec::new();
    for (group, contact_mm) in GROUPS {
        for whisker in WHISKERS {
            let scores = [
                ("outline", "median distance of surface points to the outline", outline::MEDIAN, OUTLINE_MM),
                ("contact", "steady RMSE of the contact", error::RMSE, contact_mm),
            ];
            for (id, score, metric, bound_mm) in scores {
                claims.push(Claim::at_most(
                    format!("{id}_{group}_{whisker}"),
                    format!("{group}, {whisker} whisker, best filter: {score}, median over trials"),
                    bound_mm,
                    "mm",
                    move |context| {
                        Ok(context.standard().best(group, whisker, filters(), &metric).map(|value_m| 1e3 * value_m))
                    },
                ));
            }
        }
    }
    claims
}
