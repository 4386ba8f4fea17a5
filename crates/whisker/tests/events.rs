//! Contact detection: its filters against SciPy, its events on a ringing whisker.

use std::f64::consts::PI;
use std::fs;
use std::path::PathBuf;

use rand::{RngExt, SeedableRng};
use rand_distr::StandardNormal;
use rand_pcg::Pcg64Mcg;
use signal::{Cascade, Section, band_pass};
use whisker::events::{ContactDetector, DETECTORS, FORMER_NAMES, FirstMode, Sensing, TouchConfig};
use whisker::sensor::Face;

const RATE_HZ: f64 = 250.0;
const DT_S: f64 = 1.0 / RATE_HZ;
const LARGEST_N_M: f64 = 5e-5;
const NOISE_N_M: f64 = 2e-7;
const FIRST_MODE: FirstMode = FirstMode { frequency_hz: 7.9, damping_ratio: 0.06 };

/// Rows of a golden file as fields.
fn golden(name: &str) -> (Vec<String>, Vec<Vec<String>>) {
    let path = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../datasets/golden").join(name);
    let text = fs::read_to_string(path).unwrap();
    let mut rows = text.lines().map(|line| line.split(',').map(String::from).collect::<Vec<_>>());
    (rows.next().unwrap(), rows.collect())
}

/// The designs of the golden file, each with SciPy's sections.
fn designs() -> Vec<(String, usize, [f64; 3], Vec<Section>)> {
    let (_, rows) = golden("butterworth_sections.csv");
    let mut designs: Vec<(String, usize, [f64; 3], Vec<Section>)> = Vec::new();
    for row in rows {
        let number = |column: usize| row[column].parse::<f64>().unwrap();
        let section = Section { b: [5, 6, 7].map(number), a: [8, 9].map(number) };
        match designs.last_mut().filter(|design| design.0 == row[0]) {
            Some(design) => design.3.push(section),
            None => designs.push((row[0].clone(), number(1) as usize, [2, 3, 4].map(number), vec![section])),
        }
    }
    designs
}

#[test]
fn val_sections_against_scipy() {
    let designs = designs();
    assert_eq!(designs.len(), 5);
    for (name, order, [low_hz, high_hz, rate_hz], expected) in designs {
        let sections = band_pass(order, low_hz, high_hz, rate_hz).unwrap();
        assert_eq!(sections.len(), expected.len(), "{name}");
        for (found, expected) in sections.iter().zip(&expected) {
            let both = found.b.iter().chain(&found.a).zip(expected.b.iter().chain(&expected.a));
            for (found, expected) in both {
                assert!((found - expected).abs() < 1e-12 * expected.abs().max(1e-3), "{name}: {found} {expected}");
            }
        }
    }
}

#[test]
fn val_filtered_signals_against_scipy() {
    let (header, rows) = golden("butterworth_filtered.csv");
    for (name, order, [low_hz, high_hz, rate_hz], _) in designs() {
        let column = header.iter().position(|column| *column == name).unwrap();
        let mut filter = Cascade::new(band_pass(order, low_hz, high_hz, rate_hz).unwrap());
        for row in &rows {
            let (input, expected): (f64, f64) = (row[0].parse().unwrap(), row[column].parse().unwrap());
            let found = filter.step(input);
            assert!((found - expected).abs() < 1e-12, "{name}: {found} {expected}");
        }
    }
}

fn sensing(rate_hz: f64) -> Sensing {
    Sensing { rate_hz, noise_sd_n_m: NOISE_N_M, largest_reading_n_m: LARGEST_N_M, first_mode: FIRST_MODE }
}

fn detector() -> ContactDetector {
    ContactDetector::new(TouchConfig::default(), &sensing(RATE_HZ))
}

/// White measurement noise.
fn noise(seed: u64) -> impl FnMut() -> f64 {
    let mut rng = Pcg64Mcg::seed_from_u64(seed);
    move || NOISE_N_M * rng.sample::<f64, _>(StandardNormal)
}

