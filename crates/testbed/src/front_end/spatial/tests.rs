use std::path::Path;

use nalgebra::Vector3;
use serde_json::json;
use trace::{SpatialInstant, SpatialTrace};

use super::*;
use crate::space::largest_reading_n_m;
use crate::statistics::rms;

pub(in crate::front_end) fn golden() -> SpatialTrace {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../datasets/golden/space");
    SpatialTrace::read(&folder.join("golden_space.csv")).unwrap()
}

/// Trace of a free base whose moment spirals to 1.2 times the largest of the golden trace, without stated rotations.
pub(in crate::front_end) fn spiral() -> SpatialTrace {
    let mut trace = golden();
    let largest_n_m = trace.recording.instants.iter().map(|one| chain::moment_n_m(one).norm()).fold(0.0, f64::max);
    let first = trace.recording.instants[0];
    trace.recording.instants = (0..3000)
        .map(|row| {
            let share = f64::from(row) / 3000.0;
            let (sin, cos) = (40.0 * share).sin_cos();
            let size_n_m = 1.2 * largest_n_m * share;
            SpatialInstant {
                t_s: f64::from(row) / trace.sidecar.rate_hz,
                moment_x_n_m: Some(0.0),
                moment_y_n_m: size_n_m * cos,
                moment_z_n_m: size_n_m * sin,
                rotation: None,
                ..first
            }
        })
        .collect();
    trace
}

fn front_end(name: &str, config: Value) -> anyhow::Result<SpatialFrontEnd> {
    SpatialFrontEnd::new(&FrontEndConfig { name: name.into(), config })
}

/// Every entry: readings of finite numbers, determined by the seed, that follow the loads.
#[test]
fn verif_every_front_end_reads_a_trace() {
    let (trace, calibration) = (golden(), spiral());
    let rod = trace.sidecar.suspension;
    for row in SPATIAL_FRONT_ENDS {
        let front_end = front_end(row.name, json!({})).unwrap();
        let noise_sd_n_m = 0.01 * largest_reading_n_m([&trace]);
        let sensor = front_end.calibrate(&[SpatialInput::new(&calibration, 0.0, 7)]).unwrap();
        let read = |seed| front_end.bending_n_m(&trace, noise_sd_n_m, seed, sensor.as_ref()).unwrap();
        let readings = read(1);
        assert_eq!(readings.len(), trace.recording.instants.len(), "{}", row.name);
        assert_eq!(readings, read(1), "{}", row.name);
        assert_ne!(readings, read(2), "{}", row.name);
        for axis in 0..2 {
            let errors: Vec<f64> = readings
                .iter()
                .zip(&trace.recording.instants)
                .map(|(reading, instant)| {
                    let expected = front_end.axes().bending_n_m(chain::moment_n_m(instant), &rod);
                    reading[axis] - expected[axis]
                })
                .collect();
            let own_n_m =
                sensor.as_ref().map_or(0.0, |sensor| sensor.noise_sd_n_m[axis].hypot(sensor.offset_sd_n_m[axis]));
            let ratio = rms(&errors).unwrap() / noise_sd_n_m.hypot(own_n_m);
            assert!((0.8..1.25).contains(&ratio), "{}, axis {axis}: error over the noise {ratio}", row.name);
        }
    }
}

#[test]
fn verif_white_noise_has_the_stated_deviation_on_each_moment() {
    let trace = golden();
    let white = SpatialFrontEnd::new(&FrontEndConfig::default()).unwrap();
    let mut errors = [Vec::new(), Vec::new()];
    for seed in 0..10 {
        let readings = white.bending_n_m(&trace, 2e-7, seed, None).unwrap();
        for (reading, instant) in readings.iter().zip(&trace.recording.instants) {
            errors[0].push(reading.x - instant.moment_y_n_m);
            errors[1].push(reading.y - instant.moment_z_n_m);
        }
    }
    for errors in &errors {
        assert!((rms(errors).unwrap() / 2e-7 - 1.0).abs() < 0.05);
    }
    let product = errors[0].iter().zip(&errors[1]).map(|(one, other)| one * other).sum::<f64>();
    assert!(product.abs() < 0.05 * errors[0].len() as f64 * 4e-14, "both have independent noise");
}

/// Stiffness times angle of the two bending springs, for the stored rotations of the root.
#[test]
fn val_bending_about_the_springs_is_stiffness_times_angle() {
    let trace = golden();
    let suspension = trace.sidecar.suspension;
    for instant in &trace.recording.instants {
        let rotation = instant.rotation.unwrap();
        let [y_n_m, z_n_m] = BendingAxes::Springs.bending_n_m(chain::moment_n_m(instant), &suspension);
        assert!((y_n_m - suspension.pitch_n_m_rad * rotation.y).abs() < 1e-12, "{y_n_m}");
        assert!((z_n_m - suspension.yaw_n_m_rad * rotation.x).abs() < 1e-12, "{z_n_m}");
    }
    let moment_n_m = Vector3::new(1.0, 2.0, 3.0);
    assert_eq!(BendingAxes::Base.bending_n_m(moment_n_m, &suspension), [2.0, 3.0]);
}

#[test]
fn robust_invalid_settings_are_reported_by_name() {
    for (name, config, words) in [
        ("white", json!({"torsion": true}), ["`white`", "unknown key `torsion`", "expected none"]),
        ("hall", json!({"gap_m": 0.0}), ["`hall`", "`gap_m`", "found 0"]),
        ("optical", json!({}), ["unknown front end `optical`", "white", "hall"]),
    ] {
        let text = format!("{:#}", front_end(name, config).err().expect("wrong settings"));
        assert!(words.iter().all(|word| text.contains(word)), "{text}");
    }
}
