//! Table of a trace, with a sidecar of matching row count and hash.

use std::ops::Range;

use files::sha256;
use serde_json::json;
use trace::{COLUMNS, FRICTION_COLUMNS, SECOND_COLUMNS, Trace, YIELDING_COLUMNS};

use crate::properties::{is_decimal, lines, one_error};
use crate::{golden, scratch};

pub(super) fn run(bytes: &[u8]) {
    let Some(trace) = read("untrusted", bytes) else { return };
    assert_values_match_the_text(bytes, &trace);
    let is_fine = |pair: &[trace::Instant]| pair[1].t_s - pair[0].t_s < 2e-6;
    if trace.recording.instants.windows(2).any(is_fine) {
        // Time steps below the resolution of the written times.
        return;
    }
    let text = trace.to_csv();
    let again = read("again", text.as_bytes()).expect("written data can be read");
    assert_eq!(again.to_csv(), text);
    for (row, again) in rows(&trace).zip(rows(&again)) {
        for ((value, again), (column, decimals)) in row.into_iter().zip(again).zip(columns()) {
            let half = 0.5 * 10f64.powi(-(decimals as i32));
            let is_near = value
                .zip(again)
                .is_none_or(|(value, again)| (value - again).abs() <= 1.001 * half + 1e-15 * value.abs());
            assert!(value.is_some() == again.is_some() && is_near, "{column}: {value:?} became {again:?}");
        }
    }
}

fn read(name: &str, csv: &[u8]) -> Option<Trace> {
    let mut sidecar = golden::sidecar();
    sidecar["name"] = json!(name);
    sidecar["rows"] = json!(lines(csv).len().saturating_sub(1));
    sidecar["csv_sha256"] = json!(sha256(csv));
    scratch::file(&format!("{name}.json"), sidecar.to_string());
    one_error(Trace::read(&scratch::file(&format!("{name}.csv"), csv)), name)
}

fn assert_values_match_the_text(bytes: &[u8], trace: &Trace) {
    let lines = &lines(bytes)[1..];
    assert_eq!(lines.len(), trace.recording.instants.len());
    for (line, row) in lines.iter().zip(rows(trace)) {
        let line = std::str::from_utf8(line).expect("numbers are ASCII");
        let cells: Vec<&str> = line.split(',').collect();
        let further = match cells.len() - COLUMNS.len() {
            0 => 0..0,
            count if count == FRICTION_COLUMNS.len() => OF_FRICTION,
            count if count == SECOND_COLUMNS.len() => OF_SECOND,
            count => {
                assert_eq!(count, YIELDING_COLUMNS.len());
                OF_YIELDING
            }
        };
        for (i, (value, (column, _))) in row.into_iter().zip(columns()).enumerate() {
            let cell = if i < COLUMNS.len() {
                cells[i]
            } else if further.contains(&i) {
                cells[COLUMNS.len() + i - further.start]
            } else {
                ""
            };
            match value {
                None => assert_eq!(cell, "", "{column}"),
                Some(value) => {
                    assert!(is_decimal(cell) && cell.parse() == Ok(value), "{column}: read {value} from `{cell}`")
                }
            }
        }
    }
}

/// Places of the columns of friction, of the second contact and of an object that gives way among all columns.
const OF_FRICTION: Range<usize> = COLUMNS.len()..COLUMNS.len() + FRICTION_COLUMNS.len();
const OF_SECOND: Range<usize> = OF_FRICTION.end..OF_FRICTION.end + SECOND_COLUMNS.len();
const OF_YIELDING: Range<usize> = OF_SECOND.end..OF_SECOND.end + YIELDING_COLUMNS.len();

/// All columns. A table has at most those of friction, those of the second contact or those of an object that gives way.
fn columns() -> impl Iterator<Item = (&'static str, usize)> {
    COLUMNS.into_iter().chain(FRICTION_COLUMNS).chain(SECOND_COLUMNS).chain(YIELDING_COLUMNS)
}

/// Values of each row in column order, `None` in columns that the table does not have. Independent of the crate under test.
fn rows(trace: &Trace) -> impl Iterator<Item = [Option<f64>; OF_YIELDING.end]> {
    let flag = |value: Option<bool>| value.map(|value| f64::from(u8::from(value)));
    trace.recording.instants.iter().zip(&trace.truth.instants).map(move |(known, truth)| {
        let origin = known.base.origin();
        [
            Some(known.t_s),
            Some(origin.x()),
            Some(origin.y()),
            Some(known.base.yaw_rad()),
            known.twist.map(|twist| twist.vx_m_s),
            known.twist.map(|twist| twist.vy_m_s),
            known.twist.map(|twist| twist.wz_rad_s),
            Some(known.moment_z_n_m),
            known.rotation_z_rad,
            flag(truth.touching),
            flag(truth.tip),
            flag(truth.split),
            truth.contact.map(|point| point.x()),
            truth.contact.map(|point| point.y()),
            truth.surface.map(|point| point.x()),
            truth.surface.map(|point| point.y()),
            truth.arc_m,
            truth.force_n,
            truth.tangent_rad,
            truth.friction.map(|friction| friction.angle_rad),
            truth.friction.map(|friction| friction.slip_m_s),
            flag(truth.friction.map(|friction| friction.sticking)),
            truth.second.map(|second| second.contact.x()),
            truth.second.map(|second| second.contact.y()),
            truth.second.map(|second| second.surface.x()),
            truth.second.map(|second| second.surface.y()),
            truth.second.map(|second| second.arc_m),
            truth.second.map(|second| second.force_n),
            truth.yielding.map(|given| given.moved_m[0]),
            truth.yielding.map(|given| given.moved_m[1]),
            truth.yielding.map(|given| given.yaw_rad),
            truth.yielding.map(|given| given.indentation_m),
        ]
    })
}