/// Oscillation of a whisker released from unit deflection.
fn ringing(since_s: f64) -> f64 {
    let w = 2.0 * PI * FIRST_MODE.frequency_hz;
    let damped = w * (1.0 - FIRST_MODE.damping_ratio.powi(2)).sqrt();
    (-FIRST_MODE.damping_ratio * w * since_s).exp() * (damped * since_s).cos()
}

/// Free, pressed to `-depth_n_m` within 0.3 s from 1 s on, released at 2 s, free to the end.
fn press_and_release(t_s: f64, depth_n_m: f64) -> f64 {
    match t_s {
        ..1.0 => 0.0,
        1.0..2.0 => -depth_n_m * ((t_s - 1.0) / 0.3).min(1.0),
        _ => -depth_n_m * ringing(t_s - 2.0),
    }
}

/// Instants at which the detector's output changes.
fn changes(detector: &mut ContactDetector, rate_hz: f64, end_s: f64, mut reading: impl FnMut(f64) -> f64) -> Vec<f64> {
    let mut was = false;
    (0..(end_s * rate_hz) as usize)
        .filter_map(|row| {
            let t_s = row as f64 / rate_hz;
            let is = detector.step(reading(t_s), if row == 0 { 0.0 } else { 1.0 / rate_hz }).is_some();
            (std::mem::replace(&mut was, is) != is).then_some(t_s)
        })
        .collect()
}

#[test]
fn verif_every_detector_detects_a_press_and_its_release() {
    for row in DETECTORS {
        let mut detector = ContactDetector::new((row.config)(), &sensing(RATE_HZ));
        let mut noise = noise(1);
        let found = changes(&mut detector, RATE_HZ, 6.0, |t_s| press_and_release(t_s, 2e-5) + noise());
        assert!(found.len() >= 2, "{}: {found:?}", row.name);
        assert!((1.0..1.05).contains(&found[0]), "{}: {found:?}", row.name);
        assert!(found.iter().any(|at_s| (2.0..2.06).contains(at_s)), "{}: {found:?}", row.name);
        assert_eq!(detector.step(0.0, DT_S), None, "{}", row.name);
        let mut named = serde_json::to_value((row.config)()).unwrap();
        assert_eq!(named["detector"].take(), row.name);
    }
}

#[test]
fn verif_an_offset_of_the_sensor_is_no_touch_and_does_not_hide_one() {
    for row in DETECTORS {
        for (offset_n_m, rate_hz) in
            [(0.015, 250.0), (-0.02, 50.0)].map(|(share, rate_hz)| (share * LARGEST_N_M, rate_hz))
        {
            let mut detector = ContactDetector::new((row.config)(), &sensing(rate_hz));
            let mut noise = noise(1);
            let reading = |t_s| press_and_release(t_s, 2e-5) + offset_n_m + noise();
            let found = changes(&mut detector, rate_hz, 1.5, reading);
            assert!(found.len() == 1 && (1.0..1.1).contains(&found[0]), "{} {offset_n_m}: {found:?}", row.name);
            assert!((detector.rest_reading_n_m() - offset_n_m).abs() < NOISE_N_M, "{}", detector.rest_reading_n_m());
        }
    }
}

#[test]
fn verif_former_names_of_the_default_detector_and_its_settings_are_accepted() {
    let present = TouchConfig::default();
    let mut text = serde_json::to_string(&present).unwrap();
    for (former, name) in FORMER_NAMES {
        assert!(text.contains(&format!("\"{name}\"")), "{name}");
        text = text.replace(&format!("\"{name}\""), &format!("\"{former}\""));
    }
    assert_eq!(serde_json::from_str::<TouchConfig>(&text).unwrap(), present);
}

