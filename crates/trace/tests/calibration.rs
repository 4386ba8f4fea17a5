//! Calibration files: writing, reading and rejection of invalid files.

use std::path::Path;

use files::{Watermark, read_json, write_json};
use serde_json::{Value, json};
use trace::{CalibrationFile, Characteristic, FaceFile, FittedData, SensorFile};
use whisker::Whisker;
use whisker::elastica::Elastica;
use whisker::sensor::{self, Face, Fit, FitData, PinFriction, Sample};

fn whisker() -> Whisker {
    Whisker { damping_s: 0.0, ..Whisker::straight() }
}

/// Fits of each registered model with its default settings to samples of the exact elastica.
fn fits() -> Vec<Fit> {
    let whisker = whisker();
    let elastica = Elastica::new(&whisker).unwrap();
    let rest = whisker.rest_shape();
    let trace = |phase: f64| -> Vec<Sample> {
        let places = (0..20).flat_map(|i| (0..12).map(move |j| (f64::from(i) + phase, f64::from(j) + phase)));
        places
            .filter_map(|(i, j)| {
                let arc_m = 0.02 + 0.05 * i / 20.0;
                let contact = rest.beside(arc_m, -0.3 * arc_m * j / 12.0);
                let found = elastica.at_point(contact).ok()?;
                Some(Sample { contact, reading_n_m: found.deflection.moment_n_m })
            })
            .collect()
    };
    let traces = [trace(0.0), trace(0.5)];
    let material = FitData {
        whisker: &whisker,
        face: Face::Left,
        measured: &traces,
        reference: &traces,
        reference_noise_sd_n_m: 0.0,
        pin_radius_m: 0.0,
    };
    sensor::MODELS.iter().map(|row| sensor::fit(row, &(row.defaults)(), &material).unwrap()).collect()
}

fn calibration(fits: &[Fit]) -> CalibrationFile {
    let faces = vec![FaceFile::new(fits, None).unwrap()];
    let watermark =
        Watermark { tool: "test".into(), version: "0".into(), git_commit: None, inputs_sha256: String::new() };
    let data = FittedData { seed: 1, traces: vec!["trace".into()], ..FittedData::default() };
    CalibrationFile::new(whisker(), data, faces, watermark)
}

#[test]
fn robust_friction_is_kept_and_checked() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("with_friction.json");
    let friction = PinFriction { coefficient: 0.3, coefficient_sd: 0.01 };
    let plain = calibration(&fits());
    let faces = vec![FaceFile { friction: Some(friction), ..plain.faces[0].clone() }];
    let data = FittedData { traces: plain.traces.clone(), ..FittedData::default() };
    let file = CalibrationFile::new(whisker(), data.clone(), faces.clone(), plain.watermark.clone());
    write_json(&path, &file).unwrap();
    assert_eq!(CalibrationFile::read(&path).unwrap().faces[0].friction, Some(friction));
    let negative = PinFriction { coefficient: -0.3, ..friction };
    let faces = vec![FaceFile { friction: Some(negative), ..faces[0].clone() }];
    write_json(&path, &CalibrationFile::new(whisker(), data, faces, plain.watermark)).unwrap();
    let error = CalibrationFile::read(&path).unwrap_err().to_string();
    assert!(error.contains("faces.left.friction.coefficient: found -0.3, expected a number of 0 or more"), "{error}");
}

/// Error message for a changed file; it must be one line.
fn refused(path: &Path, change: impl FnOnce(&mut Value)) -> String {
    let mut file: Value = read_json(path).unwrap();
    change(&mut file);
    let changed = path.with_file_name("changed.json");
    write_json(&changed, &file).unwrap();
    let error = CalibrationFile::read(&changed).unwrap_err().to_string();
    assert_eq!(error.lines().count(), 1, "{error}");
    error
}

