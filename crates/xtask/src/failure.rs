//! Failures, each one message for the user.

use std::fmt;

/// Result of every command.
pub(crate) type Outcome = Result<(), Failure>;

/// The reason of a failure: the value found, the value expected and, if known, the remedy.
#[derive(Debug)]
pub(crate) struct Failure(String);

impl Failure {
    /// A failure with this message.
    pub(crate) fn new(message: impl Into<String>) -> Self {
        Self(message.into())
    }
}

impl fmt::Display for Failure {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str(&self.0)
    }
}
