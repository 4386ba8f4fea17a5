//! Watermarks of the files that this program writes.

use files::{Digest, Watermark};

/// Watermark of a file with these inputs. The program is identified by version and commit.
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
