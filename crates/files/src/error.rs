//! Errors of files: path, place, value found and value expected.

use std::io;
use std::path::{Path, PathBuf};

use strict_json::{one_line, reason, shown};

/// Path in one line.
fn at(path: &Path) -> String {
    one_line(&path.display().to_string())
}

/// Line and column, if they are known.
fn position(line: usize, column: usize) -> String {
    if line > 0 { format!(":{line}:{column}") } else { String::new() }
}

/// Words of an error of the operating system, which for a folder do not say what was expected.
fn of_system(reason: &io::Error) -> String {
    match reason.kind() {
        io::ErrorKind::IsADirectory => "found a folder, expected a file".into(),
        _ => reason.to_string(),
    }
}

/// Failure to read or write a file.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// The operating system reported an error.
    #[error("{}: {}", at(path), of_system(reason))]
    Io {
        /// The file.
        path: PathBuf,
        /// Error of the operating system.
        reason: io::Error,
    },
    /// A cell or a row of a table is invalid.
    #[error("{}:{line}: {}: found {}, expected {}", at(path), shown(place), shown(found), shown(expected))]
    Table {
        /// The file.
        path: PathBuf,
        /// Line, from 1.
        line: u64,
        /// Column by name, or `header`, or `row`.
        place: String,
        /// Text found.
        found: String,
        /// Text expected.
        expected: String,
    },
    /// A JSON file does not parse, or has unknown, missing or ill-typed keys.
    #[error("{}{}: {}", at(path), position(*line, *column), shown(message))]
    Json {
        /// The file.
        path: PathBuf,
        /// Line, from 1. 0 if the message names the place.
        line: usize,
        /// Column in that line, from 1.
        column: usize,
        /// Message of the parser.
        message: String,
    },
    /// An output would replace a file of another kind.
    #[error(
        "{}: found something other than {kind}, expected such a file or none, since the output would replace it; give \
         another --out, or remove it",
        at(path)
    )]
    Foreign {
        /// The file.
        path: PathBuf,
        /// Kind of the output.
        kind: String,
    },
    /// A value that a program stored cannot be loaded. The value itself would be of no use to the reader.
    #[error("{}: {}: {}, expected {}", at(path), shown(key), shown(reason), shown(expected))]
    Stored {
        /// The file.
        path: PathBuf,
        /// Key of the value.
        key: String,
        /// Why it cannot be loaded.
        reason: String,
        /// Value expected.
        expected: String,
    },
    /// A well-formed value is invalid.
    #[error("{}: {}: found {}, expected {}", at(path), shown(key), shown(found), shown(expected))]
    Value {
        /// The file.
        path: PathBuf,
        /// Key of the value.
        key: String,
        /// Value found.
        found: String,
        /// Value expected.
        expected: String,
    },
}

impl Error {
    /// Wraps an error of the operating system on this file.
    pub fn io(path: &Path) -> impl FnOnce(io::Error) -> Self + '_ {
        move |reason| Self::Io { path: path.into(), reason }
    }

    /// Wraps a JSON error of this file.
    pub fn json(path: &Path) -> impl FnOnce(serde_json::Error) -> Self + '_ {
        move |error| {
            // The place precedes the message.
            Self::Json { path: path.into(), line: error.line(), column: error.column(), message: reason(&error) }
        }
    }

    /// Error of a well-formed but invalid value at `key`.
    pub fn value(
        path: &Path,
        key: impl Into<String>,
        found: impl std::fmt::Display,
        expected: impl std::fmt::Display,
    ) -> Self {
        Self::Value { path: path.into(), key: key.into(), found: found.to_string(), expected: expected.to_string() }
    }
}
