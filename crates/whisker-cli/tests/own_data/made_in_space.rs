//! Synthetic recordings in space: a robot's flange carries a curved whisker past an upright pin at a known place.
//!
//! The readings are those of the rod, with noise, in counts of a sensor whose two channels are turned about the whisker. Each row
//! begins with a force on the whisker; pin and flange are placed so that the pin exerts it.

use std::f64::consts::{PI, TAU};
use std::fmt::Write as _;

use nalgebra::{Isometry3, Matrix2, Point3, Translation3, UnitQuaternion, Vector3};
use whisker::Whisker;
use whisker::rod::{Rod, SpatialLoad};

/// A point of the pin's axis, its direction and radius.
pub(crate) const PIN_M: [f64; 3] = [0.45, 0.12, 0.3];
pub(crate) const PIN_RADIUS_M: f64 = 1e-3;

/// Response of both channels (counts per N m), without the cubic part.
pub(crate) const COUNTS_PER_N_M: [[f64; 2]; 2] = [[2.6e7, 1.1e7], [-0.9e7, 3.1e7]];

/// Cubic part of the response, relative to the linear one, per square of the moment (1/(N m)^2).
const CUBIC: f64 = 1.5e7;

const REST_COUNTS: [f64; 2] = [512.0, -140.0];

const INTERVAL_MS: f64 = 10.0;
const REST_ROWS: usize = 40;
const PRESS_ROWS: u32 = 36;

/// Distance between whisker and pin at rest.
const APART_M: f64 = 6e-3;

const POISSON_RATIO: f64 = 0.33;

/// Row of a recording, and the contact on the centre line, in World, that it has.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Row {
    pub(crate) time_ms: f64,
    pub(crate) flange: Isometry3<f64>,
    pub(crate) counts: [f64; 2],
    pub(crate) contact_m: Option<Vector3<f64>>,
}

/// Base in the frame of the flange, as the mapping states it.
pub(crate) fn mount() -> Isometry3<f64> {
    let rotation = UnitQuaternion::from_euler_angles(0.0, PI / 6.0, 0.5 * PI);
    Isometry3::from_parts(Translation3::new(0.03, -0.01, 0.05), rotation)
}

/// Pseudo-random number between -1 and 1, by a multiplicative congruential generator (Park and Miller 1988).
struct Noise(u64);

impl Noise {
    fn next(&mut self) -> f64 {
        self.0 = self.0 * 48_271 % 2_147_483_647;
        2.0 * self.0 as f64 / 2_147_483_647.0 - 1.0
    }
}

/// Contact and pose of a row.
#[derive(Clone, Copy, Debug)]
struct Wish {
    /// Arc length of the contact.
    arc_m: f64,
    /// Direction of the force about the whisker, from the left upwards.
    direction_rad: f64,
    /// Deflection of the whisker there by a linear spring; the distance from the pin if it is negative.
    depth_m: f64,
    /// Angle of the pin to the plane across the whisker.
    tilt_rad: f64,
    /// Rotation of the whisker about the pin.
    turn_rad: f64,
}

fn rod() -> Rod {
    Rod::round(&Whisker::curved(), POISSON_RATIO).unwrap()
}

/// Recording in which the pin touches the whisker in this way.
fn recorded(seed: u64, wishes: impl Iterator<Item = Wish>) -> Vec<Row> {
    let (rod, whisker) = (rod(), Whisker::curved());
    let flange_in_base = mount().inverse();
    let mut noise = Noise(seed);
    let row = |(i, Wish { arc_m, direction_rad, depth_m, tilt_rad, turn_rad }): (usize, Wish)| {
        let pressed = |force_n: f64| {
            let (sin, cos) = direction_rad.sin_cos();
            rod.deflect(SpatialLoad { arc_m, force_n: force_n * Vector3::new(0.0, cos, sin) }).unwrap()
        };
        // Deflection by a small force.
        let (unloaded, small_n) = (pressed(0.0), 1e-6);
        let compliance_m_n = (pressed(small_n).point - unloaded.point).norm() / small_n;
        let at = pressed(depth_m.max(0.0) / compliance_m_n);
        let (sin, cos) = direction_rad.sin_cos();
        let normal = at.directors * Vector3::new(0.0, cos, sin);
        let tangent = at.directors.column(0).into_owned();
        let distance_m = PIN_RADIUS_M + 0.5 * whisker.diameter_m(arc_m) + (-depth_m).max(0.0);
        let axis = tilt_rad.cos() * tangent.cross(&normal) + tilt_rad.sin() * tangent;
        let upright = UnitQuaternion::rotation_between(&axis, &Vector3::z()).unwrap();
        let rotation = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), turn_rad) * upright;
        let base = Isometry3::from_parts(
            Translation3::from(Vector3::from(PIN_M) - rotation * (at.point - distance_m * normal)),
            rotation,
        );
        let moment_n_m = at.moment_n_m.yz();
        let linear = Matrix2::from(COUNTS_PER_N_M).transpose() * moment_n_m;
        let counts = linear * (1.0 + CUBIC * moment_n_m.norm_squared());
        let mut read =
            |channel: usize| (REST_COUNTS[channel] + counts[channel] + 2.0 * (noise.next() + noise.next())).round();
        let counts = [read(0), read(1)];
        Row {
            time_ms: 5_000.0 + INTERVAL_MS * i as f64 + 1.5 * noise.next(),
            flange: base * flange_in_base,
            counts,
            contact_m: (depth_m > 0.0).then(|| base * Point3::from(at.point)).map(|point| point.coords),
        }
    };
    wishes.enumerate().map(row).collect()
}

