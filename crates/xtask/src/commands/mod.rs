//! The commands: one file each, and one row in [`COMMANDS`].

mod batch;
mod bench;
mod check;
mod ci;
mod demo;
mod deny;
mod docs;
mod fuzz;
mod golden;
mod kills;
mod live;
mod package;
mod peers;
mod physics;
mod random;
mod real;
mod reference;
mod reproduce;
mod rig;
mod setup;
mod test;

use crate::failure::Outcome;

/// A command of `cargo xtask`.
pub(crate) struct Command {
    name: &'static str,
    about: &'static str,
    run: Run,
}

/// Signature of a command.
enum Run {
    /// Takes no arguments.
    Plain(fn() -> Outcome),
    /// Takes arguments and checks them itself.
    With(fn(&[String]) -> Outcome),
}
use Run::{Plain, With};

impl Command {
    /// Runs the command with the arguments after its name.
    pub(crate) fn run(&self, arguments: &[String]) -> Outcome {
        match self.run {
            Plain(run) => run(),
            With(run) => run(arguments),
        }
    }
}

#[rustfmt::skip]
const COMMANDS: &[Command] = &[
    Command { name: "setup", about: "Install the Python packages in .venv", run: Plain(setup::run) },
    Command { name: "demo", about: "Simulate, fit, evaluate and report the standard suite (--all: with every estimator; --force: in place of a run with other settings): results/standard/", run: With(demo::run) },
    Command { name: "test", about: "Run every test: Rust, Python, end to end", run: Plain(test::run) },
    Command { name: "check", about: "Check format, lints and documentation of Rust and Python", run: Plain(check::run) },
    Command { name: "ci", about: "Run check and test", run: Plain(ci::run) },
    Command { name: "reproduce", about: "Measure every claim of the documentation (--force: also in place of runs with other settings): results/reference/claims.csv", run: With(reproduce::run) },
    Command { name: "real", about: "Evaluate recordings of real sensors: real --recordings FOLDER [--force] (docs/REAL.md)", run: With(real::run) },
    Command { name: "random", about: "Measure the reliability of the stated covariances on random scenes, with inexact calibrations and with friction (--force: also in place of runs with other settings): certainty/, contacts/, quantities/ and yielding/ in results/reference/", run: With(random::run) },
    Command { name: "physics", about: "Compare the simulator with beam theory, claim by claim: results/physics/", run: Plain(physics::run) },
    Command { name: "docs", about: "Write the measured values of the documentation from results/reference/", run: Plain(docs::run) },
    Command { name: "reference", about: "Build the reference of the Rust crates and of the Python package: target/doc/", run: Plain(reference::run) },
    Command { name: "deny", about: "Check licences, sources and known vulnerabilities of the dependencies", run: Plain(deny::run) },
    Command { name: "fuzz", about: "Fuzz every parser, ten minutes each: fuzz [TARGET] [--seconds N] [--jobs N]", run: With(fuzz::run) },
    Command { name: "golden", about: "Simulate the golden traces of the tests: datasets/golden/", run: Plain(golden::run) },
    Command { name: "rig", about: "Test the calibration platform on its emulated rig: rig [--runs N] [--soak SECONDS]", run: With(rig::run) },
    Command { name: "kills", about: "Kill commands at random moments or fill their disk, repeat them, and compare their files: kills [--count N] [--seed S]", run: With(kills::run) },
    Command { name: "bench", about: "Run the benchmarks", run: Plain(bench::run) },
    Command { name: "batch", about: "Measure time and memory of batches and long traces", run: Plain(batch::run) },
    Command { name: "live", about: "Measure latency, losses and memory of live estimation with six whiskers: live [--space] [--seconds N]", run: With(live::run) },
    Command { name: "package", about: "Measure the Python package: installation, size, and times compared with those in Rust", run: Plain(package::run) },
    Command { name: "peers", about: "Time the filters against other libraries: results/reference/peers.csv", run: Plain(peers::run) },
];

/// Finds the command named by the arguments.
///
/// # Errors
/// The usage error, if no command has that name or it takes no arguments.
pub(crate) fn find(arguments: &[String]) -> Result<&'static Command, String> {
    let (name, rest) = arguments.split_first().ok_or("expected a command")?;
    let command =
        COMMANDS.iter().find(|command| command.name == name).ok_or_else(|| format!("unknown command `{name}`"))?;
    match (&command.run, rest) {
        (Plain(_), [surplus, ..]) => Err(format!("`{name}` takes no arguments, found `{surplus}`")),
        _ => Ok(command),
    }
}

/// Usage and the list of commands.
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
    fn verif_every_command_is_found_and_in_the_help() {
        for command in COMMANDS {
            assert_eq!(error(&[command.name]), None);
            assert!(help().contains(&format!("  {} ", command.name)));
        }
    }

    #[test]
    fn robust_usage_errors_name_what_was_found() {
        assert_eq!(error(&[]).as_deref(), Some("expected a command"));
        assert_eq!(error(&["deom"]).as_deref(), Some("unknown command `deom`"));
        assert_eq!(error(&["golden", "fast"]).as_deref(), Some("`golden` takes no arguments, found `fast`"));
    }
}
