//! Contacts in space: the suite of scenes in space.

use testbed::space::rows::SpatialSummaryRow;

use super::{Claim, Context, RECOMMENDED, Relation, WHISKERS, in_words};

/// Run of the suite.
pub(super) const RUN: &str = "spatial";

/// Groups of the suite.
const GROUPS: [&str; 8] = ["pins", "edges", "box", "mesh", "cylinders", "cone", "sphere_20", "sphere_60"];

/// Groups with a radius.
const ROUND: [&str; 3] = ["cylinders", "sphere_20", "sphere_60"];

/// Groups with a curved surface.
const CURVED: [&str; 4] = ["cylinders", "cone", "sphere_20", "sphere_60"];

/// A score of `recommended` on every trial of some groups.
struct Score {
    /// Groups, of [`GROUPS`].
    groups: &'static [&'static str],
    /// Short name, unique.
    id: &'static str,
    /// The score in words.
    what: &'static str,
    relation: Relation,
    bound: f64,
    unit: &'static str,
    /// The score in this unit.
    of: fn(&SpatialSummaryRow) -> Option<f64>,
}

const NORMAL: &str = "root mean square angle between estimated and true normal";
const COVERAGE: &str = "share of the instants at which the 95 % ellipsoid contains the true contact";

const SCORES: &[Score] = &[
    Score {
        groups: &["pins"],
        id: "rmse_over_bound",
        what: "RMSE over the posterior Cramér–Rao bound with known sliding",
        relation: Relation::AtMost,
        bound: 1.3,
        unit: "",
        of: |row| Some(row.rmse_m? / row.bound_m?),
    },
    Score {
        groups: &["pins"],
        id: "rmse_over_object_bound",
        what: "RMSE over the posterior Cramér–Rao bound of an unknown object",
        relation: Relation::AtMost,
        bound: 1.3,
        unit: "",
        of: |row| Some(row.rmse_m? / row.object_bound_m?),
    },
    Score {
        groups: &["pins"],
        id: "out_of_plane",
        what: "RMSE out of the plane of wire and force",
        relation: Relation::AtMost,
        bound: 0.02,
        unit: "mm",
        of: |row| millimetres(row.out_of_plane_m),
    },
    Score {
        groups: &CURVED,
        id: "rmse",
        what: "RMSE of the contact",
        relation: Relation::AtMost,
        bound: 0.4,
        unit: "mm",
        of: |row| millimetres(row.rmse_m),
    },
    Score {
        groups: &CURVED,
        id: "surface",
        what: "mean distance of the estimated points of the surface from the true solid",
        relation: Relation::AtMost,
        bound: 0.05,
        unit: "mm",
        of: |row| millimetres(row.surface_m),
    },
    Score {
        groups: &GROUPS,
        id: "normal",
        what: NORMAL,
        relation: Relation::AtMost,
        bound: 2.0,
        unit: "degrees",
        of: |row| degrees(row.normal_rad),
    },
    Score {
        groups: &["edges"],
        id: "direction",
        what: "root mean square angle between the estimated and the true edge",
        relation: Relation::AtMost,
        bound: 1.2,
        unit: "degrees",
        of: |row| degrees(row.direction_rad),
    },
    Score {
        groups: &["edges"],
        id: "direction_bound",
        what: "posterior Cramér–Rao bound of the angle of the edge, a property of the scenes",
        relation: Relation::AtMost,
        bound: 1.2,
        unit: "degrees",
        of: |row| degrees(row.direction_bound_rad),
    },
    Score {
        groups: &["edges"],
        id: "direction_over_bound",
        what: "angle between the estimated and the true edge, over its posterior Cramér–Rao bound",
        relation: Relation::AtMost,
        bound: 1.3,
        unit: "",
        of: |row| Some(row.direction_rad? / row.direction_bound_rad?),
    },
    Score {
        groups: &GROUPS,
        id: "nees_low",
        what: "NEES of the last estimates over the lower end of the 95 % interval of a consistent method",
        relation: Relation::AtLeast,
        bound: 1.0,
        unit: "",
        of: |row| Some(row.nees? / row.nees_low),
    },
    Score {
        groups: &GROUPS,
        id: "nees_high",
        what: "NEES of the last estimates over the upper end of the 95 % interval of a consistent method",
        relation: Relation::AtMost,
        bound: 1.0,
        unit: "",
        of: |row| Some(row.nees? / row.nees_high),
    },
    Score {
        groups: &GROUPS,
        id: "coverage_low",
        what: COVERAGE,
        relation: Relation::AtLeast,
        bound: 88.0,
        unit: "%",
        of: |row| percent(row.coverage),
    },
    Score {
        groups: &GROUPS,
        id: "coverage_high",
        what: COVERAGE,
        relation: Relation::AtMost,
        bound: 98.0,
        unit: "%",
        of: |row| percent(row.coverage),
    },
    Score {
        groups: &GROUPS,
        id: "early_coverage",
        what: "share of the instants of the first second of each touch at which the 95 % ellipsoid contains the true contact",
        relation: Relation::AtLeast,
        bound: 88.0,
        unit: "%",
        of: |row| percent(row.early_coverage),
    },
    Score {
        groups: &ROUND,
        id: "radius",
        what: "root mean square error of the last radius, relative to the true one",
        relation: Relation::AtMost,
        bound: 5.0,
        unit: "%",
        of: |row| percent(row.radius_error),
    },
    Score {
        groups: &ROUND,
        id: "radius_bound",
        what: "posterior Cramér–Rao bound of the relative error of the radius with an unknown object, a property of the scenes",
        relation: Relation::AtMost,
        bound: 5.0,
        unit: "%",
        of: |row| percent(row.radius_bound),
    },
    Score {
        groups: &ROUND,
        id: "radius_over_bound",
        what: "root mean square relative error of the last radius, over its posterior Cramér–Rao bound",
        relation: Relation::AtMost,
        bound: 1.3,
        unit: "",
        of: |row| Some(row.radius_error? / row.radius_bound?),
    },
    Score {
        groups: &ROUND,
        id: "radius_coverage",
        what: "replays whose 95 % interval of the last radius contains the true one",
        relation: Relation::AtLeast,
        bound: 88.0,
        unit: "%",
        of: |row| percent(row.radius_coverage),
    },
    Score {
        groups: &["box"],
        id: "edge",
        what: "mean distance of the estimated points of the surface from the touched edge",
        relation: Relation::AtMost,
        bound: 0.2,
        unit: "mm",
        of: |row| millimetres(row.edge_m),
    },
];

