//! Watermarks of what this program writes.

use files::{Digest, Watermark};

/// The watermark of a file that these pieces of input determine, together with this program's sources.
pub fn watermark<'a>(inputs: impl IntoIterator<Item = &'a str>) -> Watermark {
    let mut digest = Digest::default();
    digest.add(env!("WHISKER_SOURCE_SHA256"));
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
