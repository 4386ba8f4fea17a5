//! Watermarks of the files that this program writes.

use files::{Digest, Watermark};

/// Watermark of a calibration that these inputs determine, together with the code that computes calibrations.
pub fn calibration_watermark<'a>(inputs: impl IntoIterator<Item = &'a str>) -> Watermark {
    watermark([env!("WHISKER_CALIBRATION_SHA256")].into_iter().chain(inputs))
}

/// Watermark of a run that these inputs determine, together with the code that computes estimates and scores.
pub fn evaluation_watermark<'a>(inputs: impl IntoIterator<Item = &'a str>) -> Watermark {
    watermark([env!("WHISKER_EVALUATION_SHA256")].into_iter().chain(inputs))
}

/// Watermark of any other file that these inputs determine. The program is identified by version and commit alone.
pub fn watermark<'a>(inputs: impl IntoIterator<Item = &'a str>) -> Watermark {
    let mut digest = Digest::default();
    for piece in inputs {
        digest.add(piece);
    }
    Watermark {
        tool: "whisker".into(),
        version: env!("CARGO_PKG_VERSION").into(),
        git_commit: option_env!("WHISKER_GIT_COMMIT").map(Into::into),
        inputs_sha256: digest.finish(),
    }
}