pub(super) fn claims() -> Vec<Claim> {
    let of_group = |whisker, group| {
        SCORES.iter().filter(move |score| score.groups.contains(&group)).map(move |score| claim(score, group, whisker))
    };
    let of_whisker = |whisker| GROUPS.into_iter().flat_map(move |group| of_group(whisker, group));
    WHISKERS.into_iter().flat_map(of_whisker).chain([time()]).collect()
}

fn claim(score: &'static Score, group: &'static str, whisker: &'static str) -> Claim {
    let about = format!("{} in space, {whisker} whisker, {RECOMMENDED}: {}", in_words(group), score.what);
    let measure = move |context: &Context| {
        let row = context
            .spatial(RUN)
            .summary
            .iter()
            .find(|row| row.group == group && row.whisker == whisker && row.estimator == RECOMMENDED);
        Ok(row.and_then(score.of))
    };
    let claim =
        Claim::at_most(format!("space_{group}_{whisker}_{}", score.id), about, score.bound, score.unit, measure);
    Claim { relation: score.relation, ..claim }
}

/// Time of a step on the machine of the run, with its other load.
fn time() -> Claim {
    Claim::at_most(
        format!("space_{RECOMMENDED}_step_p99"),
        format!("{RECOMMENDED} in space: time of a step, 99th percentile"),
        150.0,
        "µs",
        |context| {
            Ok(context.spatial(RUN).times.iter().find(|row| row.estimator == RECOMMENDED).and_then(|row| row.p99_us))
        },
    )
}

fn millimetres(length_m: Option<f64>) -> Option<f64> {
    length_m.map(|length_m| 1e3 * length_m)
}

fn degrees(angle_rad: Option<f64>) -> Option<f64> {
    angle_rad.map(f64::to_degrees)
}

fn percent(share: Option<f64>) -> Option<f64> {
    share.map(|share| 100.0 * share)
}
