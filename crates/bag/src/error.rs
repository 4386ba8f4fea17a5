//! Errors of recordings. Each names the file, the place in it, the content found and the content expected.

use std::path::{Path, PathBuf};

/// Longest quotation of a recording in an error, in characters.
const LONGEST: usize = 500;

/// Text as one line: control characters, such as line ends, are escaped.
fn shown(text: &str) -> String {
    let mut line = String::new();
    for (i, c) in text.chars().enumerate() {
        match c {
            _ if i == LONGEST => return line + "...",
            c if c.is_control() => line.extend(c.escape_default()),
            c => line.push(c),
        }
    }
    line
}

/// Path of a file as one line. Names of files may come from a recording.
fn at(path: &Path) -> String {
    shown(&path.display().to_string())
}

/// Error of reading or writing a recording, or of sending a message.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// A system call failed.
    #[error("{}: {reason}", at(path))]
    Io {
        /// The file.
        path: PathBuf,
        /// Reason given by the system.
        reason: std::io::Error,
    },
    /// The content of a file is invalid.
    #[error("{}: {}: found {}, expected {}", at(path), shown(place), shown(found), shown(expected))]
    Content {
        /// The file.
        path: PathBuf,
        /// Place in the file: a key, a topic, a message.
        place: String,
        /// Content found.
        found: String,
        /// Content expected.
        expected: String,
    },
    /// A message that could not be sent.
    #[error("{}: {}", shown(topic), shown(reason))]
    Live {
        /// The topic.
        topic: String,
        /// Reason given by the connection.
        reason: String,
    },
}

impl Error {
    pub(crate) fn io(path: &Path) -> impl FnOnce(std::io::Error) -> Self + '_ {
        move |reason| Self::Io { path: path.into(), reason }
    }

    /// The content of a file is invalid.
    pub fn content(
        path: &Path,
        place: impl Into<String>,
        found: impl std::fmt::Display,
        expected: impl std::fmt::Display,
    ) -> Self {
        // Messages of libraries may have several lines.
        let found = found.to_string();
        let found = found.lines().find(|line| !line.trim().is_empty()).unwrap_or_default().trim().to_owned();
        Self::Content { path: path.into(), place: place.into(), found, expected: expected.to_string() }
    }
}
