//! Format, lints and documentation of Rust and Python.

use std::thread;

use crate::failure::{Failure, Outcome};
use crate::parts::{self, Part};
use crate::python::{self, Requirements};
use crate::tools::{cargo, python as python_command, run as run_command};

#[rustfmt::skip]
pub(super) const PARTS: &[Part] = &[
    Part { name: "rust format", run: || run_command(cargo(&["fmt", "--all", "--check"])) },
    Part { name: "rust format of the fuzz targets", run: || run_command(cargo(&["fmt", "--manifest-path", "fuzz/Cargo.toml", "--check"])) },
    Part { name: "rust lints, python packages", run: rust_lints_and_python_packages },
    Part { name: "rust documentation", run: rust_documentation },
    Part { name: "python format", run: || ruff(&["format", "--check"]) },
    Part { name: "python lints", run: || ruff(&["check"]) },
    Part { name: "python types", run: python_types },
];

pub(crate) fn run() -> Outcome {
    parts::run_all(PARTS)
}

/// Installs the Python packages while the Rust lints run, because the installation mostly waits for the network and the disk.
fn rust_lints_and_python_packages() -> Outcome {
    thread::scope(|scope| {
        let packages = scope.spawn(|| python::install(Requirements::Development));
        let lints = rust_lints();
        let packages =
            packages.join().unwrap_or_else(|_| Err(Failure::new("the installation of the Python packages panicked")));
        lints.and(packages)
    })
}

fn rust_lints() -> Outcome {
    run_command(cargo(&["clippy", "--workspace", "--all-targets", "--", "--deny", "warnings"]))
}

fn rust_documentation() -> Outcome {
    // The examples are included so that dependencies have the same features as in the lints, and are not checked again.
    let targets = ["--lib", "--bin", "ros2-node", "--bin", "xtask", "--examples"];
    let mut command = cargo(&[&["doc", "--workspace", "--no-deps"], &targets[..]].concat());
    command.env("RUSTDOCFLAGS", "--deny warnings");
    run_command(command)
}

/// Ruff over all Python code, with the settings of the generator.
fn ruff(arguments: &[&str]) -> Outcome {
    python::install(Requirements::Development)?;
    let run_ruff = |more: &[&str]| run_command(python_command(&[&["-m", "ruff"], arguments, more].concat()));
    run_ruff(&["sim"])?;
    run_ruff(&["--config", "sim/pyproject.toml", "tests", "examples", "bench", "docs", "python"])
}

/// Types of the Python package, by its stubs.
fn python_types() -> Outcome {
    python::install(Requirements::Development)?;
    run_command(python_command(&["-m", "mypy", "--config-file", "python/pyproject.toml", "python/whisker_contact"]))
}
