//! Signals to processes.

use std::process::Command;

use crate::failure::{Failure, Outcome};

/// Sends a signal, by its name without `SIG`, to a process.
///
/// # Errors
/// If the process does not exist or may not be signalled.
pub(super) fn send(name: &str, process: u32) -> Outcome {
    let sent = Command::new("kill").args(["-s", name, &process.to_string()]).status();
    match sent {
        Ok(status) if status.success() => Ok(()),
        other => Err(Failure::new(format!("kill -s {name} {process}: {other:?}"))),
    }
}
