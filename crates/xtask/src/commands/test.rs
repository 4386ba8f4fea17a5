//! Every test: Rust, Python, end to end.

use std::process::Stdio;
use std::{fs, io};

use crate::failure::{Failure, Outcome};
use crate::parts::{self, Part};
use crate::pipeline;
use crate::python::{self, Requirements};
use crate::repository::root;
use crate::tools::{cargo, python as python_command, run as run_command};

/// Suite of the end-to-end test, small enough for every test run.
const SUITE: &str = "smoke";

#[rustfmt::skip]
pub(super) const PARTS: &[Part] = &[
    Part { name: "python packages", run: || python::install(Requirements::Development) },
    Part { name: "rust tests", run: rust_tests },
    Part { name: "rust examples", run: || run_command(cargo(&[&["test"], &TESTED[..], &["--doc"]].concat())) },
    Part { name: "python tests", run: || run_command(python_command(&["-m", "pytest", "sim/tests"])) },
    Part { name: "end to end", run: end_to_end },
];

pub(crate) fn run() -> Outcome {
    parts::run_all(PARTS)
}

/// All packages but the ROS 2 node, which takes long to build; `tests/test_ros_foreign.py` tests it with foreign subscribers.
pub(super) const TESTED: [&str; 3] = ["--workspace", "--exclude", "ros2-node"];

fn rust_tests() -> Outcome {
    let run: &[&str] = if has_nextest() { &["nextest", "run"] } else { &["test", "--lib", "--bins", "--tests"] };
    run_command(cargo(&[run, &TESTED, &["--no-fail-fast"]].concat()))
}

fn has_nextest() -> bool {
    let mut command = cargo(&["nextest", "--version"]);
    command.stdout(Stdio::null()).stderr(Stdio::null()).status().is_ok_and(|status| status.success())
}

/// The pipeline from scenes to page without results of an earlier run, then the tests of the page.
fn end_to_end() -> Outcome {
    remove(&format!("datasets/{SUITE}"))?;
    remove(&format!("results/{SUITE}"))?;
    pipeline::prepare()?;
    pipeline::simulate_with_animations(SUITE)?;
    pipeline::fit(SUITE)?;
    pipeline::evaluate(SUITE, None)?;
    pipeline::report(SUITE)?;
    let mut command = python_command(&["-m", "pytest", "tests"]);
    command.env("WHISKER_REPORT", root().join("results").join(SUITE).join("index.html"));
    run_command(command)
}

fn remove(folder: &str) -> Outcome {
    match fs::remove_dir_all(root().join(folder)) {
        Err(error) if error.kind() != io::ErrorKind::NotFound => {
            Err(Failure::new(format!("{folder}: cannot be removed: {error}")))
        }
        _ => Ok(()),
    }
}
