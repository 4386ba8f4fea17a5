//! Every test: Rust, Python, end to end.

use std::process::{Command, Stdio};
use std::{env, fs, io, thread};

use crate::failure::{Failure, Outcome};
use crate::parts::{self, Part};
use crate::pipeline;
use crate::python::{self, Requirements};
use crate::repository::root;
use crate::tools::{cargo, python as python_command, run as run_command, start, with_low_priority};

use super::kills;

/// Suite of the end-to-end test, small enough for every test run.
const SUITE: &str = "smoke";

/// Number of disturbed commands of the end-to-end test.
const KILLS: u64 = 8;

#[rustfmt::skip]
pub(super) const PARTS: &[Part] = &[
    Part { name: "python packages", run: || python::install(Requirements::Development) },
    Part { name: "python tests, builds", run: python_tests_and_builds },
    Part { name: "interrupted simulations", run: || run_command(pytest(&[INTERRUPTED])) },
    Part { name: "rust tests", run: run_rust_tests },
    Part { name: "rust examples", run: || run_command(cargo(&[&["test"], &TESTED[..], &["--doc"]].concat())) },
    Part { name: "end to end", run: end_to_end },
    Part { name: "python package", run: python_package },
];

pub(crate) fn run() -> Outcome {
    parts::run_all(PARTS)
}

/// All packages but the ROS 2 node, which takes long to build and which `tests/test_ros_foreign.py` tests with foreign subscribers.
/// The Python package has no tests in Rust; it is included so that the tests and the package need the same features of
/// dependencies.
pub(super) const TESTED: [&str; 3] = ["--workspace", "--exclude", "ros2-node"];

/// Tests that interrupt the generator some tenths of a second after its start. Beside a build, the interpreter may not be ready by
/// then.
const INTERRUPTED: &str = "sim/tests/test_resume.py";

/// Runs the other tests of the generator, which needs no Rust, while the Rust tests and then the Python package are built: a build
/// often waits for one large package, which occupies a single processor. The tests have a lower priority, because they occupy all
/// processors to their end.
fn python_tests_and_builds() -> Outcome {
    let tests = start(with_low_priority(pytest(&["sim/tests", "--ignore", INTERRUPTED])))?;
    let built = run_command(cargo(&rust_tests(&["--no-run"]))).and_then(|()| python::install_package());
    tests.finish().and(built)
}

/// Arguments of cargo that build and run the Rust tests, with further options.
fn rust_tests(options: &[&'static str]) -> Vec<&'static str> {
    let run: &[&str] = if has_nextest() { &["nextest", "run"] } else { &["test", "--tests"] };
    [run, &TESTED, options].concat()
}

/// Runs the Rust tests, three at a time for every two processors, because some mostly wait for a port, a program or a clock.
/// Numbers that are set in the environment are kept.
fn run_rust_tests() -> Outcome {
    let mut command = cargo(&rust_tests(&["--no-fail-fast"]));
    let processors = thread::available_parallelism().map_or(1, usize::from);
    let threads = processors.div_ceil(2) + processors;
    for variable in ["NEXTEST_TEST_THREADS", "RUST_TEST_THREADS"] {
        if env::var_os(variable).is_none() {
            command.env(variable, threads.to_string());
        }
    }
    run_command(command)
}

/// A command that runs tests in Python, one process per processor. Tests of one file share a process, and with it their fixtures.
fn pytest(arguments: &[&str]) -> Command {
    python_command(&[&["-m", "pytest", "-n", "auto", "--dist", "loadfile"], arguments].concat())
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
    pipeline::Evaluations::new(false).of(SUITE, None)?;
    pipeline::report(SUITE)?;
    let mut tests = pytest(&["tests"]);
    tests.env("WHISKER_REPORT", root().join("results").join(SUITE).join("index.html"));
    let tests = start(tests)?;
    // The disturbed commands of the calibration platform take little processor time, so that the tests run beside them.
    let disturbed = kills::disturb(KILLS, 1);
    tests.finish().and(disturbed)
}

/// The Python package as installed by pip: its stubs against the running module, then its tests, which compare it with the
/// command on the results of the end-to-end test.
fn python_package() -> Outcome {
    let stubtest = ["-m", "mypy.stubtest", "whisker_contact", "--mypy-config-file", "python/pyproject.toml"];
    run_command(python_command(&stubtest))?;
    run_command(pytest(&["-c", "python/pyproject.toml", "python/tests"]))
}

fn remove(folder: &str) -> Outcome {
    match fs::remove_dir_all(root().join(folder)) {
        Err(error) if error.kind() != io::ErrorKind::NotFound => {
            Err(Failure::new(format!("{folder}: cannot be removed: {error}")))
        }
        _ => Ok(()),
    }
}
