//! What can be wrong with a port, a device or a file: always which one, what was found and what was expected.

use std::path::Path;

/// Why the platform did not do what it was asked to.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// A recording of messages cannot be kept.
    #[error(transparent)]
    Bag(#[from] bag::Error),
    /// A port cannot be opened.
    #[error("{port}: cannot be opened: {reason}")]
    Open {
        /// The port.
        port: String,
        /// The system's answer.
        reason: serialport::Error,
    },
    /// A port was there and is gone.
    #[error("{port}: gone after {after_s:.1} s ({reason}); is the cable plugged in?")]
    Gone {
        /// The port.
        port: String,
        /// When, since it was opened.
        after_s: f64,
        /// The system's answer.
        reason: std::io::Error,
    },
    /// A sensor says nothing.
    #[error(
        "{port}: found no byte for {for_s:.1} s after {samples} samples, expected some {rate_hz:.0} samples a second"
    )]
    Silent {
        /// The port.
        port: String,
        /// How long it has been silent.
        for_s: f64,
        /// Samples before.
        samples: u64,
        /// How many a second there should be.
        rate_hz: f64,
    },
    /// A sensor says nothing that its format knows.
    #[error(
        "{port}: found no sample in {lines} lines, such as {example}, expected lines of the format `{format}`: {about}"
    )]
    Foreign {
        /// The port.
        port: String,
        /// How many lines there were.
        lines: u64,
        /// One of them.
        example: String,
        /// Name of the format.
        format: &'static str,
        /// What it looks like.
        about: &'static str,
    },
    /// Samples arrived faster than they were taken.
    #[error("{port}: {lost} samples were overwritten because nobody took them in time, expected none")]
    Overrun {
        /// The port.
        port: String,
        /// How many.
        lost: u64,
    },
    /// A printer does not answer.
    #[error("{port}: no answer to `{command}` within {within_s:.0} s, expected `ok`")]
    NoAnswer {
        /// The port.
        port: String,
        /// What was sent.
        command: String,
        /// How long it was waited for.
        within_s: f64,
    },
    /// A printer does not want to.
    #[error("{port}: `{command}` was answered by `{answer}`, expected `ok`")]
    Refused {
        /// The port.
        port: String,
        /// What was sent.
        command: String,
        /// The printer's words.
        answer: String,
    },
    /// A printer is not where it was sent.
    #[error("{port}: the head stands at {found} mm, expected {expected} mm")]
    Astray {
        /// The port.
        port: String,
        /// Where the head is.
        found: String,
        /// Where it should be.
        expected: String,
    },
    /// A printer does not know where its head is.
    #[error("{port}: `{command}` before homing; found an unknown position, expected `home` first")]
    NotHomed {
        /// The port.
        port: String,
        /// What was to be sent.
        command: String,
    },
    /// A number is out of its range.
    #[error("{what}: found {found}, expected {expected}")]
    Range {
        /// What it is.
        what: String,
        /// What it is set to.
        found: String,
        /// What it may be.
        expected: String,
    },
    /// Somebody stopped it.
    #[error("interrupted; the printer was stopped at once and must be reset before it moves again")]
    Interrupted,
    /// What else keeps a thread or a pseudo-terminal from working.
    #[error("{what}: {reason}")]
    System {
        /// What was to be done.
        what: String,
        /// The system's answer.
        reason: std::io::Error,
    },
    /// A file is wrong.
    #[error(transparent)]
    File(#[from] files::Error),
}

impl Error {
    pub(crate) fn file(path: &Path) -> impl FnOnce(std::io::Error) -> Self + '_ {
        move |reason| Self::File(files::Error::Io { path: path.into(), reason })
    }

    /// What the system said about this.
    pub fn system(what: impl Into<String>) -> impl FnOnce(std::io::Error) -> Self {
        let what = what.into();
        move |reason| Self::System { what, reason }
    }
}
