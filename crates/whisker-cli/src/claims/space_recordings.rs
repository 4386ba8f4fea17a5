//! Contacts in space from recordings of real sensors (`docs/REAL.md`).

use std::collections::BTreeMap;
use std::path::PathBuf;

use recorded::benchmark::{FIXED, FaceScore, MapScore, PAPER, PinSummary, SweepScore};
use serde::de::DeserializeOwned;
use testbed::results::read_rows;

use super::{Claim, Context, Relation, worst};

/// Folder of the tables.
const RUN: &str = "recordings";

const MAPS: &str = "space_maps.csv";
const PINS: &str = "space_pins_summary.csv";
const SWEEPS: &str = "space_sweeps.csv";
const FACES: &str = "space_faces.csv";

/// Name of the sensor model.
const MODEL: &str = "gaussian-process";

/// Calibrations, and the bound on the error of the sensor model on held-out lines (%).
const REAL_MAPS: [(&str, &str, f64); 3] = [
    ("sensor_1", "sensor1_tip_calib_May_04", 0.8),
    ("curved_first", "curved_calib_May_22", 1.4),
    ("curved_second", "curved_calib_May_22_try2", 1.4),
];

/// A group of pins.
struct Pins {
    /// Short name.
    id: &'static str,
    /// Name in the table.
    group: &'static str,
    /// Which error of the pins is bounded.
    error: Error,
    /// Its bound (mm).
    bound_mm: f64,
    /// Whether the pins are held-out lines of a calibration.
    are_lines: bool,
}

/// A pin's mean error, over the pins of a group.
#[derive(Clone, Copy)]
enum Error {
    Mean,
    Median,
}

/// Groups of pins. Trials on another day than that of the calibration have an unknown shift of the sensor.
const REAL_PINS: &[Pins] = &[
    Pins {
        id: "curved_first",
        group: "held-out lines, curved_calib_May_22",
        error: Error::Median,
        bound_mm: 0.3,
        are_lines: true,
    },
    Pins {
        id: "curved_second",
        group: "held-out lines, curved_calib_May_22_try2",
        error: Error::Median,
        bound_mm: 0.3,
        are_lines: true,
    },
    Pins {
        id: "sensor_1",
        group: "held-out lines, sensor1_tip_calib_May_04",
        error: Error::Mean,
        bound_mm: 0.15,
        are_lines: true,
    },
    Pins {
        id: "straight",
        group: "held-out lines, straight_calib_May_20",
        error: Error::Mean,
        bound_mm: 0.15,
        are_lines: true,
    },
    Pins {
        id: "same_day",
        group: "pins, tip_test_05_22_23_try2",
        error: Error::Mean,
        bound_mm: 0.18,
        are_lines: false,
    },
    Pins {
        id: "mounting_learnt",
        group: "pins, tip_test_05_24_23, mounting learnt",
        error: Error::Mean,
        bound_mm: 0.25,
        are_lines: false,
    },
];

/// Largest error of a reading on held-out lines (mm).
const WORST_MM: f64 = 1.5;

/// Factor by which the errors of the published filter exceed those of the batch.
const BEATEN: f64 = 2.0;

/// A score of the sweeps over an object, the worst of the sweeps.
struct Sweeps {
    /// Short name, unique.
    id: &'static str,
    /// The score in words.
    what: &'static str,
    relation: Relation,
    unit: &'static str,
    /// The score in this unit.
    of: fn(&SweepScore) -> Option<f64>,
    /// Objects, whose names begin with `reference_`, and the bound.
    bounds: &'static [(&'static str, f64)],
}

