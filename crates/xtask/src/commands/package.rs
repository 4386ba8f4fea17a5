//! `cargo xtask package`: the results of the Python package compared with those of the command, its installation from a clean
//! clone, the size of its wheel, and the times of its calls compared with those in Rust. The values are rows of
//! `results/reference/measured.csv`, shown in `docs/PYTHON.md` and `docs/PERFORMANCE.md`.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Instant;

use super::docs;
use crate::failure::{Failure, Outcome};
use crate::kept::{self, Measured};
use crate::parts::step;
use crate::repository::{interpreter, root, words};
use crate::tools::{cargo, python as python_command, run as run_command};
use crate::{pipeline, python};

const SUITE: &str = "standard";
/// One trace of each object and whisker.
const TRACES: [&str; 10] = [
    "pin_straight_00",
    "pin_curved_00",
    "circle_15_straight",
    "circle_15_curved",
    "circle_50_straight",
    "circle_50_curved",
    "octagon_straight",
    "octagon_curved",
    "rectangle_straight",
    "rectangle_curved",
];
/// Folder of the clone, its environment and its wheel.
const TARGET: &str = "target/python-package";
/// The program that measures the times in Rust, in the clone.
const STEP_TIMES: &str = "target/release/examples/step_times";
const ROWS: &str = "python_";

pub(crate) fn run() -> Outcome {
    pipeline::prepare()?;
    pipeline::simulate(SUITE)?;
    pipeline::fit(SUITE)?;
    step("equality with the command", equality)?;
    let mut rows = Vec::new();
    let folder = root().join(TARGET);
    step("installation from a clean clone", || {
        rows.extend(installed(&folder)?);
        Ok(())
    })?;
    step("times of the calls", || {
        rows.extend(timed(&folder)?);
        Ok(())
    })?;
    for row in &rows {
        println!("{:60} {:10.3} {}", row.about, row.value, row.unit);
    }
    kept::write_measured(ROWS, "cargo xtask package", &rows)?;
    step("documentation", docs::run)
}

/// Compares the replays of every trial of the suite and every estimator with those of the command, to the bit.
fn equality() -> Outcome {
    python::install_package()?;
    let tests = ["-m", "pytest", "-c", "python/pyproject.toml", "python/tests/test_command.py", "-k", "every_replay"];
    run_command(python_command(&[&tests[..], &["--suite", SUITE]].concat()))
}

/// Python of the environment into which the package is installed.
fn interpreter_of(folder: &Path) -> PathBuf {
    folder.join("venv/bin/python")
}

/// Clones the repository and installs the package from the clone, which compiles everything.
fn installed(folder: &Path) -> Result<Vec<Measured>, Failure> {
    let failed = |error: std::io::Error| Failure::new(format!("{}: {error}", folder.display()));
    if folder.exists() {
        fs::remove_dir_all(folder).map_err(failed)?;
    }
    fs::create_dir_all(folder).map_err(failed)?;
    let clone = folder.join("clone");
    let mut git = Command::new("git");
    git.args(["clone", "--quiet"]).arg(root()).arg(&clone);
    run_command(git)?;
    let mut venv = Command::new(interpreter());
    venv.args(["-m", "venv"]).arg(folder.join("venv"));
    run_command(venv)?;
    let pip = |arguments: &[&str]| {
        let mut pip = Command::new(interpreter_of(folder));
        pip.args(["-m", "pip", "--quiet", "--disable-pip-version-check"]).args(arguments);
        pip.current_dir(&clone).env_remove("CARGO_TARGET_DIR");
        pip
    };
    let start = Instant::now();
    run_command(pip(&["install", "./python"]))?;
    let seconds = start.elapsed().as_secs_f64();
    let wheels = folder.join("wheels");
    run_command(pip(&["wheel", "--no-deps", "--wheel-dir", &wheels.to_string_lossy(), "./python"]))?;
    let mut bytes = 0;
    for wheel in fs::read_dir(&wheels).map_err(failed)? {
        bytes += wheel.and_then(|wheel| wheel.metadata()).map_err(failed)?.len();
    }
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    Ok(vec![
        Measured::new("install", format!("pip install ./python in a clean clone, {cores} cores"), seconds, "s"),
        Measured::new("wheel", "size of the wheel", 1e-6 * bytes as f64, "MB"),
    ])
}

