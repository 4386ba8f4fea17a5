use nalgebra::{Isometry3, Vector3};
use trace::{Recorded, Trace};

use super::board::{Counts, Y};
use super::*;
use crate::front_end::{BoardSlot, FrontEnd, FrontEndConfig};
use crate::statistics::quantile;

fn mounting(sensor: &str, array: &str) -> Mounting {
    Mounting::single(array, sensor).on("test")
}

fn golden(name: &str) -> Trace {
    let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../datasets/golden");
    Trace::read(&folder.join(format!("{name}.csv"))).unwrap()
}

fn hall(config: Config) -> Hall {
    Hall { config }
}

/// Calibration of a sensor on the golden traces.
fn calibrated(hall: &Hall, mounting: &Mounting) -> anyhow::Result<SensorFile> {
    let traces = ["golden_pin", "golden_circle"].map(golden);
    let own = traces.each_ref().map(|trace| Mounting::alone(&trace.sidecar));
    let input: Vec<SensorInput> =
        traces.iter().zip(&own).map(|(trace, own)| SensorInput::new(trace, own, 0.0, 1)).collect();
    Ok(hall.calibrate(mounting, &input)?.expect("it has a sensor"))
}

#[test]
fn val_signal_and_rest_counts_match_the_published_ones() {
    let config = Config::default();
    let mut peaks = Vec::new();
    let mut rests = Vec::new();
    for copy in 0..20 {
        let mounting = mounting(&format!("sensor {copy}"), "board");
        let board = Board::new(&config, &mounting);
        // The largest rotation of the standard suite's trials is 21.7 degrees.
        let whisker = &board.whiskers[0];
        let field_t = |rotation_rad: f64| board.magnets_t(&[rotation_rad], &whisker.place);
        let counts = |rotation_rad: f64| whisker.sensor.counts(Y, field_t(rotation_rad), 0.0, 0.0);
        peaks.push((counts(21.7_f64.to_radians()) - counts(0.0)).abs());
        let common_mode = common_mode::fit_at_headings(&board, &mounting, 0, 1, 0.004);
        let mut reader = board.reader(&mounting, 1);
        let zero = hall(config.clone()).zero_counts(&mut reader, 0, common_mode, 0.004, 0.0);
        rests.extend(
            reader.rest(0, 2500, 0.004, 0.0).iter().map(|counts| (counts.compensated(common_mode) - zero).abs()),
        );
    }
    let peak = quantile(&peaks, 0.5).unwrap();
    assert!((1300.0..1420.0).contains(&peak), "peak {peak}");
    let rest = quantile(&rests, 0.997).unwrap();
    assert!((4.0..6.5).contains(&rest), "rest within {rest}");
}

#[test]
fn val_compensation_reduces_the_earths_shift_tenfold_in_every_sensor() {
    let hall = hall(Config::default());
    for copy in 0..20 {
        let mounting = mounting(&format!("sensor {copy}"), &format!("board {}", copy / 3));
        let sensor = calibrated(&hall, &mounting).unwrap();
        let rows = turn::rows(&Board::new(&hall.config, &mounting), &mounting, &sensor);
        let before = shift_counts(&rows, |row| row.counts).unwrap();
        let after = shift_counts(&rows, |row| row.compensated_counts).unwrap();
        assert!((10.0..15.0).contains(&before), "{copy}: {before} counts");
        assert!(after < 0.1 * before, "{copy}: {after} of {before} counts are left");
    }
}

#[test]
fn verif_without_compensation_the_shift_remains() {
    let hall = hall(Config { compensated: false, ..Config::default() });
    let mounting = mounting("sensor", "board");
    let sensor = calibrated(&hall, &mounting).unwrap();
    assert_eq!(sensor.common_mode, [0.0; 2]);
    let rows = turn::rows(&Board::new(&hall.config, &mounting), &mounting, &sensor);
    assert!(rows.iter().all(|row| row.counts == row.compensated_counts));
}

#[test]
fn val_earths_field_rotates_in_the_sensor_frame() {
    let mut config = Config { earth_t: 50e-6, earth_inclination_rad: 0.0, north_rad: 0.0, ..Config::default() };
    let earth_t = |config: &Config, yaw_rad| Board::new(config, &mounting("sensor", "board")).earth_t(yaw_rad);
    assert!((earth_t(&config, 0.0) - Vector3::new(50e-6, 0.0, 0.0)).norm() < 1e-18);
    assert!((earth_t(&config, 0.5 * std::f64::consts::PI) - Vector3::new(0.0, -50e-6, 0.0)).norm() < 1e-18);
    config.earth_inclination_rad = 0.5 * std::f64::consts::PI;
    assert!((earth_t(&config, 1.0) - Vector3::new(0.0, 0.0, -50e-6)).norm() < 1e-18);
}