const REAL_SWEEPS: &[Sweeps] = &[
    Sweeps {
        id: "mean",
        what: "mean distance from the mesh as recorded",
        relation: Relation::AtMost,
        unit: "mm",
        of: |row| millimetres(row.mean_m),
        bounds: &[
            ("double_square", 0.15),
            ("surface", 0.3),
            ("cylinder", 0.22),
            ("cylinder_sandpaper", 0.22),
            ("cone", 0.35),
        ],
    },
    Sweeps {
        id: "p95",
        what: "95th percentile of the distance from the mesh as recorded",
        relation: Relation::AtMost,
        unit: "mm",
        of: |row| millimetres(row.p95_m),
        bounds: &[("star", 1.5)],
    },
    Sweeps {
        id: "shifted_mean",
        what: "mean distance from the mesh after one shift of the object",
        relation: Relation::AtMost,
        unit: "mm",
        of: |row| millimetres(row.shifted_mean_m),
        bounds: &[
            ("double_square", 0.1),
            ("surface", 0.2),
            ("cylinder", 0.1),
            ("cylinder_sandpaper", 0.1),
            ("cone", 0.1),
            ("step", 0.2),
            ("star", 0.2),
        ],
    },
    Sweeps {
        id: "reach",
        what: "share of the rows in contact with a contact within reach of the whisker",
        relation: Relation::AtLeast,
        unit: "%",
        of: |row| Some(100.0 * row.reach?),
        bounds: &[
            ("double_square", 97.0),
            ("surface", 97.0),
            ("cylinder", 97.0),
            ("cylinder_sandpaper", 97.0),
            ("cone", 97.0),
            ("step", 97.0),
            ("star", 97.0),
        ],
    },
    Sweeps {
        id: "extent",
        what: "length of the part of the mesh that the contacts cover",
        relation: Relation::AtLeast,
        unit: "mm",
        of: |row| millimetres(row.extent_m),
        bounds: &[
            ("double_square", 20.0),
            ("surface", 45.0),
            ("cylinder", 20.0),
            ("cylinder_sandpaper", 20.0),
            ("cone", 16.0),
        ],
    },
];

pub(super) fn claims() -> Vec<Claim> {
    let sweeps =
        REAL_SWEEPS.iter().flat_map(|score| score.bounds.iter().map(|&(object, bound)| sweep(score, object, bound)));
    let claims = REAL_MAPS.into_iter().map(map).chain(REAL_PINS.iter().flat_map(pins)).chain(sweeps).chain([step()]);
    claims.map(|claim| claim.if_there_are(has_recordings)).collect()
}

/// Whether the tables of the recordings in space are there.
fn has_recordings(context: &Context) -> bool {
    [MAPS, PINS, SWEEPS, FACES].iter().all(|table| folder(context).join(table).is_file())
}

fn folder(context: &Context) -> PathBuf {
    context.results.join(RUN)
}

fn rows<Row: DeserializeOwned>(context: &Context, table: &str) -> anyhow::Result<Vec<Row>> {
    read_rows(&folder(context).join(table))
}

fn map((id, calibration, bound): (&'static str, &'static str, f64)) -> Claim {
    Claim::at_most(
        format!("real_space_maps_{id}"),
        format!("real sensor model in space, {calibration}, {MODEL}: RMSE on held-out lines, of the largest reading"),
        bound,
        "%",
        move |context| {
            let rows: Vec<MapScore> = rows(context, MAPS)?;
            let row = rows.iter().find(|row| row.calibration == calibration && row.model == MODEL);
            Ok(row.map(|row| 100.0 * row.heldout_rms))
        },
    )
}

