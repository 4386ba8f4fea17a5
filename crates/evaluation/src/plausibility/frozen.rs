//! Readings that stay the same while a touched whisker moves, as of a sensor or a driver that has stopped.

use nalgebra::{SVector, Vector1, Vector3};
use trace::SpatialTrace;
use whisker::frames::Point;

use super::moment::{bending, largest_bending};
use super::{Finding, Subject, median};

/// Smallest duration (s), number of rows, way of the whisker's middle (m) and share of the largest moment at which equal readings
/// are a finding.
const DURATION_S: f64 = 0.2;
const ROWS: usize = 10;
const WAY_M: f64 = 2e-3;
const LOADED: f64 = 0.05;

/// Largest median change from row to row, relative to the smallest moment of a finding, at which equal readings are one: those of a
/// coarse sensor may be equal for long.
const FINE: f64 = 0.4;

/// A row: time (s), middle of the undeflected whisker in World (m), and the moments (N m).
struct Row<const M: usize> {
    t_s: f64,
    middle_m: Vector3<f64>,
    moments_n_m: SVector<f64, M>,
}

/// Compares the readings in the plane with those before.
pub(super) fn readings(subject: &Subject<'_>) -> Vec<Finding> {
    let half_m = 0.5 * subject.trace.sidecar.whisker.length_m;
    let rows = subject.instants().iter().map(|now| {
        let middle = now.base.apply(Point::new(half_m, 0.0));
        Row {
            t_s: now.t_s,
            middle_m: Vector3::new(middle.x(), middle.y(), 0.0),
            moments_n_m: Vector1::new(now.moment_z_n_m),
        }
    });
    found("moment_z_n_m", rows, LOADED * subject.largest_n_m).into_iter().collect()
}

/// The same in space.
pub(super) fn readings_in_space(trace: &SpatialTrace) -> Option<Finding> {
    let half = Vector3::x() * (0.5 * trace.sidecar.whisker.length_m);
    let rows = trace.recording.instants.iter().map(|now| Row {
        t_s: now.t_s,
        middle_m: now.base.position + now.base.rotation * half,
        moments_n_m: bending(now),
    });
    found("moment_y_n_m, moment_z_n_m", rows, LOADED * largest_bending(trace))
}

/// The first run of rows with equal moments that exceeds these limits.
fn found<const M: usize>(place: &'static str, rows: impl Iterator<Item = Row<M>>, least_n_m: f64) -> Option<Finding> {
    let rows: Vec<Row<M>> = rows.collect();
    if step_n_m(&rows).is_none_or(|step_n_m| step_n_m > FINE * least_n_m) {
        return None;
    }
    // Not the length of the path, to which errors of the poses add.
    let way_m = |run: &[Row<M>]| run.iter().map(|row| (row.middle_m - run[0].middle_m).norm()).fold(0.0, f64::max);
    let is_frozen = |run: &&[Row<M>]| {
        let duration_s = run[run.len() - 1].t_s - run[0].t_s;
        let is_loaded = run[0].moments_n_m.norm() > least_n_m;
        duration_s >= DURATION_S && run.len() >= ROWS && way_m(run) >= WAY_M && is_loaded
    };
    let run = rows.chunk_by(|one, other| one.moments_n_m == other.moments_n_m).find(is_frozen)?;
    let (first_s, last_s) = (run[0].t_s, run[run.len() - 1].t_s);
    Some(Finding {
        place,
        found: format!(
            "{} equal readings from {first_s:.3} s to {last_s:.3} s, while the whisker moves by {:.1} mm",
            run.len(),
            1e3 * way_m(run)
        ),
        expected: "readings of a touched whisker that change as it moves".into(),
        looks_like:
            "the sensor or its driver stopped for this time, or its readings are saturated; leave these rows out".into(),
    })
}

/// Median size of the changes from row to row, which for a coarse sensor is its resolution. `None` if there are none.
fn step_n_m<const M: usize>(rows: &[Row<M>]) -> Option<f64> {
    let changes = rows.windows(2).map(|pair| (pair[1].moments_n_m - pair[0].moments_n_m).norm());
    median(&mut changes.filter(|change| *change > 0.0).collect::<Vec<_>>())
}
