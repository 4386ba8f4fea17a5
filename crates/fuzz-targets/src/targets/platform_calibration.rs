//! Calibration of the platform.

use platform::calibration::Calibration;
use serde_json::Value;
use strict_json::parse_json;

use crate::properties::{one_error, same_json};
use crate::scratch;

const FILE: &str = "untrusted_platform.json";

pub(super) fn run(bytes: &[u8]) {
    let path = scratch::file(FILE, bytes);
    let Some(calibration) = one_error(Calibration::read(&path), FILE) else { return };
    for press in calibration.presses() {
        if let Some(estimate) = calibration.estimate(&press.features) {
            assert!(estimate.distance_m.is_finite());
            assert!(estimate.interval_m.is_none_or(|ends| ends.iter().all(|end| !end.is_nan())));
        }
    }
    let again = scratch::file("again_platform.json", "");
    calibration.write(&again).expect("it was made to be written to");
    let text = std::fs::read(&again).expect("it was written");
    same_json(&without_scores(bytes), &without_scores(&text));
    Calibration::read(&again).expect("written data can be read").write(&again).expect("as before");
    assert_eq!(std::fs::read(&again).expect("it was written"), text);
}

/// The scores are computed from the presses and not read.
fn without_scores(bytes: &[u8]) -> Value {
    let mut value: Value = parse_json(bytes).expect("it was read");
    value.as_object_mut().expect("it has keys").remove("scores");
    value
}
