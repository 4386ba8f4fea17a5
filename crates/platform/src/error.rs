//! Errors of ports, devices and files. Each names the port or file, the value found and the value expected.

use std::path::Path;

/// Error of the platform.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// A ROS 2 recording cannot be written.
    #[error(transparent)]
    Bag(#[from] bag::Error),
    /// A port cannot be opened.
    #[error("{port}: cannot be opened: {reason}")]
    Open {
        /// The port.
        port: String,
        /// Reason given by the system.
        reason: serialport::Error,
    },
    /// An open port vanished.
    #[error("{port}: gone after {after_s:.1} s ({reason}); is the cable plugged in?")]
    Gone {
        /// The port.
        port: String,
        /// Time since it was opened (s).
        after_s: f64,
        /// Reason given by the system.
        reason: std::io::Error,
    },
    /// A sensor is silent.
    #[error(
        "{port}: found no byte for {for_s:.1} s after {samples} samples, expected some {rate_hz:.0} samples a second"
    )]
    Silent {
        /// The port.
        port: String,
        /// Duration of the silence (s).
        for_s: f64,
        /// Number of samples before the silence.
        samples: u64,
        /// Expected sampling rate (Hz).
        rate_hz: f64,
    },
    /// No line of a sensor is of its format.
    #[error(
        "{port}: found no sample in {lines} lines, such as {example}, expected lines of the format `{format}`: {about}"
    )]
    Foreign {
        /// The port.
        port: String,
        /// Number of lines.
        lines: u64,
        /// One of the lines.
        example: String,
        /// Name of the format.
        format: &'static str,
        /// Description of the format.
        about: &'static str,
    },
    /// Samples arrived faster than they were processed.
    #[error("{port}: {lost} samples were overwritten because they were not processed in time, expected none")]
    Overrun {
        /// The port.
        port: String,
        /// Number of overwritten samples.
        lost: u64,
    },
    /// A printer does not answer.
    #[error("{port}: no answer to `{command}` within {within_s:.0} s, expected `ok`")]
    NoAnswer {
        /// The port.
        port: String,
        /// Command that was sent.
        command: String,
        /// Time limit of the answer (s).
        within_s: f64,
    },
    /// A printer refuses a command.
    #[error("{port}: `{command}` was answered by `{answer}`, expected `ok`")]
    Refused {
        /// The port.
        port: String,
        /// Command that was sent.
        command: String,
        /// Answer of the printer.
        answer: String,
    },
    /// The head is not at its target.
    #[error("{port}: the head stands at {found} mm, expected {expected} mm")]
    Astray {
        /// The port.
        port: String,
        /// Position of the head.
        found: String,
        /// Target position.
        expected: String,
    },
    /// A move was requested before homing.
    #[error("{port}: `{command}` before homing; found an unknown position, expected `home` first")]
    NotHomed {
        /// The port.
        port: String,
        /// Command that was not sent.
        command: String,
    },
    /// A value is out of range.
    #[error("{what}: found {found}, expected {expected}")]
    Range {
        /// Name of the value.
        what: String,
        /// Value found.
        found: String,
        /// Expected range.
        expected: String,
    },
    /// A push above the largest that the whisker withstands.
    #[error(
        "total_x_distance: found {:.1} mm, expected at most {:.1} mm, the largest push at {:.0} mm from the root, \
        {reason}; choose a smaller push, or allow the overload by name (--allow-overload)",
        1e3 * push_m, 1e3 * most_m, 1e3 * distance_m
    )]
    Overload {
        /// Depth of the push (m).
        push_m: f64,
        /// Largest push at the place (m).
        most_m: f64,
        /// Distance of the place from the root (m).
        distance_m: f64,
        /// Quantity that limits the push.
        reason: String,
    },
    /// Interrupted by the user.
    #[error("interrupted; the printer was stopped at once and must be reset before it moves again")]
    Interrupted,
    /// Another system call failed, such as that of a thread or a pseudo-terminal.
    #[error("{what}: {reason}")]
    System {
        /// Operation that failed.
        what: String,
        /// Reason given by the system.
        reason: std::io::Error,
    },
    /// Error of a file.
    #[error(transparent)]
    File(#[from] files::Error),
}

impl Error {
    pub(crate) fn range(what: &str, found: impl ToString, expected: impl Into<String>) -> Self {
        Self::Range { what: what.into(), found: found.to_string(), expected: expected.into() }
    }

    pub(crate) fn file(path: &Path) -> impl FnOnce(std::io::Error) -> Self + '_ {
        move |reason| Self::File(files::Error::Io { path: path.into(), reason })
    }

    /// Error of a system call on `what`.
    pub fn system(what: impl Into<String>) -> impl FnOnce(std::io::Error) -> Self {
        let what = what.into();
        move |reason| Self::System { what, reason }
    }
}
