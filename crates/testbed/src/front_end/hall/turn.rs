//! The published trial of the earth's field: the sensor at rest is turned by half a circle, and back.

use std::f64::consts::PI;

use trace::SensorFile;

use super::{Board, Mounting};
use crate::results::TurnRow;
use crate::statistics::mean;

const RATE_HZ: f64 = 250.0;
/// How long the sensor stands still before, between and after the turns, and how long a turn takes.
const STILL_S: f64 = 4.0;
const TURN_S: f64 = 2.0;
/// Seed of the noise.
const SEED: u64 = 1;

/// Counts from zero during the trial, of the only sensor of a board, with and without compensation.
pub(super) fn rows(board: &Board, mounting: &Mounting, sensor: &SensorFile) -> Vec<TurnRow> {
    let dt_s = 1.0 / RATE_HZ;
    let mut watch = board.watch(mounting, SEED);
    let rest = watch.rest(0, super::samples_in(board.config.zeroing_s, dt_s), dt_s, 0.0);
    let own_zero = mean(rest.iter().map(|counts| counts.own)).unwrap_or(0.0);
    let zero = mean(rest.iter().map(|counts| counts.compensated(sensor.common_mode))).unwrap_or(0.0);
    let samples = ((3.0 * STILL_S + 2.0 * TURN_S) * RATE_HZ) as usize;
    let row = |i: usize| {
        let t_s = i as f64 * dt_s;
        let yaw_rad = yaw_rad(t_s);
        let counts = watch.read(dt_s, &[0.0], yaw_rad)[0];
        TurnRow {
            t_s,
            yaw_rad,
            counts: counts.own - own_zero,
            compensated_counts: counts.compensated(sensor.common_mode) - zero,
        }
    };
    (0..samples).map(row).collect()
}

/// Still, half a circle as a smooth step, still, back, still.
fn yaw_rad(t_s: f64) -> f64 {
    let share = |from_s: f64| ((t_s - from_s) / TURN_S).clamp(0.0, 1.0);
    let smooth = |share: f64| 0.5 * (1.0 - (PI * share).cos());
    PI * (smooth(share(STILL_S)) - smooth(share(2.0 * STILL_S + TURN_S)))
}

/// By how much the counts are shifted while the sensor stands turned by half a circle, against the mean before and after, which takes a steady drift out.
/// Nothing where it never stands still.
pub fn shift_counts(rows: &[TurnRow], counts: impl Fn(&TurnRow) -> f64) -> Option<f64> {
    let standing = |yaw_rad: f64| {
        let still = rows.iter().filter(move |row| (row.yaw_rad - yaw_rad).abs() < 1e-9);
        mean(still.map(&counts))
    };
    Some((standing(PI)? - standing(0.0)?).abs())
}
