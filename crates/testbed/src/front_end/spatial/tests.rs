use std::path::Path;

use nalgebra::Vector3;
use serde_json::json;
use trace::{SpatialInstant, SpatialTrace};

use super::*;
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
        let noise = SpatialNoise::fraction_of(0.01, [&trace.recording]);
        let sensor = front_end.calibrate(&[SpatialInput::new(&calibration, SpatialNoise::default(), 7)]).unwrap();
        let read = |seed| {
            let input = SpatialInput { sensor: sensor.as_ref(), ..SpatialInput::new(&trace, noise, seed) };
            front_end.readings(&input).unwrap()
        };
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
                    reading.bending_n_m[axis] - expected[axis]
                })
                .collect();
            let own_n_m =
                sensor.as_ref().map_or(0.0, |sensor| sensor.noise_sd_n_m[axis].hypot(sensor.offset_sd_n_m[axis]));
            let ratio = rms(&errors).unwrap() / noise.moment_n_m.hypot(own_n_m);
            assert!((0.8..1.25).contains(&ratio), "{}, axis {axis}: error over the noise {ratio}", row.name);
        }
    }
}

#[test]
fn verif_the_default_front_end_reads_the_moments_with_the_white_noise_of_traces_in_space() {
    let trace = golden();
    let white = SpatialFrontEnd::new(&FrontEndConfig::default()).unwrap();
    let readings = white.bending_n_m(&trace, 2e-7, 3, None).unwrap();
    assert_eq!(readings, crate::space::noisy_readings_n_m(&trace, 2e-7, 3));
}

#[test]
fn verif_white_noise_has_the_stated_deviation_on_each_component() {
    let trace = golden();
    let noise = SpatialNoise { moment_n_m: 2e-7, axial_n: 3e-5 };
    let white = front_end("white", json!({})).unwrap();
    let mut errors = [Vec::new(), Vec::new(), Vec::new(), Vec::new()];
    for seed in 0..10 {
        let readings = white.readings(&SpatialInput::new(&trace, noise, seed)).unwrap();
        for (reading, instant) in readings.iter().zip(&trace.recording.instants) {
            errors[0].push(reading.torsion_n_m.unwrap() - instant.moment_x_n_m.unwrap());
            errors[1].push(reading.bending_n_m[0] - instant.moment_y_n_m);
            errors[2].push(reading.bending_n_m[1] - instant.moment_z_n_m);
            errors[3].push(reading.axial_n.unwrap() - instant.force_x_n.unwrap());
        }
    }
    for (component, expected) in errors.iter().zip([2e-7, 2e-7, 2e-7, 3e-5]) {
        assert!((rms(component).unwrap() / expected - 1.0).abs() < 0.05);
    }
    let product = errors[0].iter().zip(&errors[1]).map(|(one, other)| one * other).sum::<f64>();
    assert!(product.abs() < 0.05 * errors[0].len() as f64 * 4e-14, "components have independent noise");
}

#[test]
fn verif_components_that_are_not_measured_are_missing() {
    let mut trace = golden();
    let bending_alone = front_end("white", json!({"torsion": false, "axial": false})).unwrap();
    let read = |front_end: &SpatialFrontEnd, trace: &SpatialTrace| {
        front_end.readings(&SpatialInput::new(trace, SpatialNoise::default(), 1)).unwrap()[300]
    };
    let reading = read(&bending_alone, &trace);
    assert_eq!((reading.torsion_n_m, reading.axial_n), (None, None));
    let whole = front_end("white", json!({})).unwrap();
    assert!(read(&whole, &trace).torsion_n_m.is_some() && read(&whole, &trace).axial_n.is_some());
    trace.recording.instants.iter_mut().for_each(|one| (one.moment_x_n_m, one.force_x_n) = (None, None));
    let reading = read(&whole, &trace);
    assert_eq!((reading.torsion_n_m, reading.axial_n), (None, None));
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
        ("white", json!({"tension": true}), ["`white`", "unknown key `tension`", "torsion"]),
        ("white", json!({"torsion": 1}), ["`white`", "expected a boolean", ""]),
        ("hall", json!({"gap_m": 0.0}), ["`hall`", "`gap_m`", "found 0"]),
        ("optical", json!({}), ["unknown front end `optical`", "white", "hall"]),
    ] {
        let text = format!("{:#}", front_end(name, config).err().expect("wrong settings"));
        assert!(words.iter().all(|word| text.contains(word)), "{text}");
    }
}
