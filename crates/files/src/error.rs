//! What can be wrong with a file: always which file, where in it, what was found and what was expected.

use std::path::{Path, PathBuf};

use strict_json::{one_line, shown};

/// The path of a file on one line.
fn at(path: &Path) -> String {
    one_line(&path.display().to_string())
}

/// Why a file could not be read or written.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// The system refused.
    #[error("{}: {reason}", at(path))]
    Io {
        /// The file.
        path: PathBuf,
        /// The system's answer.
        reason: std::io::Error,
    },
    /// A cell or a line of a table is wrong.
    #[error("{}:{line}: {}: found {}, expected {}", at(path), shown(place), shown(found), shown(expected))]
    Table {
        /// The file.
        path: PathBuf,
        /// Line, from 1.
        line: u64,
        /// Column by name, or `header`, or `row`.
        place: String,
        /// What stands there.
        found: String,
        /// What should.
        expected: String,
    },
    /// A JSON file does not parse, or has unknown, missing or ill-typed keys.
    #[error("{}:{line}:{column}: {}", at(path), shown(message))]
    Json {
        /// The file.
        path: PathBuf,
        /// Line, from 1.
        line: usize,
        /// Column in that line, from 1.
        column: usize,
        /// What the parser says.
        message: String,
    },
    /// A value that parses is wrong.
    #[error("{}: {}: found {}, expected {}", at(path), shown(key), shown(found), shown(expected))]
    Value {
        /// The file.
        path: PathBuf,
        /// Key of the value.
        key: String,
        /// What stands there.
        found: String,
        /// What should.
        expected: String,
    },
}

impl Error {
    /// An error of the operating system on this file.
    pub fn io(path: &Path) -> impl FnOnce(std::io::Error) -> Self + '_ {
        move |reason| Self::Io { path: path.into(), reason }
    }

    /// What a file holds is no JSON, or not that which it should be.
    pub fn json(path: &Path) -> impl FnOnce(serde_json::Error) -> Self + '_ {
        move |error| {
            // serde_json appends the place, which stands in front here.
            let text = error.to_string();
            let message = text.split(" at line ").next().unwrap_or(&text).to_owned();
            Self::Json { path: path.into(), line: error.line(), column: error.column(), message }
        }
    }

    /// A value that parses is wrong.
    pub fn value(
        path: &Path,
        key: impl Into<String>,
        found: impl std::fmt::Display,
        expected: impl std::fmt::Display,
    ) -> Self {
        Self::Value { path: path.into(), key: key.into(), found: found.to_string(), expected: expected.to_string() }
    }
}
