//! Watermarks of calibrations and runs: they identify inputs and code.

use files::Watermark;
use serde_json::Value;
use testbed::provenance::watermark;

/// Watermark of a calibration: of its inputs and of the code that computes calibrations.
pub(crate) fn calibration_watermark<'a>(inputs: impl IntoIterator<Item = &'a str>) -> Watermark {
    watermark([env!("WHISKER_CALIBRATION_SHA256")].into_iter().chain(inputs))
}

/// Watermark of a run: of its inputs and of the code that computes estimates and scores.
pub(crate) fn evaluation_watermark<'a>(inputs: impl IntoIterator<Item = &'a str>) -> Watermark {
    watermark([env!("WHISKER_EVALUATION_SHA256")].into_iter().chain(inputs))
}

/// Inputs of the scores of a trace: the hash of its data, and its scene, which states friction, motion and yielding of the object.
pub(crate) fn scored_inputs(data_sha256: &str, scene: &Value) -> String {
    format!("{data_sha256}{scene}")
}
