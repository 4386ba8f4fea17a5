//! Why a command failed, in one message for a person.

use std::fmt;

/// What every chore returns.
pub(crate) type Outcome = Result<(), Failure>;

/// Why a chore failed: what was found, what was expected and, where it is known, what to do.
#[derive(Debug)]
pub(crate) struct Failure(String);

impl Failure {
    /// A failure with a message for a person.
    pub(crate) fn new(message: impl Into<String>) -> Self {
        Self(message.into())
    }
}

impl fmt::Display for Failure {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str(&self.0)
    }
}