#[test]
fn verif_models_are_selected_by_label_and_the_best_is_the_default() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("straight.json");
    let fits = fits();
    write_json(&path, &calibration(&fits)).unwrap();
    let file = CalibrationFile::read(&path).unwrap();
    assert_eq!(file, calibration(&fits));

    for fit in &fits {
        let faces = file.calibrated(&path, Some(&fit.face.label)).unwrap();
        assert_eq!(faces[0].label, fit.face.label);
        let contact = whisker().rest_shape().beside(0.05, -0.006);
        assert_eq!(faces[0].model.reading_n_m(contact).to_bits(), fit.face.model.reading_n_m(contact).to_bits());
        assert_eq!(faces[0].model_variance_n2_m2(contact), fit.face.model_variance_n2_m2(contact));
    }
    let best = fits.iter().map(|fit| fit.face.heldout_rms_n_m).fold(f64::INFINITY, f64::min);
    assert_eq!(file.calibrated(&path, None).unwrap()[0].heldout_rms_n_m, best);
}

#[test]
fn robust_errors_state_file_and_key() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("straight.json");
    let file = calibration(&fits());
    write_json(&path, &file).unwrap();

    let error = file.calibrated(&path, Some("polynomial-8")).unwrap_err().to_string();
    for word in ["straight.json", "faces.left.models", "polynomial-8", "polynomial-5", "elastica"] {
        assert!(error.contains(word), "{error}");
    }
    let mut other = file.clone();
    other.faces[0].models[0].model["colour"] = json!(vec![0.125; 1000]);
    let label = other.faces[0].models[0].label.clone();
    let error = other.calibrated(&path, Some(&label)).unwrap_err().to_string();
    assert!(error.contains(&format!("straight.json: faces.left.models.{label}.model: sensor model `")), "{error}");
    assert!(error.contains("colour") && !error.contains("0.125"), "{error}");
    assert!(error.ends_with(", expected a model as `whisker fit` stores it; fit it again"), "{error}");

    let by_hand = refused(&path, |file| file["faces"][0]["largest_reading_n_m"] = 1.0.into());
    assert!(by_hand.contains("faces_sha256"), "{by_hand}");
}

#[test]
fn verif_the_sensor_of_recordings_is_stored_and_is_the_only_one() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("straight.json");
    let characteristic = Characteristic::new(vec![-3e7, 0.0, -1.2e15], [-6e-5, 0.0]).unwrap();
    let sensor = SensorFile::recorded("straight", characteristic, 1e-7);
    let stored = CalibrationFile { sensor: Some(sensor.clone()), ..calibration(&fits()) };
    write_json(&path, &stored).unwrap();
    let file = CalibrationFile::read(&path).unwrap();
    assert_eq!(file, stored);
    for label in [None, Some("straight.straight")] {
        assert_eq!(file.sensor_of_counts(&path, label).unwrap(), &sensor);
    }

    let other = file.sensor_of_counts(&path, Some("a.s")).unwrap_err().to_string();
    assert!(other.ends_with("straight.json: sensor: found straight.straight, expected `a.s` among them"), "{other}");
    let none = calibration(&fits()).sensor_of_counts(&path, None).unwrap_err().to_string();
    assert!(none.contains("straight.json: sensor: found none, expected one"), "{none}");

    let two = refused(&path, |file| {
        file["front_end"] = json!({"name": "hall", "config": {}, "sensors": [file["sensor"]]});
    });
    assert!(two.ends_with("sensor: found one beside `front_end`, expected one of the two"), "{two}");
    let falls = refused(&path, |file| file["sensor"]["characteristic"]["range_n_m"] = json!([1e-5, 2e-5]));
    assert!(falls.contains("changed.json: sensor.characteristic: found"), "{falls}");
    let noise = refused(&path, |file| file["sensor"]["noise_sd_n_m"] = json!(-1));
    assert!(noise.ends_with("sensor.noise_sd_n_m: found -1, expected a number of 0 or more"), "{noise}");
}
