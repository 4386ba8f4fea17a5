//! The commands: one file each, and one row in [`COMMANDS`].

mod batch;
mod bench;
mod check;
mod ci;
mod demo;
mod golden;
mod peers;
mod physics;
mod reproduce;
mod setup;
mod test;

use crate::failure::Outcome;

/// A command of `cargo xtask`.
pub(crate) struct Command {
    name: &'static str,
    about: &'static str,
    pub(crate) run: fn() -> Outcome,
}

#[rustfmt::skip]
const COMMANDS: &[Command] = &[
    Command { name: "setup", about: "Install the Python packages in .venv", run: setup::run },
    Command { name: "demo", about: "Simulate, fit, evaluate and report the standard suite: results/standard/", run: demo::run },
    Command { name: "test", about: "Run every test: Rust, Python, end to end", run: test::run },
    Command { name: "check", about: "Check format, lints and documentation of Rust and Python", run: check::run },
    Command { name: "ci", about: "Run check and test", run: ci::run },
    Command { name: "reproduce", about: "Measure every published figure again: results/reference/claims.csv", run: reproduce::run },
    Command { name: "physics", about: "Hold the simulator against theory, claim by claim: results/physics/", run: physics::run },
    Command { name: "golden", about: "Simulate the golden traces of the tests: datasets/golden/", run: golden::run },
    Command { name: "bench", about: "Run the benchmarks", run: bench::run },
    Command { name: "batch", about: "Measure batches and long traces: time and memory", run: batch::run },
    Command { name: "peers", about: "Compare the filters with those of others: docs/PERFORMANCE.md", run: peers::run },
];

/// The command that the arguments name, or what is wrong with them.
pub(crate) fn find(arguments: &[String]) -> Result<&'static Command, String> {
    match arguments {
        [] => Err("a command is expected".to_owned()),
        [name] => COMMANDS.iter().find(|command| command.name == name).ok_or_else(|| format!("`{name}` is no command")),
        [name, surplus, ..] => Err(format!("`{name}` takes no arguments, found `{surplus}`")),
    }
}

/// Usage, with every command.
pub(crate) fn help() -> String {
    let rows: String = COMMANDS.iter().map(|command| format!("  {:<10} {}\n", command.name, command.about)).collect();
    format!("Usage: cargo xtask <command>\n\n{rows}")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn error(arguments: &[&str]) -> Option<String> {
        find(&arguments.iter().map(|&argument| argument.to_owned()).collect::<Vec<_>>()).err()
    }

    #[test]
    fn every_command_is_found_and_in_the_help() {
        for command in COMMANDS {
            assert_eq!(error(&[command.name]), None);
            assert!(help().contains(&format!("  {} ", command.name)));
        }
    }

    #[test]
    fn usage_errors_name_what_was_found() {
        assert_eq!(error(&[]).as_deref(), Some("a command is expected"));
        assert_eq!(error(&["deom"]).as_deref(), Some("`deom` is no command"));
        assert_eq!(error(&["demo", "fast"]).as_deref(), Some("`demo` takes no arguments, found `fast`"));
    }
}
