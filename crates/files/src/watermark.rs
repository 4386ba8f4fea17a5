//! Provenance of a generated file.

use serde::{Deserialize, Serialize};

/// Provenance of a generated file: program and inputs.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Watermark {
    /// Name of the program.
    pub tool: String,
    /// Version of the program.
    pub version: String,
    /// Commit from which the program was built, if known.
    pub git_commit: Option<String>,
    /// Hash of everything that determines the file: inputs, settings, seeds and program.
    pub inputs_sha256: String,
}