#[test]
fn verif_ringing_is_no_touch_at_any_depth_and_rate() {
    for rate_hz in [100.0, 250.0, 888.0] {
        for (seed, depth_n_m) in [(1, 3e-6), (2, 1e-5), (3, 5e-5)] {
            let mut detector = ContactDetector::new(TouchConfig::default(), &sensing(rate_hz));
            let mut noise = noise(seed);
            let found = changes(&mut detector, rate_hz, 6.0, |t_s| press_and_release(t_s, depth_n_m) + noise());
            assert_eq!(found.len(), 2, "{rate_hz} Hz, {depth_n_m} N m: {found:?}");
            let most_s = 0.04 + 6.0 / rate_hz;
            assert!((2.0..2.0 + most_s).contains(&found[1]), "{rate_hz} Hz, {depth_n_m} N m: {found:?}");
        }
    }
}

#[test]
fn verif_noise_is_no_touch() {
    for seed in 0..20 {
        let mut noise = noise(seed);
        assert_eq!(changes(&mut detector(), RATE_HZ, 20.0, |_| noise()), [0.0; 0]);
    }
}

#[test]
fn verif_a_touch_on_the_other_side_is_detected_while_the_whisker_rings() {
    let mut detector = detector();
    let mut noise = noise(1);
    let again_s = 2.3;
    let reading = |t_s: f64| {
        let free = press_and_release(t_s.min(again_s), 2e-5);
        free + (1e-4 * (t_s - again_s)).clamp(0.0, 2e-5)
    };
    let found = changes(&mut detector, RATE_HZ, 3.0, |t_s| reading(t_s) + noise());
    assert_eq!(found.len(), 3, "{found:?}");
    assert!((again_s..again_s + 0.1).contains(&found[2]), "{found:?}");
    assert_eq!(detector.step(2e-5, DT_S), Some(Face::Right));
}

#[test]
fn verif_a_press_is_detected_on_a_vibrating_arm() {
    let mut noise = noise(1);
    let mut detector = detector();
    let shaken = |t_s: f64| 1e-6 * ((50.0 * t_s).sin() + (71.0 * t_s).sin() + (33.0 * t_s).cos());
    let found = changes(&mut detector, RATE_HZ, 4.0, |t_s| press_and_release(t_s, 2e-5) + shaken(t_s) + noise());
    let late: Vec<f64> = found.into_iter().filter(|&at_s| at_s > 0.9).collect();
    assert_eq!(late.len(), 2, "{late:?}");
}

#[test]
fn robust_outliers_and_dropouts_are_no_events() {
    // Two outliers among five readings may have any value.
    for bad_n_m in [0.0, 1e-3, -1e-3] {
        let mut noise = noise(1);
        let found = changes(&mut detector(), RATE_HZ, 2.0, |t_s| {
            let row = (t_s * RATE_HZ).round() as usize;
            if row > 10 && row % 40 < 2 { bad_n_m } else { press_and_release(t_s, 2e-5) + noise() }
        });
        assert_eq!(found.len(), 1, "{bad_n_m}: {found:?}");
        assert!((1.0..1.05).contains(&found[0]), "{bad_n_m}: {found:?}");
    }
}

#[test]
fn robust_missing_rows_are_interpolated() {
    let mut detector = detector();
    let mut noise = noise(1);
    let mut found = Vec::new();
    let (mut was, mut last_s) = (false, 0.0);
    for row in (0..1500).filter(|row| row % 7 != 0 && !(300..320).contains(row)) {
        let t_s = f64::from(row) * DT_S;
        let is = detector.step(press_and_release(t_s, 2e-5) + noise(), t_s - last_s).is_some();
        last_s = t_s;
        if std::mem::replace(&mut was, is) != is {
            found.push(t_s);
        }
    }
    assert_eq!(found.len(), 2, "{found:?}");
    assert!((2.0..2.06).contains(&found[1]), "{found:?}");
}

#[test]
fn robust_a_recording_that_begins_in_contact_or_has_a_long_gap() {
    let mut detector = detector();
    let held = |detector: &mut ContactDetector, rows: usize| {
        (0..rows)
            .map(|row| detector.step(2e-5, if row == 0 { 3.0 } else { DT_S }))
            .position(|touched| touched.is_some())
    };
    assert_eq!(held(&mut detector, 20), Some(2), "a touch requires three consecutive samples");
    assert_eq!(held(&mut detector, 20), Some(2), "after a long gap as well");
}
