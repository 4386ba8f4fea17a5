//! Contacts in space: the suite of scenes in space, and recordings of real sensors in space (`docs/REAL.md`).

use std::path::PathBuf;

use recorded::benchmark::{PinSummary, SweepScore};
use testbed::results::read_rows;
use testbed::space::SpatialRun;
use testbed::space::evaluate::SpatialSummaryRow;

use super::{Claim, Context, RECOMMENDED, WHISKERS, real, worst};

/// Run of the suite.
const RUN: &str = "spatial";

/// Groups of the suite.
const GROUPS: [&str; 8] = ["pins", "edges", "box", "mesh", "cylinders", "cone", "sphere_20", "sphere_60"];

/// Groups with a radius.
const ROUND: [&str; 3] = ["cylinders", "sphere_20", "sphere_60"];

/// Tables of the recordings in space.
const PINS: &str = "space_pins_summary.csv";
const SWEEPS: &str = "space_sweeps.csv";

/// Estimator of the pins of the recordings.
const BATCH: &str = "fixed-point-batch";

/// Groups of these pins, and the bound on their mean error (mm). Trials on another day than that of the calibration have an unknown
/// shift of the sensor.
const REAL_PINS: [(&str, &str, f64); 6] = [
    ("curved_first", "left-out lines, curved_calib_May_22", 0.5),
    ("curved_second", "left-out lines, curved_calib_May_22_try2", 0.5),
    ("sensor_1", "left-out lines, sensor1_tip_calib_May_04", 0.5),
    ("straight", "left-out lines, straight_calib_May_20", 0.5),
    ("same_day", "pins, tip_test_05_22_23_try2", 0.3),
    ("mounting_learnt", "pins, tip_test_05_24_23, mounting learnt", 0.3),
];

/// Objects of the sweeps; their names begin with `reference_`.
const REAL_OBJECTS: [&str; 7] = ["double_square", "surface", "cylinder", "cylinder_sandpaper", "cone", "step", "star"];

pub(super) fn claims() -> Vec<Claim> {
    let suite =
        WHISKERS.into_iter().flat_map(|whisker| GROUPS.into_iter().flat_map(move |group| of_group(group, whisker)));
    let recordings = real_pins().into_iter().chain(real_sweeps());
    suite.chain(times()).chain(recordings.map(|claim| claim.if_there_are(has_recordings))).collect()
}

/// A score of `recommended` on one group with one whisker.
fn score(
    group: &'static str,
    whisker: &'static str,
    of: fn(&SpatialSummaryRow) -> Option<f64>,
) -> impl Fn(&Context) -> anyhow::Result<Option<f64>> {
    move |context| {
        let summary = SpatialRun::summary(&context.results.join(RUN))?;
        let row =
            summary.iter().find(|row| row.group == group && row.whisker == whisker && row.estimator == RECOMMENDED);
        Ok(row.and_then(of))
    }
}

fn of_group(group: &'static str, whisker: &'static str) -> Vec<Claim> {
    let id = |what: &str| format!("space_{group}_{whisker}_{what}");
    let about = |what: &str| format!("{group} in space, {whisker} whisker, {RECOMMENDED}: {what}");
    let mut claims = vec![
        Claim::at_most(
            id("normal"),
            about("root mean square angle between estimated and true normal"),
            2.0,
            "degrees",
            score(group, whisker, |row| row.normal_rad.map(f64::to_degrees)),
        ),
        Claim::at_least(
            id("coverage_low"),
            about("share of the instants at which the 95 % ellipsoid contains the true contact"),
            88.0,
            "%",
            score(group, whisker, |row| row.coverage.map(|share| 100.0 * share)),
        ),
        Claim::at_most(
            id("coverage_high"),
            about("share of the instants at which the 95 % ellipsoid contains the true contact"),
            98.0,
            "%",
            score(group, whisker, |row| row.coverage.map(|share| 100.0 * share)),
        ),
    ];
    if ROUND.contains(&group) {
        claims.push(Claim::at_most(
            id("radius"),
            about("root mean square error of the last radius, relative to the true one"),
            5.0,
            "%",
            score(group, whisker, |row| row.radius_error.map(|error| 100.0 * error)),
        ));
        claims.push(Claim::at_least(
            id("radius_coverage"),
            about("replays whose 95 % interval of the last radius contains the true one"),
            88.0,
            "%",
            score(group, whisker, |row| row.radius_coverage.map(|share| 100.0 * share)),
        ));
    }
    if group == "box" {
        claims.push(Claim::at_most(
            id("edge"),
            about("mean distance of the estimated points of the surface from the touched edge"),
            0.2,
            "mm",
            score(group, whisker, |row| row.edge_m.map(|distance_m| 1e3 * distance_m)),
        ));
    }
    claims
}

