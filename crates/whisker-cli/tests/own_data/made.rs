//! Synthetic recordings: a robot's flange carries a whisker past a pin at a known place.
//!
//! The readings are those of the elastica, with noise, in counts of a nonlinear sensor. No column is in the units or
//! frames of a trace: milliseconds at uneven intervals, millimetres, degrees within a half turn, the pose of
//! the flange.

use std::f64::consts::PI;
use std::fmt::Write as _;

use whisker::Whisker;
use whisker::elastica::{Circle, Elastica};
use whisker::frames::{Base, Point, Pose, World};
use whisker::sensor::Face;

/// Axis and radius of the pin.
pub(crate) const PIN_M: [f64; 2] = [0.45, 0.12];
pub(crate) const PIN_RADIUS_M: f64 = 1.5e-3;

/// Base in the frame of the flange, and yaw of the base while calibrating.
const MOUNT: (f64, f64, f64) = (0.03, -0.01, 0.5 * PI);
const YAW_RAD: f64 = 4.7;

const REST_COUNTS: f64 = 512.0;
const COUNTS: [f64; 3] = [-3e7, 0.0, -1.2e15];

const INTERVAL_MS: f64 = 10.0;
const REST_ROWS: usize = 40;

/// Row of a recording.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Row {
    pub(crate) time_ms: f64,
    pub(crate) flange: (f64, f64, f64),
    pub(crate) counts: f64,
}

/// Pseudo-random number between -1 and 1, by a multiplicative congruential generator (Park and Miller 1988).
struct Noise(u64);

impl Noise {
    fn next(&mut self) -> f64 {
        self.0 = self.0 * 48_271 % 2_147_483_647;
        2.0 * self.0 as f64 / 2_147_483_647.0 - 1.0
    }
}

/// Recording in which the axis of the pin passes these places in the frame of the base, at these yaws.
fn recorded(seed: u64, places: impl Iterator<Item = (Point<Base>, f64)>) -> Vec<Row> {
    let elastica = Elastica::new(&Whisker::straight()).unwrap();
    let pin = Circle { center: Point::new(PIN_M[0], PIN_M[1]), radius_m: PIN_RADIUS_M };
    let flange_in_base: Pose<World, Base> = Pose::<Base, World>::new(MOUNT.0, MOUNT.1, MOUNT.2).inverse();
    let mut noise = Noise(seed);
    let rows = places.enumerate().map(|(i, (place, yaw_rad))| {
        let turned = Pose::<Base, World>::new(0.0, 0.0, yaw_rad).apply(place);
        let base: Pose<Base, World> = Pose::new(PIN_M[0] - turned.x(), PIN_M[1] - turned.y(), yaw_rad);
        let moment_n_m = match elastica.against(&pin, &base, Face::Left) {
            Ok(Some(touch)) => touch.deflection.moment_n_m,
            _ => 0.0,
        };
        let flange: Pose<World, World> = flange_in_base.then(&base);
        let wrapped_deg = (180.0 / PI * flange.yaw_rad() + 180.0).rem_euclid(360.0) - 180.0;
        let counts = COUNTS[0] * moment_n_m + COUNTS[2] * moment_n_m.powi(3);
        Row {
            time_ms: 5_000.0 + INTERVAL_MS * i as f64 + 1.5 * noise.next(),
            flange: (1e3 * flange.origin().x(), 1e3 * flange.origin().y(), wrapped_deg),
            counts: (REST_COUNTS + counts + 3.0 * (noise.next() + noise.next())).round(),
        }
    });
    rows.collect()
}

/// Presses of the pin at five places along the whisker, from free to `depth` and back. The pin lies on the left.
fn calibration(index: usize) -> Vec<Row> {
    const PRESS_ROWS: usize = 64;
    let rest = (0..REST_ROWS).map(|_| Point::new(0.05, 0.02));
    let presses = (0..5).flat_map(move |press| {
        let arc_m = 0.024 + 0.0095 * press as f64 + 0.0024 * index as f64;
        let depth_m = 0.24 * arc_m;
        (0..PRESS_ROWS).map(move |row| {
            let phase = PI * row as f64 / PRESS_ROWS as f64;
            Point::new(arc_m, 0.004 - (depth_m + 0.004) * phase.sin().powi(2))
        })
    });
    recorded(11 + index as u64, rest.chain(presses).map(|place| (place, YAW_RAD)))
}

/// Slide along the pin, pressing and turning.
fn trial() -> Vec<Row> {
    const ROWS: usize = 500;
    let places = (0..ROWS).map(|row| {
        let t_s = 1e-3 * INTERVAL_MS * (row as f64 - REST_ROWS as f64).max(0.0);
        let approach = (t_s / 0.3).min(1.0);
        let along_m = 0.048 + 0.012 * approach * (1.9 * t_s).sin();
        let away_m = 0.006 - approach * (0.013 + 0.003 * (4.1 * t_s).sin());
        (Point::new(along_m, away_m), YAW_RAD + 0.08 * approach * (2.7 * t_s).sin())
    });
    recorded(29, places)
}

/// Names and rows of all recordings.
pub(crate) fn recordings() -> Vec<(String, Vec<Row>)> {
    let calibrations = (0..4).map(|index| (format!("calibration_{}", index + 1), calibration(index)));
    calibrations.chain([("trial_1".into(), trial())]).collect()
}

/// Recording as CSV.
pub(crate) fn csv(rows: &[Row]) -> String {
    let mut text = String::from("time_ms,flange_x_mm,flange_y_mm,flange_yaw_deg,hall_counts\n");
    for Row { time_ms, flange: (x_mm, y_mm, yaw_deg), counts } in rows {
        writeln!(text, "{time_ms:.2},{x_mm:.3},{y_mm:.3},{yaw_deg:.3},{counts:.0}").unwrap();
    }
    text
}
