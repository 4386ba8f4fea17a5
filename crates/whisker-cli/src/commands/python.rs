//! The generator, `whisker-sim`, as a child process.

use std::env;
use std::ffi::OsStr;
use std::path::{Path, PathBuf};
use std::process::{Command, ExitCode, Stdio};

use anyhow::{Context, bail};

/// The console script that `pip install ./sim` puts on the PATH.
const SCRIPT: &str = "whisker-sim";

/// The generator with these arguments.
///
/// The interpreter is `WHISKER_PYTHON`; else that of `.venv` in the repository's root, which `cargo xtask setup` makes;
/// else the installed script `whisker-sim`.
///
/// # Errors
/// If none of the three exists.
pub(super) fn generator<S: AsRef<OsStr>>(arguments: impl IntoIterator<Item = S>) -> anyhow::Result<Command> {
    let from_sources = Path::new("sim/whisker_sim").is_dir();
    let named = env::var_os("WHISKER_PYTHON").map(PathBuf::from);
    let environment = || Some(PathBuf::from(".venv/bin/python")).filter(|python| from_sources && python.exists());
    let mut command = match named.or_else(environment) {
        Some(python) if !python.exists() => {
            bail!("WHISKER_PYTHON: found {}, expected a Python interpreter", python.display())
        }
        Some(python) => {
            if !from_sources && !has_package(&python)? {
                bail!(
                    "WHISKER_PYTHON: found {}, expected an interpreter with the package whisker_sim; run `'{}' -m pip install ./sim` in \
                     the root of a checkout",
                    python.display(),
                    python.display()
                );
            }
            let mut command = Command::new(python);
            command.args(["-m", "whisker_sim"]);
            if from_sources {
                command.env("PYTHONPATH", "sim");
            }
            command
        }
        None => Command::new(installed().with_context(|| {
            format!(
                "the generator is not installed: run `pip install ./sim`, which provides `{SCRIPT}`, or `cargo \
                xtask setup` in the repository"
            )
        })?),
    };
    command.args(arguments);
    Ok(command)
}

/// Whether an interpreter finds the generator's package.
///
/// # Errors
/// If it does not start.
fn has_package(python: &Path) -> anyhow::Result<bool> {
    let find = "import importlib.util, sys; sys.exit(importlib.util.find_spec('whisker_sim') is None)";
    let status = Command::new(python).args(["-c", find]).stdin(Stdio::null()).status();
    let status = status.with_context(|| format!("WHISKER_PYTHON: {} does not start", python.display()))?;
    Ok(status.success())
}

/// Path of the installed script. `None` if no folder of the PATH has it.
fn installed() -> Option<PathBuf> {
    let folders = env::var_os("PATH")?;
    env::split_paths(&folders).map(|folder| folder.join(SCRIPT)).find(|script| script.is_file())
}

/// Runs the generator and returns its exit code. On Unix it takes the place of this process, so that a signal to the
/// command reaches it.
///
/// # Errors
/// If it does not start or was killed.
pub(super) fn run(mut command: Command) -> anyhow::Result<ExitCode> {
    #[cfg(unix)]
    {
        use std::os::unix::process::CommandExt;
        Err(command.exec()).context("the generator does not start")
    }
    #[cfg(not(unix))]
    {
        let status = command.status().context("the generator does not start")?;
        let code = status.code().context("the generator was killed")?;
        Ok(ExitCode::from(u8::try_from(code).unwrap_or(1)))
    }
}
