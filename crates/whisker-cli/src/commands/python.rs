//! The generator, `python -m whisker_sim`, as a child process.

use std::ffi::OsStr;
use std::path::{Path, PathBuf};
use std::process::{Command, ExitCode};

use anyhow::{Context, bail};

/// The generator with these arguments, to be run from the repository's root.
///
/// The interpreter is `WHISKER_PYTHON`, else that of `.venv`, which `cargo xtask setup` makes.
///
/// # Errors
/// If the working directory is not the repository's root, or no interpreter is there.
pub(super) fn generator<S: AsRef<OsStr>>(arguments: impl IntoIterator<Item = S>) -> anyhow::Result<Command> {
    if !Path::new("sim/whisker_sim").is_dir() {
        bail!("sim/whisker_sim: not here; run this command from the repository's root");
    }
    let python = match std::env::var_os("WHISKER_PYTHON") {
        Some(path) => PathBuf::from(path),
        None => PathBuf::from(".venv/bin/python"),
    };
    if !python.exists() {
        bail!("{}: no Python environment; `cargo xtask setup` makes it", python.display());
    }
    let mut command = Command::new(python);
    command.args(["-m", "whisker_sim"]).args(arguments).env("PYTHONPATH", "sim");
    Ok(command)
}

/// Runs the generator and passes on its exit code.
///
/// # Errors
/// If it cannot be started or was killed.
pub(super) fn run(mut command: Command) -> anyhow::Result<ExitCode> {
    let status = command.status().context("cannot start the generator")?;
    let code = status.code().context("the generator was killed")?;
    Ok(ExitCode::from(u8::try_from(code).unwrap_or(1)))
}
