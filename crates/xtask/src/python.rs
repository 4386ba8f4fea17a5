//! The Python environment in `.venv`, made from a hashed lock file and remade only if that file changes.
//!
//! A copy of the lock file that was installed stays in the environment. It is removed before pip starts and written
//! when pip is done, so an environment without it is incomplete and is made again.

use std::env;
use std::fs::{self, File};
use std::io::{BufRead, BufReader, IsTerminal, stderr};
use std::path::PathBuf;
use std::process::{Command, Stdio};
use std::time::Instant;

use crate::failure::{Failure, Outcome};
use crate::repository::{environment, interpreter, root, words};
use crate::tools::{python, run};

/// Oldest version of Python that runs the generator.
const OLDEST: (u32, u32) = (3, 11);
const HOW_TO_GET_PYTHON: &str = "Install Python 3.11 or newer with its modules venv and ensurepip (Debian, Ubuntu: \
     apt-get install python3 python3-venv), or name another interpreter: PYTHON=/path/to/python3";

/// Set of packages to install.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Requirements {
    /// Packages that the simulation needs.
    Runtime,
    /// Also the packages for clusters, tests and lints.
    Development,
}

impl Requirements {
    /// Lock file, relative to the root folder.
    fn lock(self) -> &'static str {
        match self {
            Self::Runtime => "sim/requirements.lock",
            Self::Development => "sim/requirements-dev.lock",
        }
    }

    fn read_lock(self) -> Result<String, Failure> {
        fs::read_to_string(root().join(self.lock()))
            .map_err(|error| Failure::new(format!("{}: cannot be read: {error}", self.lock())))
    }
}

/// Installs the required packages unless the environment already holds them.
pub(crate) fn install(requirements: Requirements) -> Outcome {
    let _turn = wait_for_turn()?;
    let wanted = requirements.read_lock()?;
    let installed = installed_lock();
    if installed.as_ref() == Some(&wanted) {
        return Ok(());
    }
    let runtime_packages_only = installed.is_some() && installed == Requirements::Runtime.read_lock().ok();
    let all_packages = installed.is_some() && installed == Requirements::Development.read_lock().ok();
    // The development lock holds every pin of the runtime lock (tested below).
    if requirements == Requirements::Runtime && all_packages {
        return Ok(());
    }
    if !runtime_packages_only {
        create()?;
    }
    remove_if_present(fs::remove_file(stamp()), ".venv/installed.lock")?;
    pip_install(requirements, &packages(&wanted))?;
    write_stamp(&wanted)
}

/// Builds the package `whisker_contact` and installs it into the environment, with the packages that develop it.
pub(crate) fn install_package() -> Outcome {
    install(Requirements::Development)?;
    // The build takes the pinned build backend of the environment, and pip has nothing to download.
    let mut pip =
        python(&["-m", "pip", "install", "--quiet", "--no-deps", "--no-build-isolation", "--no-index", "./python"]);
    // The backend starts its program by name.
    let path = env::var_os("PATH").unwrap_or_default();
    let folders = [environment().join("bin")].into_iter().chain(env::split_paths(&path));
    pip.env("PATH", env::join_paths(folders).expect("folders of the PATH are without separators"));
    run(pip)
}

fn stamp() -> PathBuf {
    environment().join("installed.lock")
}

/// Lock against a second command that makes the environment at the same time: the second waits.
fn wait_for_turn() -> Result<File, Failure> {
    File::create(root().join(".venv.lock"))
        .and_then(|file| file.lock().map(|()| file))
        .map_err(|error| Failure::new(format!(".venv.lock: cannot be locked: {error}")))
}

/// The lock file whose packages the environment holds; `None` if the environment is missing or incomplete, or its
/// interpreter does not start.
fn installed_lock() -> Option<String> {
    let lock = fs::read_to_string(stamp()).ok()?;
    let works = Command::new(interpreter()).args(["-c", ""]).stderr(Stdio::null()).status().ok()?.success();
    works.then_some(lock)
}

fn write_stamp(lock: &str) -> Outcome {
    let unfinished = environment().join("installed.lock.tmp");
    fs::write(&unfinished, lock)
        .and_then(|()| fs::rename(&unfinished, stamp()))
        .map_err(|error| Failure::new(format!(".venv/installed.lock: cannot be written: {error}")))
}

fn remove_if_present(removed: std::io::Result<()>, path: &str) -> Outcome {
    match removed {
        Err(error) if error.kind() != std::io::ErrorKind::NotFound => {
            Err(Failure::new(format!("{path}: cannot be removed: {error}")))
        }
        _ => Ok(()),
    }
}