#[test]
fn verif_reading_errors_match_the_calibrated_noise() {
    let hall = hall(Config { temperature_sd_k: 0.0, ..Config::default() });
    let trace = golden("golden_pin");
    let mounting = Mounting::alone(&trace.sidecar);
    let sensor = calibrated(&hall, &mounting).unwrap();
    let mut errors_n_m = Vec::new();
    for seed in 1..=20 {
        let input = SensorInput::new(&trace, &mounting, 0.0, seed);
        let readings = hall.readings_n_m(&SensorInput { sensor: Some(&sensor), ..input }).unwrap();
        let moments = trace.recording.instants.iter().map(|instant| instant.moment_z_n_m);
        errors_n_m.extend(readings.iter().zip(moments).map(|(reading, moment)| reading - moment));
    }
    let ratio = rms(&errors_n_m).unwrap() / sensor.noise_sd_n_m.hypot(sensor.offset_sd_n_m);
    assert!((0.9..1.1).contains(&ratio), "error over the noise at rest {ratio}");
}

#[test]
fn verif_missing_rotations_are_replaced_by_moment_over_stiffness() {
    let hall = hall(Config::default());
    let mut trace = golden("golden_pin");
    let mounting = Mounting::alone(&trace.sidecar);
    let counts = |input: SensorInput| hall.counts(&input, &[input.rotations_rad()], 0, [0.0; 2]);
    let with = counts(SensorInput::new(&trace, &mounting, 0.0, 1));
    trace.recording.instants.iter_mut().for_each(|instant| instant.rotation_z_rad = None);
    let without = counts(SensorInput::new(&trace, &mounting, 0.0, 1));
    // Rotations are stored with a resolution of 1e-10 rad, so that a count may round differently.
    assert!(with.iter().zip(&without).all(|(a, b)| (a - b).abs() <= 1.0));
}

#[test]
fn verif_whiskers_of_an_array_share_reference_and_temperature() {
    let config = Config::default();
    let [left_1, left_2] = ["left_1", "left_2"].map(|sensor| mounting(sensor, "left"));
    let right = mounting("left_1", "right");
    let read = |mounting: &Mounting| Board::new(&config, mounting).reader(mounting, 1).rest(0, 200, 0.004, 0.3);
    let reference = |counts: &[Counts]| counts.iter().map(|counts| counts.reference).collect::<Vec<_>>();
    let own = |counts: &[Counts]| counts.iter().map(|counts| counts.own).collect::<Vec<_>>();
    assert_eq!(reference(&read(&left_1)), reference(&read(&left_2)));
    assert_ne!(own(&read(&left_1)), own(&read(&left_2)));
    assert_ne!(reference(&read(&left_1)), reference(&read(&right)));
}

/// Two whiskers on a board, offset by 10 mm along it and 8 mm up; the first as in the trace.
fn beside(trace: &Trace) -> [Mounting; 2] {
    let slot = |sensor: &str, base| BoardSlot { sensor: sensor.into(), trace: None, base };
    let (first, second) = (Isometry3::identity(), Isometry3::translation(0.01, 0.0, 0.008));
    ["one", "other"].map(|sensor| Mounting {
        board: vec![slot("one", first), slot("other", second)],
        ..mounting(sensor, "board").on(&trace.sidecar.name)
    })
}

#[test]
fn val_dipole_fields_of_neighbours_superpose() {
    let config = Config::default();
    let board = Board::new(&config, &beside(&golden("golden_pin"))[0]);
    let place = board.whiskers[0].place;
    let alone = |rotation_rad| board.magnet.field_t(rotation_rad, place.coords);
    let from_second = board.magnet.field_t(0.3, place.coords - Vector3::new(0.01, 0.0, 0.008));
    assert!((board.magnets_t(&[0.1, 0.3], &place) - alone(0.1) - from_second).norm() < 1e-15);
    let middle = Vector3::new(0.005 - config.lever_m - config.gap_m, 0.0, 0.004 + config.reference_distance_m);
    assert!((board.reference_place.coords - middle).norm() < 1e-15);
}

