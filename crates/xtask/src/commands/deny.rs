//! Licences, sources and known vulnerabilities of the dependencies, by `deny.toml`.

use std::process::Command;

use crate::failure::Outcome;
use crate::repository::root;
use crate::tools::{run as run_command, tool};

const CARGO_DENY: (&str, &str) = ("cargo-deny", "0.20.2");

pub(crate) fn run() -> Outcome {
    let deny = tool(CARGO_DENY)?;
    let command = |arguments: &[&str]| {
        let mut command = Command::new(&deny);
        command.args(arguments).current_dir(root());
        command
    };
    run_command(command(&["check", "licenses", "bans", "sources"]))?;
    // Offline, the list of vulnerabilities cannot be fetched; that is not a failure.
    match run_command(command(&["fetch", "db"])) {
        Ok(()) => run_command(command(&["check", "advisories"])),
        Err(failure) => {
            eprintln!("known vulnerabilities were not checked: {failure}");
            Ok(())
        }
    }
}
