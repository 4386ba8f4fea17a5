//! Watermarks of what this program writes, and whether a result is still that of its inputs.

use std::fs;
use std::sync::OnceLock;

use anyhow::Context;
use trace::{Digest, Watermark, sha256};

/// The watermark of a file that these pieces of input determine, together with this very program.
///
/// # Errors
/// If the program cannot read itself.
pub fn watermark<'a>(inputs: impl IntoIterator<Item = &'a str>) -> anyhow::Result<Watermark> {
    let mut digest = Digest::default();
    digest.add(program_sha256()?);
    for piece in inputs {
        digest.add(piece);
    }
    Ok(Watermark {
        tool: "whisker".into(),
        version: env!("CARGO_PKG_VERSION").into(),
        git_commit: option_env!("WHISKER_GIT_COMMIT").map(Into::into),
        inputs_sha256: digest.finish(),
    })
}

fn program_sha256() -> anyhow::Result<&'static str> {
    static HASH: OnceLock<String> = OnceLock::new();
    if let Some(hash) = HASH.get() {
        return Ok(hash);
    }
    let path = std::env::current_exe().context("cannot find the running program")?;
    let bytes = fs::read(&path).with_context(|| path.display().to_string())?;
    Ok(HASH.get_or_init(|| sha256(bytes)))
}