/// Compensation reduces the effect of a neighbour on the readings tenfold.
#[test]
fn val_cross_talk_is_compensated() {
    let quiet = Config { white_counts: 0.0, flicker_counts: 0.0, temperature_sd_k: 0.0, ..Config::default() };
    // Gain large enough for rounding of the counts to be negligible.
    let hall = hall(Config { gain_counts_per_t: 1e3 * quiet.gain_counts_per_t, bits: 32, ..quiet });
    let trace = golden("golden_pin");
    let mut still = trace.clone();
    still
        .recording
        .instants
        .iter_mut()
        .for_each(|instant| (instant.moment_z_n_m, instant.rotation_z_rad) = (0.0, None));
    let mountings = beside(&trace);
    let [one, other] = mountings.each_ref().map(|mounting| calibrated(&hall, mounting).unwrap());
    let worst_n_m = |sensor: &SensorFile| {
        let moved = [SensorInput { sensor: Some(&other), ..SensorInput::new(&trace, &mountings[1], 0.0, 1) }];
        let resting = SensorInput::new(&still, &mountings[0], 0.0, 1);
        let readings = hall.readings_n_m(&SensorInput { sensor: Some(sensor), neighbours: &moved, ..resting }).unwrap();
        readings.into_iter().map(f64::abs).fold(0.0, f64::max)
    };
    let without = worst_n_m(&SensorFile { cross_talk: Vec::new(), ..one.clone() });
    let with = worst_n_m(&one);
    assert!(with < 0.1 * without, "{with} of {without} N m are left");
}

#[test]
fn verif_the_run_seed_changes_the_noise_and_not_the_sensor() {
    let hall = hall(Config { white_counts: 0.0, flicker_counts: 0.0, temperature_sd_k: 0.0, ..Config::default() });
    let trace = golden("golden_pin");
    let mounting = Mounting::alone(&trace.sidecar);
    let counts = |hall: &Hall, seed| {
        let input = SensorInput::new(&trace, &mounting, 0.0, seed);
        hall.counts(&input, &[input.rotations_rad()], 0, [0.0; 2])
    };
    assert_eq!(counts(&hall, 1), counts(&hall, 2));
    let noisy = Hall { config: Config::default() };
    assert_eq!(counts(&noisy, 1), counts(&noisy, 1));
    assert_ne!(counts(&noisy, 1), counts(&noisy, 2));
    let other = Hall { config: Config { seed: 1, ..hall.config.clone() } };
    assert_ne!(counts(&hall, 1), counts(&other, 1));
}

#[test]
fn robust_a_sensor_that_saturates_cannot_be_calibrated() {
    let hall = hall(Config { gain_counts_per_t: 1e9, ..Config::default() });
    let error = calibrated(&hall, &mounting("loud", "board")).unwrap_err().to_string();
    assert!(error.contains("sensor `loud`") && error.contains("saturate"), "{error}");
}

#[test]
fn robust_recordings_of_real_sensors_are_rejected() {
    let mut trace = golden("golden_pin");
    trace.sidecar.recorded = Some(Recorded {
        clock: "nominal".into(),
        characteristic: [1.0, 0.0, 0.0],
        range_n_m: None,
        residual_counts: 0.0,
        rest_counts: 0.0,
        noise_sd_n_m: 0.0,
        touch_counts: 0.0,
        object_class: None,
    });
    let front_end = FrontEnd::new(&FrontEndConfig { name: "hall".into(), config: json!({}) }).unwrap();
    let error = front_end.check_trace(&trace.sidecar).unwrap_err().to_string();
    assert!(error.contains("golden_pin") && error.contains("recording of a real sensor"), "{error}");
    let white = FrontEnd::new(&FrontEndConfig::default()).unwrap();
    white.check_trace(&trace.sidecar).unwrap();
    assert_eq!(white.row.default_noise(&trace.sidecar), 0.0);
}

#[test]
fn robust_invalid_settings_are_reported_by_name() {
    for (config, words) in [
        (json!({"gap_m": 0.0}), ["`gap_m`", "found 0", "0.0001 to 0.1"]),
        (json!({"gap": 1.0}), ["unknown field `gap`", "", ""]),
        (json!({"bits": 40}), ["`bits`", "found 40", "2 to 32"]),
        (json!([]), ["expected a JSON object", "", ""]),
    ] {
        let error = FrontEnd::new(&FrontEndConfig { name: "hall".into(), config }).err().expect("wrong settings");
        let text = format!("{error:#}");
        assert!(text.contains("`hall`") && words.iter().all(|word| text.contains(word)), "{text}");
    }
    let error =
        FrontEnd::new(&FrontEndConfig { name: "optical".into(), config: json!({}) }).err().expect("no such one");
    assert_eq!(error.to_string(), "unknown front end `optical`, expected one of: white, hall");
}