/// Time of a step on the machine of the run, with its other load.
fn times() -> Vec<Claim> {
    vec![Claim::at_most(
        format!("space_{RECOMMENDED}_step_p99"),
        format!("{RECOMMENDED} in space: time of a step, 99th percentile"),
        150.0,
        "us",
        |context| {
            let times = SpatialRun::times(&context.results.join(RUN))?;
            Ok(times.iter().find(|row| row.estimator == RECOMMENDED).and_then(|row| row.p99_us))
        },
    )]
}

/// Whether the tables of the recordings in space are there.
fn has_recordings(context: &Context) -> bool {
    [PINS, SWEEPS].iter().all(|table| folder(context).join(table).is_file())
}

fn folder(context: &Context) -> PathBuf {
    context.results.join(real::RUN)
}

fn real_pins() -> Vec<Claim> {
    let claims = REAL_PINS.into_iter().flat_map(|(name, group, bound_mm)| {
        let score = move |of: fn(&PinSummary) -> f64| {
            move |context: &Context| {
                let rows: Vec<PinSummary> = read_rows(&folder(context).join(PINS))?;
                Ok(rows.iter().find(|row| row.group == group && row.estimator == BATCH).map(of))
            }
        };
        let about = format!("real pins in space, {group}, {BATCH}");
        [
            Claim::at_most(
                format!("real_space_pins_{name}_mean"),
                format!("{about}: mean error"),
                bound_mm,
                "mm",
                score(|row| 1e3 * row.mean_m),
            ),
            Claim::at_least(
                format!("real_space_pins_{name}_answered"),
                format!("{about}: share of the readings with an estimate"),
                95.0,
                "%",
                score(|row| 100.0 * row.answered),
            ),
            Claim::at_least(
                format!("real_space_pins_{name}_coverage"),
                format!("{about}: coverage of the 95 % ellipsoids"),
                88.0,
                "%",
                score(|row| 100.0 * row.coverage),
            ),
        ]
    });
    claims.collect()
}

fn real_sweeps() -> Vec<Claim> {
    let claims = REAL_OBJECTS.into_iter().flat_map(|object| {
        let score = move |of: fn(&SweepScore) -> Option<f64>| {
            move |context: &Context| {
                let rows: Vec<SweepScore> = read_rows(&folder(context).join(SWEEPS))?;
                Ok(worst(
                    rows.iter()
                        .filter(|row| row.object.strip_prefix("reference_") == Some(object))
                        .map(|row| Some(1e3 * of(row)?)),
                ))
            }
        };
        let about = format!("real sweeps in space over the object {object}, largest of the sweeps");
        [
            Claim::at_most(
                format!("real_space_sweeps_{object}_mean"),
                format!("{about}: mean distance from the mesh as recorded"),
                0.5,
                "mm",
                score(|row| row.mean_m),
            ),
            Claim::at_most(
                format!("real_space_sweeps_{object}_shifted_mean"),
                format!("{about}: mean distance from the mesh after one shift of the object"),
                0.2,
                "mm",
                score(|row| row.shifted_mean_m),
            ),
        ]
    });
    claims.collect()
}
