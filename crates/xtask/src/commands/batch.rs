//! Time and memory of batches, a report and long traces: the figures of `docs/PERFORMANCE.md` under "Batch".

use std::fs;
use std::path::Path;
use std::process::{Command, Stdio};
use std::thread::sleep;
use std::time::{Duration, Instant};

use crate::failure::{Failure, Outcome};
use crate::parts::step;
use crate::pipeline::{self, Evaluations};
use crate::repository::root;
use crate::tools::{built_whisker, cargo, run as run_command};

const SUITE: &str = "standard";
/// Folder of the files that only this measurement uses.
const FOLDER: &str = "target/batch";
/// Traces of the Monte-Carlo, and its seeds: 10,000 trials.
const TRACES: u32 = 10;
const SEEDS: &str = "1000";
const WHISKERS: [&str; 2] = ["straight", "curved"];
const ESTIMATORS: [&str; 2] = ["paper-ekf", "ekf"];
/// Rows of the long trace.
const ROWS: &str = "10000000";

pub(crate) fn run() -> Outcome {
    pipeline::prepare()?;
    pipeline::simulate(SUITE)?;
    pipeline::fit(SUITE)?;
    step("reading and writing of traces", || run_command(cargo(&["bench", "--package", "trace"])))?;
    step("a Monte-Carlo of 10,000 trials", monte_carlo)?;
    Evaluations::new(false).of(SUITE, None)?;
    step("the report of the standard suite", report)?;
    step("a trace of 10 million rows", long_trace)
}

fn monte_carlo() -> Outcome {
    for whisker in WHISKERS {
        let traces = format!("{FOLDER}/{whisker}");
        for trace in 0..TRACES {
            for file in ["csv", "json", "contour.csv"] {
                let name = format!("pin_{whisker}_{trace:02}.{file}");
                copy(&format!("datasets/{SUITE}/{name}"), &format!("{traces}/{name}"))?;
            }
        }
        for estimator in ESTIMATORS {
            let mut elapsed_s = Vec::new();
            for threads in ["1", "2"] {
                let name = format!("{whisker}-{estimator}-{threads}");
                let results = format!("{FOLDER}/results");
                // An existing run would be reused.
                let _ = fs::remove_dir_all(root().join(&results).join(&name));
                let calibrations = format!("datasets/{SUITE}/calibrations");
                let places = ["--calibrations", &calibrations, "--results", &results, "--name", &name];
                let work = ["--estimators", estimator, "--seeds", SEEDS, "--threads", threads];
                let cost = Cost::of(&[&["evaluate", &traces], &places[..], &work].concat())?;
                println!("{whisker:8} {estimator:9} {threads} threads: {cost}");
                elapsed_s.push(cost.elapsed.as_secs_f64());
            }
            println!(
                "{whisker:8} {estimator:9} one thread takes {:.2} times as long as two",
                elapsed_s[0] / elapsed_s[1]
            );
        }
    }
    Ok(())
}

/// The evaluation merges contours; the report draws them.
fn report() -> Outcome {
    println!("{}", Cost::of(&["report", &format!("results/{SUITE}")])?);
    Ok(())
}

fn long_trace() -> Outcome {
    let source = format!("datasets/{SUITE}/pin_straight_00.csv");
    let make = ["run", "--quiet", "--release", "--package", "evaluation", "--example", "long_trace", "--"];
    run_command(cargo(&[&make[..], &[&source, ROWS, FOLDER]].concat()))?;
    let calibration = format!("datasets/{SUITE}/calibrations/straight.json");
    let trace = format!("{FOLDER}/long.csv");
    let out = format!("{FOLDER}/long.estimates.csv");
    let cost = Cost::of(&["replay", &trace, "--calibration", &calibration, "--estimator", "paper-ekf", "--out", &out])?;
    println!("replay of {ROWS} rows: {cost}");
    for file in [trace, format!("{FOLDER}/long.json"), out] {
        let path = root().join(&file);
        fs::remove_file(&path).map_err(|error| Failure::new(format!("{}: {error}", path.display())))?;
    }
    Ok(())
}

fn copy(from: &str, to: &str) -> Outcome {
    let (from, to) = (root().join(from), root().join(to));
    let copy = || {
        fs::create_dir_all(to.parent().unwrap_or(Path::new(".")))?;
        fs::copy(&from, &to)
    };
    copy().map(drop).map_err(|error| Failure::new(format!("{} to {}: {error}", from.display(), to.display())))
}

/// Resources that a command used.
struct Cost {
    elapsed: Duration,
    /// Processor time summed over threads (s). `None` where the system has no `/proc`.
    processors_s: Option<f64>,
    /// Peak resident memory (kB). `None` where the system has no `/proc`.
    memory_kb: Option<u64>,
}

impl Cost {
    /// Runs a command of `whisker`, which is built already, to its end.
    fn of(arguments: &[&str]) -> Result<Self, Failure> {
        let path = built_whisker();
        let failed = |reason: String| Failure::new(format!("{} {}: {reason}", path.display(), arguments.join(" ")));
        let begun = Instant::now();
        let mut command = Command::new(&path);
        command.args(arguments).current_dir(root()).stdout(Stdio::null());
        let mut child = command.spawn().map_err(|error| failed(error.to_string()))?;
        let id = child.id();
        let proc = |file: &str| fs::read_to_string(format!("/proc/{id}/{file}")).ok();
        let (mut processors_s, mut memory_kb) = (None, None);
        let ended = loop {
            // /proc holds the figures as long as the process runs.
            memory_kb = proc("status").as_deref().and_then(largest_kb).or(memory_kb);
            processors_s = proc("stat").as_deref().and_then(processors).or(processors_s);
            match child.try_wait() {
                Ok(Some(ended)) => break ended,
                Ok(None) => sleep(Duration::from_millis(5)),
                Err(error) => return Err(failed(error.to_string())),
            }
        };
        if !ended.success() {
            return Err(failed(ended.to_string()));
        }
        Ok(Self { elapsed: begun.elapsed(), processors_s, memory_kb })
    }
}

/// Peak resident memory in a `/proc/<id>/status` (kB).
fn largest_kb(status: &str) -> Option<u64> {
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"))?;
    line.trim().strip_suffix("kB")?.trim().parse().ok()
}

/// Processor time in a `/proc/<id>/stat` (s): the 14th and 15th field, in hundredths; the second field is a name in brackets.
fn processors(stat: &str) -> Option<f64> {
    const TICKS_PER_S: f64 = 100.0;
    let mut fields = stat.rsplit_once(')')?.1.split_whitespace().skip(11);
    let (user, system): (f64, f64) = (fields.next()?.parse().ok()?, fields.next()?.parse().ok()?);
    Some((user + system) / TICKS_PER_S)
}

impl std::fmt::Display for Cost {
    fn fmt(&self, out: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(out, "{:.2} s", self.elapsed.as_secs_f64())?;
        if let Some(seconds) = self.processors_s {
            write!(out, ", {seconds:.2} s on all processors")?;
        }
        match self.memory_kb {
            Some(kb) => write!(out, ", {:.0} MB at most", kb as f64 / 1e3),
            None => Ok(()),
        }
    }
}
