//! Published test of the earth's field: the sensor at rest is rotated by 180 degrees and back.

use std::f64::consts::PI;

use trace::SensorFile;

use super::board::{Board, samples_in};
use crate::front_end::mounting::Mounting;
use crate::results::TurnRow;
use crate::statistics::mean;

const RATE_HZ: f64 = 250.0;
/// Time at rest before, between and after the rotations, and duration of a rotation.
const STILL_S: f64 = 4.0;
const TURN_S: f64 = 2.0;
/// Seed of the noise.
const SEED: u64 = 1;

/// Zeroed counts during the test, with and without compensation, of the only sensor of a board.
pub(super) fn rows(board: &Board, mounting: &Mounting, sensor: &SensorFile) -> Vec<TurnRow> {
    let dt_s = 1.0 / RATE_HZ;
    let mut reader = board.reader(mounting, SEED);
    let rest = reader.rest(0, samples_in(board.config.zeroing_s, dt_s), dt_s, 0.0);
    let own_zero = mean(rest.iter().map(|counts| counts.own)).unwrap_or(0.0);
    let zero = mean(rest.iter().map(|counts| counts.compensated(sensor.common_mode))).unwrap_or(0.0);
    let samples = ((3.0 * STILL_S + 2.0 * TURN_S) * RATE_HZ) as usize;
    let row = |i: usize| {
        let t_s = i as f64 * dt_s;
        let yaw_rad = yaw_rad(t_s);
        let counts = reader.read(dt_s, &[0.0], yaw_rad)[0];
        TurnRow {
            t_s,
            yaw_rad,
            counts: counts.own - own_zero,
            compensated_counts: counts.compensated(sensor.common_mode) - zero,
        }
    };
    (0..samples).map(row).collect()
}

/// Heading over time: rest, smooth step to 180 degrees, rest, step back, rest.
fn yaw_rad(t_s: f64) -> f64 {
    let share = |from_s: f64| ((t_s - from_s) / TURN_S).clamp(0.0, 1.0);
    let smooth = |share: f64| 0.5 * (1.0 - (PI * share).cos());
    PI * (smooth(share(STILL_S)) - smooth(share(2.0 * STILL_S + TURN_S)))
}

/// Shift of the counts while the sensor is rotated by 180 degrees, relative to the mean before and after, which removes
/// a steady drift. `None` without rows at rest in both orientations.
pub fn shift_counts(rows: &[TurnRow], counts: impl Fn(&TurnRow) -> f64) -> Option<f64> {
    let standing = |yaw_rad: f64| {
        let still = rows.iter().filter(move |row| (row.yaw_rad - yaw_rad).abs() < 1e-9);
        mean(still.map(&counts))
    };
    Some((standing(PI)? - standing(0.0)?).abs())
}
