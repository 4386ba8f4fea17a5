//! External programs, each set up to run in the repository.

use std::env;
use std::path::PathBuf;
use std::process::{Child, Command};

use crate::failure::{Failure, Outcome};
use crate::repository::{interpreter, root, words};

/// A cargo command, for example `["build", "--release"]`.
pub(crate) fn cargo(arguments: &[&str]) -> Command {
    in_repository(Command::new(env::var_os("CARGO").unwrap_or_else(|| "cargo".into())), arguments)
}

/// A command of the program `whisker`: of [`given_whisker`], else of the release build, which is brought up to date first.
pub(crate) fn whisker(arguments: &[&str]) -> Command {
    if let Some(program) = given_whisker() {
        return in_repository(Command::new(program), arguments);
    }
    let mut command = cargo(&["run", "--quiet", "--release", "--package", "whisker-cli", "--bin", "whisker", "--"]);
    command.args(arguments);
    command
}

/// The program `whisker` that the environment variable `WHISKER` names, for use in place of the release build.
pub(crate) fn given_whisker() -> Option<PathBuf> {
    env::var_os("WHISKER").filter(|program| !program.is_empty()).map(|program| root().join(program))
}

/// Command that brings the release build of `whisker` up to date. `None` if [`given_whisker`] takes its place.
pub(crate) fn build_whisker() -> Option<Command> {
    given_whisker().is_none().then(|| cargo(&["build", "--quiet", "--release", "--package", "whisker-cli"]))
}

/// The program `whisker` as it is now: [`given_whisker`], else the release build.
pub(crate) fn built_whisker() -> PathBuf {
    given_whisker().unwrap_or_else(|| root().join("target/release/whisker"))
}

/// The program of a published package at a pinned version, built on its first use.
pub(crate) fn tool((package, version): (&str, &str)) -> Result<PathBuf, Failure> {
    let folder = root().join("target/tools").join(format!("{package}-{version}"));
    let program = folder.join("bin").join(package);
    if !program.is_file() {
        let mut command = cargo(&["install", "--quiet", "--locked", package, "--version", version]);
        command.arg("--root").arg(&folder);
        run(command)?;
    }
    Ok(program)
}

/// A command of the Python interpreter in the repository's environment, for example `["-m", "pytest"]`.
pub(crate) fn python(arguments: &[&str]) -> Command {
    in_repository(Command::new(interpreter()), arguments)
}

fn in_repository(mut command: Command, arguments: &[&str]) -> Command {
    command
        .args(arguments)
        .current_dir(root())
        .env("PYTHONPATH", root().join("sim"))
        .env("WHISKER_PYTHON", interpreter());
    command
}

/// The same command with a lower priority for the processor (`nice -n 5`). Unchanged on systems other than Unix.
pub(crate) fn with_low_priority(command: Command) -> Command {
    if !cfg!(unix) {
        return command;
    }
    let mut nice = Command::new("nice");
    nice.args(["-n", "5"]).arg(command.get_program()).args(command.get_args());
    for (name, value) in command.get_envs() {
        match value {
            Some(value) => nice.env(name, value),
            None => nice.env_remove(name),
        };
    }
    if let Some(folder) = command.get_current_dir() {
        nice.current_dir(folder);
    }
    nice
}

/// Runs a command to its end; its output goes to the terminal unchanged.
pub(crate) fn run(command: Command) -> Outcome {
    start(command)?.finish()
}

/// Starts a command in the background; its output goes to the terminal unchanged.
pub(crate) fn start(mut command: Command) -> Result<Running, Failure> {
    let words = words(&command);
    match command.spawn() {
        Ok(child) => Ok(Running { words, child }),
        Err(error) => Err(Failure::new(format!("`{words}` does not start: {error}"))),
    }
}

/// A command that was started.
pub(crate) struct Running {
    words: String,
    child: Child,
}

impl Running {
    /// Waits for the command's end.
    ///
    /// # Errors
    /// If the command failed.
    pub(crate) fn finish(mut self) -> Outcome {
        let words = &self.words;
        match self.child.wait() {
            Ok(status) if status.success() => Ok(()),
            Ok(status) => Err(Failure::new(format!("`{words}` ended with {status}"))),
            Err(error) => Err(Failure::new(format!("`{words}` cannot be waited for: {error}"))),
        }
    }

    /// Kills the command, whose result is no longer needed.
    pub(crate) fn abandon(mut self) {
        // The command may have ended by itself.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}
