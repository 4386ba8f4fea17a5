//! Recordings of real sensors: pins with right and wrong priors, and the cylinder. The recordings are not part of the
//! project; `docs/REAL.md` states their source.

use std::collections::BTreeMap;

use testbed::metrics::rows;
use testbed::results::{ContourTrialRow, TrialRow};
use testbed::statistics::{mean, median_of_scores};
use trace::ObjectClass;

use super::{Claim, Context, Evaluation, RECOMMENDED};

/// Dataset and run.
pub(crate) const RUN: &str = "stanford";

/// Groups of the pin trials by their prior of the first contact.
const PINS: [(&str, &str); 2] = [("undeflected", "real pins"), ("wrong", "real pins, wrong prior")];

/// Group of the sweeps over objects.
const OBJECTS: &str = "real objects";

/// Error after the first third of the contact beyond which a trial counts as diverged.
const DIVERGED_M: f64 = 1e-3;

/// Whether a run has every group that the claims need.
pub(super) fn is_whole(run: &Evaluation) -> bool {
    let groups = PINS.iter().map(|(_, group)| *group).chain([OBJECTS]);
    groups.into_iter().all(|group| run.run.sets.iter().any(|set| set.group == group))
}

pub(super) fn claims() -> Vec<Claim> {
    let pins = PINS.into_iter().flat_map(|(start, group)| pins(start, group));
    pins.chain([RECOMMENDED, "outline"].into_iter().flat_map(cylinder))
        .map(|claim| claim.if_there_are(|context| context.recordings.is_some()))
        .collect()
}

fn pins(start: &str, group: &'static str) -> Vec<Claim> {
    let about = format!("{group}, {RECOMMENDED}");
    let trials = move |context: &Context| -> Vec<TrialRow> {
        let trials = context.recordings.iter().flat_map(|run| &run.trials);
        trials.filter(|row| row.head.group == group && row.head.estimator == RECOMMENDED).cloned().collect()
    };
    vec![
        Claim::at_most(
            format!("real_pins_{start}_late_mean"),
            format!("{about}: mean error after the first third of the contact, mean over trials"),
            0.18,
            "mm",
            move |context| {
                let errors_m: Option<Vec<f64>> = trials(context).iter().map(|row| row.get(&rows::LATE_MEAN)).collect();
                Ok(errors_m.and_then(mean).map(|error_m| 1e3 * error_m))
            },
        ),
        Claim::at_most(
            format!("real_pins_{start}_rows_to_1mm"),
            format!("{about}: rows until the error is below 1 mm, median over trials"),
            7.0,
            "rows",
            move |context| Ok(median_of_scores(trials(context).iter().map(|row| row.get(&rows::ROWS_TO_1MM)))),
        ),
        Claim::at_most(
            format!("real_pins_{start}_diverged"),
            format!("{about}: trials whose error exceeds 1 mm after the first third of the contact"),
            0.0,
            "%",
            move |context| {
                let diverged = |row: &TrialRow| row.get(&rows::LATE_WORST).is_none_or(|worst_m| worst_m > DIVERGED_M);
                Ok(mean(trials(context).iter().map(|row| 100.0 * f64::from(diverged(row)))))
            },
        ),
    ]
}

fn cylinder(estimator: &'static str) -> Vec<Claim> {
    let about = format!("real cylinders, {estimator}, circle through the outline of each sweep");
    vec![
        Claim::at_most(
            format!("real_cylinder_{estimator}_residual"),
            format!("{about}: root mean square distance of the outline from it, largest of the sweeps"),
            0.2,
            "mm",
            move |context| {
                let residuals_m: Option<Vec<f64>> =
                    sweeps(context, estimator).iter().map(|row| row.residual_rms_m).collect();
                Ok(residuals_m.and_then(|all| all.into_iter().reduce(f64::max)).map(|residual_m| 1e3 * residual_m))
            },
        ),
        Claim::at_least(
            format!("real_cylinder_{estimator}_radius_stated"),
            format!("{about}: sweeps with a radius and both ends of its interval"),
            100.0,
            "%",
            move |context| {
                Ok(mean(sweeps(context, estimator).iter().map(|row| 100.0 * f64::from(row.radius_high_m.is_some()))))
            },
        ),
        Claim::at_most(
            format!("real_cylinder_{estimator}_radius_agrees"),
            format!("{about}: gap between the intervals of the radius of two sweeps over the same object, largest"),
            0.0,
            "mm",
            move |context| Ok(largest_gap_m(&sweeps(context, estimator)).map(|gap_m| 1e3 * gap_m)),
        ),
    ]
}

/// Sweeps over round objects, for one estimator.
fn sweeps(context: &Context, estimator: &str) -> Vec<ContourTrialRow> {
    let Some(run) = &context.recordings else { return Vec::new() };
    let objects: Vec<_> = run.run.sets.iter().filter(|set| set.group == OBJECTS).collect();
    let is_round = |row: &&ContourTrialRow| {
        let set = objects.iter().find(|set| set.group == row.group && set.whisker == row.whisker);
        set.is_some_and(|set| set.class_of(&row.object) == ObjectClass::Round)
    };
    run.contours.iter().filter(|row| row.estimator == estimator).filter(is_round).cloned().collect()
}

/// Largest gap between the radius intervals of two sweeps over one object (m), negative if all overlap. `None` if a
/// sweep has no radius, or if no interval has an upper end: those agree whatever the radii.
fn largest_gap_m(sweeps: &[ContourTrialRow]) -> Option<f64> {
    let mut ends: BTreeMap<&str, (f64, f64)> = BTreeMap::new();
    for row in sweeps {
        let (low_m, high_m) = (row.radius_low_m?, row.radius_high_m.unwrap_or(f64::INFINITY));
        let of_object = ends.entry(&row.object).or_insert((low_m, high_m));
        *of_object = (of_object.0.max(low_m), of_object.1.min(high_m));
    }
    ends.values().map(|(low_m, high_m)| low_m - high_m).reduce(f64::max).filter(|gap_m| gap_m.is_finite())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn verif_intervals_that_overlap_have_no_gap() {
        let sweep = |object: &str, low_m, high_m| ContourTrialRow {
            object: object.into(),
            radius_low_m: low_m,
            radius_high_m: high_m,
            ..ContourTrialRow::default()
        };
        let agreeing =
            [sweep("a", Some(1.0), Some(3.0)), sweep("a", Some(2.0), None), sweep("b", Some(9.0), Some(9.5))];
        assert_eq!(largest_gap_m(&agreeing), Some(-0.5));
        assert_eq!(largest_gap_m(&[sweep("a", Some(1.0), Some(2.0)), sweep("a", Some(3.0), Some(4.0))]), Some(1.0));
        assert_eq!(largest_gap_m(&[sweep("a", None, None)]), None);
        assert_eq!(largest_gap_m(&[sweep("a", Some(1.0), None), sweep("a", Some(2.0), None)]), None);
    }
}
