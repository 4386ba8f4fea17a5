//! What can be wrong with a recording: always which file, where in it, what was found and what was expected.

use std::path::{Path, PathBuf};

/// Longest piece of a recording that an error repeats, in characters.
const LONGEST: usize = 500;

/// A text as one line that is safe to show: what would end the line or speak to the terminal is written out, as `\n` is.
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

/// The path of a file on one line: a recording names its files itself.
fn at(path: &Path) -> String {
    shown(&path.display().to_string())
}

/// Why a recording could not be read or written, or a message not sent.
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
    /// What a file holds is not what it should.
    #[error("{}: {}: found {}, expected {}", at(path), shown(place), shown(found), shown(expected))]
    Content {
        /// The file.
        path: PathBuf,
        /// Where in it: a key, a topic, a message.
        place: String,
        /// What stands there.
        found: String,
        /// What should.
        expected: String,
    },
    /// A message that could not be sent.
    #[error("{}: {}", shown(topic), shown(reason))]
    Live {
        /// The topic.
        topic: String,
        /// What the connection says.
        reason: String,
    },
}

impl Error {
    pub(crate) fn io(path: &Path) -> impl FnOnce(std::io::Error) -> Self + '_ {
        move |reason| Self::Io { path: path.into(), reason }
    }

    /// What a file holds is not what it should.
    pub fn content(
        path: &Path,
        place: impl Into<String>,
        found: impl std::fmt::Display,
        expected: impl std::fmt::Display,
    ) -> Self {
        // Libraries draw pictures of what they dislike; one line is enough.
        let found = found.to_string();
        let found = found.lines().find(|line| !line.trim().is_empty()).unwrap_or_default().trim().to_owned();
        Self::Content { path: path.into(), place: place.into(), found, expected: expected.to_string() }
    }
}
