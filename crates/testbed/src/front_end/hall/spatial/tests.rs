use nalgebra::UnitQuaternion;
use trace::SpatialTrace;

use super::*;
use crate::front_end::spatial::{golden, spiral};

/// Settings without noise and drift, with a gain at which rounding of the counts is negligible.
fn quiet() -> Config {
    let gain_counts_per_t = 1e3 * Config::default().gain_counts_per_t;
    Config {
        white_counts: 0.0,
        flicker_counts: 0.0,
        temperature_sd_k: 0.0,
        bits: 32,
        gain_counts_per_t,
        ..Config::default()
    }
}

fn input(trace: &SpatialTrace) -> SpatialInput<'_> {
    SpatialInput::new(trace, 0.0, 1)
}

fn largest_error_n_m(hall: &Hall, trace: &SpatialTrace, sensor: &SpatialSensor) -> f64 {
    let readings = hall.readings_n_m(&SpatialInput { sensor: Some(sensor), ..input(trace) }).unwrap();
    let errors = readings.iter().zip(&trace.recording.instants).map(|(reading, instant)| {
        let expected = hall.axes().bending_n_m(moment_n_m(instant), &trace.sidecar.suspension);
        (reading[0] - expected[0]).hypot(reading[1] - expected[1])
    });
    errors.fold(0.0, f64::max)
}

/// For a rotation in the plane, the field is that of the planar front end.
#[test]
fn val_the_field_in_the_plane_is_the_planar_one() {
    let config = Config { earth_t: 0.0, ..Config::default() };
    let board = Board::new(&config, "straight");
    let magnet =
        crate::front_end::hall::dipole::Magnet { moment_a_m2: config.magnet_moment_a_m2, lever_m: config.lever_m };
    let place_m = Vector3::new(-config.lever_m - config.gap_m, 0.0, 0.0);
    for yaw_rad in [-0.3_f64, 0.0, 0.2] {
        let direction = Vector3::new(yaw_rad.cos(), yaw_rad.sin(), 0.0);
        let field_t = board.field_t(direction, &Rotation3::identity());
        assert!((field_t - magnet.field_t(yaw_rad, place_m)).norm() < 1e-18);
        // Turned about the axis of the wire by a quarter, yaw becomes pitch and y becomes z.
        let pitched_t = board.field_t(Vector3::new(yaw_rad.cos(), 0.0, yaw_rad.sin()), &Rotation3::identity());
        assert!((pitched_t - Vector3::new(field_t.x, 0.0, field_t.y)).norm() < 1e-18);
    }
}

#[test]
fn val_the_earths_field_turns_with_the_base() {
    let config = Config { earth_inclination_rad: 0.0, north_rad: 0.0, ..Config::default() };
    let board = Board::new(&config, "straight");
    let quarter = std::f64::consts::FRAC_PI_2;
    let earth_t = |axis, angle_rad: f64| board.earth_t(&Rotation3::from_axis_angle(&axis, angle_rad)) / config.earth_t;
    assert!((earth_t(Vector3::z_axis(), quarter) - Vector3::new(0.0, -1.0, 0.0)).norm() < 1e-12);
    assert!((earth_t(Vector3::y_axis(), quarter) - Vector3::new(0.0, 0.0, 1.0)).norm() < 1e-12);
    assert!((earth_t(Vector3::x_axis(), quarter) - Vector3::new(1.0, 0.0, 0.0)).norm() < 1e-12);
}

/// Without noise the calibration returns the bending that it was calibrated on, within 0.2 % of the largest.
#[test]
fn verif_readings_without_noise_return_the_bending() {
    let trace = golden();
    let hall = Hall { config: quiet() };
    let sensor = hall.calibrate(&[input(&spiral())]).unwrap().unwrap();
    let error_n_m = largest_error_n_m(&hall, &trace, &sensor);
    assert!(error_n_m < 2e-3 * sensor.characteristic.scale_n_m, "{error_n_m} of {}", sensor.characteristic.scale_n_m);
}

/// A base that turns in the earth's field: compensation removes at least nine tenths of its effect.
#[test]
fn val_compensation_reduces_the_effect_of_the_earths_field_tenfold() {
    let trace = golden();
    let mut turned = trace.clone();
    let last = turned.recording.instants.len() as f64;
    for (row, instant) in turned.recording.instants.iter_mut().enumerate() {
        let share = row as f64 / last;
        instant.base.rotation *= UnitQuaternion::from_euler_angles(2.0 * share, -share, 3.0 * share);
    }
    let left = |compensated: bool| {
        let hall = Hall { config: Config { compensated, ..quiet() } };
        let sensor = hall.calibrate(&[input(&spiral())]).unwrap().unwrap();
        largest_error_n_m(&hall, &turned, &sensor)
    };
    let (without, with) = (left(false), left(true));
    assert!(with < 0.1 * without, "{with} of {without} N m are left");
}

#[test]
fn verif_reading_errors_match_the_calibrated_noise() {
    let hall = Hall { config: Config { temperature_sd_k: 0.0, ..Config::default() } };
    let trace = golden();
    let sensor = hall.calibrate(&[input(&spiral())]).unwrap().unwrap();
    let mut errors = [Vec::new(), Vec::new()];
    for seed in 1..=10 {
        let readings = hall.readings_n_m(&SpatialInput { seed, sensor: Some(&sensor), ..input(&trace) }).unwrap();
        for (reading, instant) in readings.iter().zip(&trace.recording.instants) {
            let expected = hall.axes().bending_n_m(moment_n_m(instant), &trace.sidecar.suspension);
            (0..2).for_each(|axis| errors[axis].push(reading[axis] - expected[axis]));
        }
    }
    for (axis, errors) in errors.iter().enumerate() {
        let ratio = rms(errors).unwrap() / sensor.noise_sd_n_m[axis].hypot(sensor.offset_sd_n_m[axis]);
        assert!((0.8..1.4).contains(&ratio), "axis {axis}: error over the noise at rest {ratio}");
    }
}

/// Rotations that the trace does not state follow from the moments.
#[test]
fn verif_missing_rotations_are_replaced_by_moment_over_stiffness() {
    let hall = Hall { config: Config::default() };
    let trace = golden();
    let mut without = trace.clone();
    without.recording.instants.iter_mut().for_each(|instant| instant.rotation = None);
    let counts = |trace: &SpatialTrace| hall.counts(&input(trace), &Matrix3::zeros());
    let changed =
        counts(&trace).iter().zip(counts(&without)).map(|(one, other)| (one - other).amax()).fold(0.0, f64::max);
    assert!(changed <= 1.0, "{changed} counts");
}

#[test]
fn robust_wrong_calibrations_are_one_clear_error() {
    let hall = Hall { config: Config::default() };
    let trace = golden();
    let error = hall.readings_n_m(&input(&trace)).unwrap_err().to_string();
    assert!(error.contains("must be calibrated"), "{error}");
    let sensor = hall.calibrate(&[input(&spiral())]).unwrap().unwrap();
    let other = SpatialSensor { name: "other".into(), ..sensor };
    let error = hall.readings_n_m(&SpatialInput { sensor: Some(&other), ..input(&trace) }).unwrap_err().to_string();
    assert!(error.contains("`other`") && error.contains(&trace.sidecar.whisker.name), "{error}");
    let loud = Hall { config: Config { gain_counts_per_t: 1e9, ..Config::default() } };
    let error = loud.calibrate(&[input(&spiral())]).unwrap_err().to_string();
    assert!(error.contains("saturate"), "{error}");
    assert!(hall.calibrate(&[]).unwrap_err().to_string().contains("no recording"));
}