/// Times of step and replay in Python and in Rust, both of the clone.
fn timed(folder: &Path) -> Result<Vec<Measured>, Failure> {
    let clone = folder.join("clone");
    let mut build = cargo(&["build", "--quiet", "--release", "--package", "whisker-python", "--example", "step_times"]);
    build.current_dir(&clone).env_remove("CARGO_TARGET_DIR");
    run_command(build)?;
    let mut script = Command::new(interpreter_of(folder));
    script.current_dir(root()).arg(clone.join("python/bench/overhead.py")).arg(clone.join(STEP_TIMES));
    script.arg(format!("datasets/{SUITE}/calibrations"));
    script.args(TRACES.map(|trace| format!("datasets/{SUITE}/{trace}.csv")));
    let found = script.output().map_err(|error| Failure::new(format!("`{}`: {error}", words(&script))))?;
    let text = String::from_utf8_lossy(&found.stdout).into_owned();
    if !found.status.success() {
        return Err(Failure::new(format!("`{}`: {}", words(&script), String::from_utf8_lossy(&found.stderr))));
    }
    print!("{text}");
    let times: Option<Vec<Times>> = text.lines().skip(1).map(Times::of_row).collect();
    let rows = times.and_then(|times| rows(&times));
    rows.ok_or_else(|| Failure::new(format!("`{}`: found {text}", words(&script))))
}

/// The extremes over the traces. `None` if an estimator is missing.
fn rows(times: &[Times]) -> Option<Vec<Measured>> {
    let extreme = |estimator: &str, of: fn(&Times) -> f64, pick: fn(f64, f64) -> f64| {
        times.iter().filter(|times| times.estimator == estimator).map(of).reduce(pick)
    };
    let above: fn(&Times) -> f64 = |times| 1e-3 * (times.step_ns - times.rust_step_ns);
    let ratio: fn(&Times) -> f64 = |times| times.replay_ns / times.rust_replay_ns;
    let mean: fn(&Times) -> f64 = |times| 1e-3 * times.rust_step_ns;
    let p99: fn(&Times) -> f64 = |times| 1e-3 * times.rust_step_p99_ns;
    let largest: fn(&Times) -> f64 = |times| 1e-6 * times.rust_step_largest_ns;
    let row = |id: &'static str, estimator: &str, about: &str, value: Option<f64>, unit: &'static str| {
        let about = format!("{estimator}, ten traces of the standard suite: {about}");
        Some(Measured::new(id, about, value?, unit))
    };
    let (few, many) = ("paper-ekf", "recommended");
    let times_of_rust = "time of replay over that in Rust, largest";
    [
        row("step_above", few, "time of step less that in Rust, largest", extreme(few, above, f64::max), "µs"),
        row("replay_paper-ekf", few, times_of_rust, extreme(few, ratio, f64::max), ""),
        row("replay_recommended", many, times_of_rust, extreme(many, ratio, f64::max), ""),
        row("step_least", many, "mean time of a step in Rust, smallest", extreme(many, mean, f64::min), "µs"),
        row("step_most", many, "mean time of a step in Rust, largest", extreme(many, mean, f64::max), "µs"),
        row("step_p99_least", many, "99th percentile of a step in Rust, smallest", extreme(many, p99, f64::min), "µs"),
        row("step_p99_most", many, "99th percentile of a step in Rust, largest", extreme(many, p99, f64::max), "µs"),
        row("step_largest", many, "longest step of a trace in Rust, largest", extreme(many, largest, f64::max), "ms"),
    ]
    .into_iter()
    .collect()
}

/// Times of an estimator on a trace.
struct Times {
    estimator: String,
    rust_step_ns: f64,
    step_ns: f64,
    rust_replay_ns: f64,
    replay_ns: f64,
    rust_step_p99_ns: f64,
    rust_step_largest_ns: f64,
}

impl Times {
    /// A row of the script's table.
    fn of_row(line: &str) -> Option<Self> {
        let cells: Vec<&str> = line.trim().split(',').collect();
        let number = |cell: usize| cells.get(cell)?.parse().ok();
        Some(Self {
            estimator: (*cells.get(1)?).into(),
            rust_step_ns: number(2)?,
            step_ns: number(3)?,
            rust_replay_ns: number(4)?,
            replay_ns: number(5)?,
            rust_step_p99_ns: number(6)?,
            rust_step_largest_ns: number(7)?,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn verif_rows_are_the_extremes_over_the_traces() {
        let table = [
            "a,paper-ekf,100,300,200,210,150,1e5",
            "b,paper-ekf,100,250,200,190,150,1e5",
            "a,recommended,2e4,2e4,2e4,2e4,5e4,9e6",
        ];
        let times: Vec<_> = table.iter().map(|line| Times::of_row(line).unwrap()).collect();
        let found = rows(&times).unwrap();
        let values: Vec<_> = found.iter().map(|row| row.value).collect();
        assert_eq!(values, [0.2, 1.05, 1.0, 20.0, 20.0, 50.0, 50.0, 9.0]);
        assert!(rows(&times[..2]).is_none() && Times::of_row("a,paper-ekf,1").is_none());
    }
}