/// Number of recordings of the calibration.
pub(crate) const CALIBRATIONS: usize = 8;

/// Presses of the pin from one direction at seven places along the whisker, from free to the largest depth and back.
fn calibration(index: usize) -> Vec<Row> {
    let direction_rad = TAU * index as f64 / CALIBRATIONS as f64;
    let length_m = Whisker::curved().length_m;
    let arc_m = move |press: f64| length_m * (0.3 + 0.095 * press + 0.01 * (index % 3) as f64);
    let wish = move |arc_m: f64, depth_m: f64| Wish { arc_m, direction_rad, depth_m, tilt_rad: 0.1, turn_rad: 0.4 };
    let rest = (0..REST_ROWS).map(move |_| wish(arc_m(0.0), -APART_M));
    let presses = (0..7_u32).flat_map(move |press| {
        let depth_m = 0.2 * arc_m(f64::from(press));
        (0..PRESS_ROWS).map(move |row| {
            let share = f64::from(row) / f64::from(PRESS_ROWS);
            // On to the next place while the whisker is free.
            let onwards = ((share - 0.85) / 0.15).max(0.0);
            let pressed = (PI * share).sin().powi(2);
            wish(arc_m(f64::from(press) + onwards), (depth_m + APART_M) * pressed - APART_M)
        })
    });
    recorded(11 + index as u64, rest.chain(presses))
}

/// Slide along the pin, pressing and rolling.
fn trial() -> Vec<Row> {
    const ROWS: usize = 500;
    let length_m = Whisker::curved().length_m;
    let wishes = (0..ROWS).map(|row| {
        let t_s = 1e-3 * INTERVAL_MS * (row as f64 - REST_ROWS as f64).max(0.0);
        let approach = (t_s / 0.3).min(1.0);
        Wish {
            arc_m: length_m * (0.6 + 0.15 * approach * (1.9 * t_s).sin()),
            direction_rad: 0.7 + 0.5 * approach * (0.8 * t_s).sin(),
            depth_m: -APART_M + approach * (APART_M + 0.007 + 0.002 * (4.1 * t_s).sin()),
            tilt_rad: 0.15 * approach * (1.3 * t_s).sin(),
            turn_rad: 0.4 + 0.1 * approach * (2.7 * t_s).sin(),
        }
    });
    recorded(29, wishes)
}

/// Names and rows of all recordings.
pub(crate) fn recordings() -> Vec<(String, Vec<Row>)> {
    let calibrations = (0..CALIBRATIONS).map(|index| (format!("calibration_{}", index + 1), calibration(index)));
    calibrations.chain([("trial_1".into(), trial())]).collect()
}

/// Recording as CSV.
pub(crate) fn csv(rows: &[Row]) -> String {
    let mut text = String::from(
        "time_ms,flange_x_mm,flange_y_mm,flange_z_mm,flange_qw,flange_qx,flange_qy,flange_qz,hall_a,hall_b\n",
    );
    for Row { time_ms, flange, counts: [a, b], .. } in rows {
        let at_mm = 1e3 * flange.translation.vector;
        let [x, y, z, w]: [f64; 4] = flange.rotation.coords.into();
        write!(text, "{time_ms:.2},{:.3},{:.3},{:.3},", at_mm.x, at_mm.y, at_mm.z).unwrap();
        writeln!(text, "{w:.6},{x:.6},{y:.6},{z:.6},{a:.0},{b:.0}").unwrap();
    }
    text
}
