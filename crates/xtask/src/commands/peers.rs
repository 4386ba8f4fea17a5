//! The filters timed against other libraries on one problem: `results/reference/peers.csv`, shown in
//! `docs/PERFORMANCE.md`. Their packages are installed in a separate folder.

use std::process::Command;

use super::docs;
use crate::failure::Outcome;
use crate::parts::step;
use crate::pipeline;
use crate::repository::{interpreter, root};
use crate::tools::{cargo, run as run_command};

/// The Cargo workspace, the packages and the script of the comparison.
const FOLDER: &str = "bench/peers";
/// Folder of the build and of the installed packages.
const TARGET: &str = "target/peers";
const SUITE: &str = "standard";
const TRACE: &str = "pin_curved_00";
const CALIBRATION: &str = "curved";

pub(crate) fn run() -> Outcome {
    pipeline::prepare()?;
    pipeline::simulate(SUITE)?;
    pipeline::fit(SUITE)?;
    step("peers", || {
        let manifest = format!("{FOLDER}/Cargo.toml");
        run_command(cargo(&["build", "--release", "--locked", "--manifest-path", &manifest, "--target-dir", TARGET]))?;
        let environment = format!("{TARGET}/venv");
        run_command(program(&interpreter().to_string_lossy(), &["-m", "venv", &environment]))?;
        let python = root().join(&environment).join("bin/python").to_string_lossy().into_owned();
        let lock = format!("{FOLDER}/requirements.lock");
        let pip =
            ["-m", "pip", "install", "--quiet", "--disable-pip-version-check", "--require-hashes", "--requirement"];
        run_command(program(&python, &[&pip[..], &[&lock]].concat()))?;
        let script = format!("{FOLDER}/compare.py");
        let built = format!("{TARGET}/release/peers");
        let trace = format!("datasets/{SUITE}/{TRACE}.csv");
        let calibration = format!("datasets/{SUITE}/calibrations/{CALIBRATION}.json");
        run_command(program(&python, &[&script, &built, &trace, &calibration, "results/reference/peers.csv"]))
    })?;
    step("documentation", docs::run)
}

/// A program, run in the repository's root folder.
fn program(name: &str, arguments: &[&str]) -> Command {
    let mut command = Command::new(name);
    command.args(arguments).current_dir(root());
    command
}