/// Makes an empty environment and deletes any earlier one.
fn create() -> Outcome {
    let base = env::var_os("PYTHON").filter(|python| !python.is_empty()).unwrap_or_else(|| "python3".into());
    let name = base.to_string_lossy().into_owned();
    // The version is printed first, so that it is known even if a module is missing.
    let probe = Command::new(&base)
        .args(["-c", "import sys; print(*sys.version_info[:2]); import venv, ensurepip"])
        .output()
        .map_err(|error| Failure::new(format!("`{name}` does not start: {error}. {HOW_TO_GET_PYTHON}")))?;
    let version = version(&String::from_utf8_lossy(&probe.stdout)).ok_or_else(|| {
        Failure::new(format!("`{name}` prints no version, expected that of Python 3. {HOW_TO_GET_PYTHON}"))
    })?;
    if version < OLDEST {
        let (major, minor) = version;
        return Err(Failure::new(format!("`{name}` is Python {major}.{minor}. {HOW_TO_GET_PYTHON}")));
    }
    if !probe.status.success() {
        return Err(Failure::new(format!("`{name}` lacks the module venv or ensurepip. {HOW_TO_GET_PYTHON}")));
    }

    remove_if_present(fs::remove_dir_all(environment()), ".venv")?;
    let made = Command::new(&base)
        .args(["-m", "venv"])
        .arg(environment())
        .output()
        .map_err(|error| Failure::new(format!("`{name}` does not start: {error}")))?;
    if made.status.success() {
        Ok(())
    } else {
        let printed = String::from_utf8_lossy(if made.stderr.is_empty() { &made.stdout } else { &made.stderr });
        Err(Failure::new(format!("`{name} -m venv .venv` ended with {}:\n{}", made.status, printed.trim_end())))
    }
}

/// Major and minor version out of `3 11`.
fn version(printed: &str) -> Option<(u32, u32)> {
    let mut numbers = printed.split_whitespace().map(str::parse);
    Some((numbers.next()?.ok()?, numbers.next()?.ok()?))
}

/// The pinned packages of a lock file, as `name version`.
fn packages(lock: &str) -> Vec<String> {
    lock.lines()
        .filter(|line| !line.starts_with([' ', '#', '-']))
        .filter_map(|line| line.split([' ', ';', '\\']).next()?.split_once("=="))
        .map(|(name, version)| format!("{name} {version}"))
        .collect()
}

fn pip_install(requirements: Requirements, packages: &[String]) -> Outcome {
    eprintln!("installing {} Python packages ({})", packages.len(), packages.join(", "));
    let started = Instant::now();
    let cannot = |error| Failure::new(format!("pip does not start: {error}"));
    let mut command = Command::new(interpreter());
    command
        .args(["-m", "pip", "install", "--disable-pip-version-check", "--no-input", "--progress-bar=off"])
        // Python compiles what it imports; compiling every module of every package takes longer.
        .arg("--no-compile")
        .args(["--require-hashes", "--requirement", requirements.lock()])
        .current_dir(root());
    let (output, input) = std::io::pipe().map_err(cannot)?;
    command.stdin(Stdio::null()).stdout(input.try_clone().map_err(cannot)?).stderr(input);
    let mut pip = command.spawn().map_err(cannot)?;
    let typed = words(&command);
    // The command holds the writing end of the pipe; without this the reader would never see its end.
    drop(command);

    let counts = stderr().is_terminal();
    let mut log = Vec::new();
    let mut found = 0;
    for line in BufReader::new(output).split(b'\n').map_while(Result::ok) {
        if line.starts_with(b"Collecting ") && counts {
            found += 1;
            eprint!("\r  {found}/{}", packages.len());
        }
        log.push(String::from_utf8_lossy(&line).into_owned());
    }
    if counts {
        eprint!("\r\x1b[K");
    }
    let status = pip.wait().map_err(cannot)?;
    if status.success() {
        eprintln!("installed Python packages in {:.1} s", started.elapsed().as_secs_f64());
        Ok(())
    } else {
        eprintln!("{}", log.join("\n"));
        Err(Failure::new(format!("`{typed}` ended with {status}; its output is above")))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn verif_packages_of_a_lock_file_are_its_pins() {
        let lock = "# comment\nmujoco==3.17.0 \\\n    --hash=sha256:00\ncolorama==0.4.6 ; sys_platform == 'win32' \\\n";
        assert_eq!(packages(lock), ["mujoco 3.17.0", "colorama 0.4.6"]);
    }

    #[test]
    fn verif_version_is_two_numbers() {
        assert_eq!(version("3 11\n"), Some((3, 11)));
        assert_eq!(version("Python"), None);
    }

    #[test]
    fn verif_development_lock_holds_every_pin_of_the_other_locks() {
        let development = packages(&Requirements::Development.read_lock().unwrap());
        let cluster = fs::read_to_string(root().join("sim/requirements-cluster.lock")).unwrap();
        for package in packages(&Requirements::Runtime.read_lock().unwrap()).into_iter().chain(packages(&cluster)) {
            assert!(development.contains(&package), "{package} is missing in sim/requirements-dev.lock");
        }
    }
}
