//! Valid files that accompany the untrusted one.

use std::sync::{Arc, LazyLock};

use files::sha256;
use serde_json::{Value, json};
use strict_json::parse_json;
use trace::{CalibrationFile, FaceFile};
use whisker::estimators::{BaseNoise, Knowledge};

use crate::scratch;

/// Name of the golden trace.
pub(crate) const TRACE: &str = "golden_pin";

/// Table of the golden trace.
pub(crate) const CSV: &str = include_str!("../../../datasets/golden/golden_pin.csv");

/// Outline of the golden trace.
pub(crate) const CONTOUR: &str = include_str!("../../../datasets/golden/golden_pin.contour.csv");

/// Calibration of its whisker.
const CALIBRATION: &[u8] = include_bytes!("../../../fuzz/corpus/calibration/polynomial.json");

/// Sidecar of the golden trace.
pub(crate) fn sidecar() -> Value {
    parse_json(include_bytes!("../../../datasets/golden/golden_pin.json")).expect("a golden file")
}

/// Calibration with a corrected hash of its faces, if they can be parsed.
pub(crate) fn with_hash(mut calibration: Value) -> Value {
    let faces = calibration.get("faces").cloned().unwrap_or_default();
    if let Ok(faces) = serde_json::from_value::<Vec<FaceFile>>(faces) {
        calibration["faces_sha256"] = json!(sha256(serde_json::to_vec(&faces).expect("it serialises")));
    }
    calibration
}

/// Prior information of an estimator with that calibration.
pub(crate) static KNOWLEDGE: LazyLock<Arc<Knowledge>> = LazyLock::new(|| {
    let path = scratch::file(
        "golden_calibration.json",
        with_hash(parse_json(CALIBRATION).expect("a golden file")).to_string(),
    );
    let file = CalibrationFile::read(&path).expect("a golden file");
    Arc::new(Knowledge {
        rest: file.whisker.rest_shape(),
        faces: file.calibrated(&path, None).expect("a golden file"),
        whisker: file.whisker,
        noise_sd_n_m: 1e-7,
        base_noise: BaseNoise::default(),
        rate_hz: 250.0,
        contact_prior: None,
    })
});