fn pins(pins: &'static Pins) -> Vec<Claim> {
    let &Pins { id, group, error, bound_mm, are_lines } = pins;
    let summary = move |context: &Context, estimator: &str| {
        let rows: Vec<PinSummary> = rows(context, PINS)?;
        anyhow::Ok(rows.into_iter().find(|row| row.group == group && row.estimator == estimator))
    };
    let score = |of: fn(&PinSummary) -> f64| move |context: &Context| Ok(summary(context, FIXED)?.as_ref().map(of));
    let id = |what: &str| format!("real_space_pins_{id}_{what}");
    let about = |what: &str| format!("real pins in space, {group}, {FIXED}: {what}");
    let answered = about("share of the readings with an estimate");
    let coverage = about("coverage of the 95 % ellipsoids");
    let nees = about("NEES per degree of freedom");
    let mut claims = vec![
        match error {
            Error::Mean => {
                Claim::at_most(id("mean"), about("mean error"), bound_mm, "mm", score(|row| 1e3 * row.mean_m))
            }
            Error::Median => {
                let what = about("median over the pins of their mean errors");
                Claim::at_most(id("median"), what, bound_mm, "mm", score(|row| 1e3 * row.median_m))
            }
        },
        Claim::at_least(id("answered"), answered, 95.0, "%", score(|row| 100.0 * row.answered)),
        Claim::at_least(id("coverage"), coverage.clone(), 88.0, "%", score(|row| 100.0 * row.coverage)),
        Claim::at_most(id("coverage_high"), coverage, 98.0, "%", score(|row| 100.0 * row.coverage)),
        Claim::at_least(id("nees_low"), nees.clone(), 0.5, "", score(|row| row.nees)),
        Claim::at_most(id("nees_high"), nees, 2.0, "", score(|row| row.nees)),
        Claim::at_least(
            id("beaten"),
            about(&format!("factor by which the mean error of {PAPER} is larger")),
            BEATEN,
            "",
            move |context| {
                let mean = |estimator| anyhow::Ok(summary(context, estimator)?.map(|row| row.mean_m));
                Ok(mean(PAPER)?.zip(mean(FIXED)?).map(|(theirs, ours)| theirs / ours))
            },
        ),
    ];
    if are_lines {
        let what = about("largest error of a reading");
        claims.push(Claim::at_most(id("worst"), what, WORST_MM, "mm", score(|row| 1e3 * row.worst_m)));
    }
    claims
}

fn sweep(score: &'static Sweeps, object: &'static str, bound: f64) -> Claim {
    let about = format!("real sweeps in space over the object {object}, worst of the sweeps: {}", score.what);
    let measure = move |context: &Context| {
        let rows: Vec<SweepScore> = rows(context, SWEEPS)?;
        let of_object = rows.iter().filter(|row| row.object.strip_prefix("reference_") == Some(object));
        // Of scores that are at least the bound, the worst is the smallest.
        let sign = if score.relation == Relation::AtMost { 1.0 } else { -1.0 };
        Ok(worst(of_object.map(|row| Some(sign * (score.of)(row)?))).map(|value| sign * value))
    };
    let claim = Claim::at_most(format!("real_space_sweeps_{object}_{}", score.id), about, bound, score.unit, measure);
    Claim { relation: score.relation, ..claim }
}

/// Distances on both faces of the step that point to the sensor. `None` if a sweep has too few contacts on one of them.
fn step() -> Claim {
    const FACES_OF_STEP: usize = 2;
    /// Largest entry along y of the normal of such a face: the sensor lies on the side of negative y.
    const TO_SENSOR: f64 = -0.9;
    Claim::at_most(
        "real_space_sweeps_step_faces".into(),
        "real sweeps in space over the object step, worst of both faces and of the sweeps: mean distance from the mesh as \
         recorded"
            .into(),
        0.6,
        "mm",
        |context| {
            let rows: Vec<FaceScore> = rows(context, FACES)?;
            let mut by_sweep: BTreeMap<&str, Vec<f64>> = BTreeMap::new();
            for row in rows.iter().filter(|row| row.object == "reference_step" && row.normal_y < TO_SENSOR) {
                by_sweep.entry(&row.name).or_default().push(1e3 * row.mean_m);
            }
            let of_sweep = |faces: Vec<f64>| {
                let are_both = faces.len() >= FACES_OF_STEP;
                faces.into_iter().reduce(f64::max).filter(|_| are_both)
            };
            Ok(worst(by_sweep.into_values().map(of_sweep)))
        },
    )
}

fn millimetres(length_m: Option<f64>) -> Option<f64> {
    length_m.map(|length_m| 1e3 * length_m)
}
