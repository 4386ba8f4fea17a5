//! Watermarks of calibrations and runs: they identify inputs and code.

use files::Watermark;
use testbed::provenance::watermark;

/// Watermark of a calibration: of its inputs and of the code that computes calibrations.
pub(crate) fn calibration_watermark<'a>(inputs: impl IntoIterator<Item = &'a str>) -> Watermark {
    watermark([env!("WHISKER_CALIBRATION_SHA256")].into_iter().chain(inputs))
}

/// Watermark of a run: of its inputs and of the code that computes estimates and scores.
pub(crate) fn evaluation_watermark<'a>(inputs: impl IntoIterator<Item = &'a str>) -> Watermark {
    watermark([env!("WHISKER_EVALUATION_SHA256")].into_iter().chain(inputs))
}
