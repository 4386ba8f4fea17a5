//! What wrote a file.

use serde::{Deserialize, Serialize};

/// What wrote a file, and from what.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Watermark {
    /// The program.
    pub tool: String,
    /// Its version.
    pub version: String,
    /// Commit from which it was built, where known.
    pub git_commit: Option<String>,
    /// Hash over all that determines the file: inputs, settings, seeds, the program.
    pub inputs_sha256: String,
}
