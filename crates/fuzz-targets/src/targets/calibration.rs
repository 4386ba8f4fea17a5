//! Calibration file with a corrected hash of its faces, so that the parser gets past the hash.

use serde_json::Value;
use strict_json::parse_json;
use trace::CalibrationFile;
use whisker::sensor::AlongAway;

use crate::golden::with_hash;
use crate::properties::{one_error, same_json};
use crate::scratch;

const FILE: &str = "untrusted_calibration.json";

/// Number of intervals along and away at which a model is evaluated.
const NODES: u32 = 4;

pub(super) fn run(bytes: &[u8]) {
    let path = match parse_json::<Value>(bytes) {
        Ok(value) => scratch::file(FILE, with_hash(value).to_string()),
        Err(_) => scratch::file(FILE, bytes),
    };
    let Some(file) = one_error(CalibrationFile::read(&path), FILE) else { return };
    let text = serde_json::to_value(&file).expect("it serialises");
    same_json(&parse_json(&std::fs::read(&path).expect("it is there")).expect("it was read"), &text);
    for label in file.faces.iter().flat_map(|face| &face.models).map(|model| model.label.as_str()) {
        let Some(faces) = one_error(file.calibrated(&path, Some(label)), FILE) else { continue };
        for face in faces {
            let (low_m, high_m) = face.domain.arc_range_m();
            for (i, j) in (0..=NODES).flat_map(|i| (0..=NODES).map(move |j| (i, j))) {
                let share = |node: u32| f64::from(node) / f64::from(NODES);
                let arc_m = low_m + share(i) * (high_m - low_m);
                let (lower_m, upper_m) = face.domain.away_range_m(arc_m);
                let contact = face.contact_at(AlongAway::new(arc_m, lower_m + share(j) * (upper_m - lower_m)));
                face.predict(contact);
                face.model_variance_n2_m2(contact);
                face.model.tangent_rad(contact);
            }
        }
    }
    for sensor in file.sensors() {
        for counts in [-1e6, 0.0, 1e6] {
            sensor.characteristic.moment_n_m(counts);
        }
    }
    let path = scratch::file(FILE, text.to_string());
    assert_eq!(CalibrationFile::read(&path).expect("written data can be read"), file);
}
