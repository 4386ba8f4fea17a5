//! Fuzzing of every parser, one target after another or several at a time. New inputs are kept in `fuzz/found/`,
//! crashes in `fuzz/artifacts/`.

use std::ffi::OsStr;
use std::fs::{self, File};
use std::path::Path;
use std::process::Command;
use std::sync::Mutex;
use std::thread;

use crate::failure::{Failure, Outcome};
use crate::repository::root;
use crate::tools::{run as run_command, tool};

/// Folder of the fuzzing package, the corpus and the targets.
const FOLDER: &str = "fuzz";

/// Default duration of a target (s).
const SECONDS: u64 = 600;

/// Longest input (bytes), and the time (s) and memory (MB) that one input may take. An import fits the rig to the file,
/// which takes up to two seconds in a release build and half a minute under the sanitizers.
const LIMITS: [&str; 3] = ["-max_len=8192", "-timeout=120", "-rss_limit_mb=3000"];

const CARGO_FUZZ: (&str, &str) = ("cargo-fuzz", "0.13.2");

pub(crate) fn run(arguments: &[String]) -> Outcome {
    let chosen = Chosen::from(arguments)?;
    let targets = targets()?;
    if let Some(target) = &chosen.target
        && !targets.contains(target)
    {
        return Err(Failure::new(format!("unknown target `{target}`, expected one of: {}", targets.join(", "))));
    }
    let fuzz = tool(CARGO_FUZZ)?;
    // The sanitizers need a nightly compiler.
    let program = |verb: &str| {
        let mut command = Command::new(&fuzz);
        command
            .args(["fuzz", verb, "--fuzz-dir", "."])
            .current_dir(root().join(FOLDER))
            .env("RUSTUP_TOOLCHAIN", "nightly");
        command
    };
    let mut build = program("build");
    build.arg("parser");
    run_command(build)?;
    let selected = targets.into_iter().filter(|target| chosen.target.as_ref().is_none_or(|chosen| chosen == target));
    let waiting = Mutex::new(selected);
    let work = || {
        let mut failed = Vec::new();
        loop {
            // The lock is released before the target runs.
            let next = waiting.lock().expect("no target panics").next();
            let Some(target) = next else { return failed };
            if let Err(failure) = fuzz_one(program("run"), &target, chosen.seconds) {
                eprintln!("error: {target}: {failure}");
                failed.push(target);
            }
        }
    };
    let mut failed = thread::scope(|scope| {
        let jobs: Vec<_> = (0..chosen.jobs).map(|_| scope.spawn(work)).collect();
        jobs.into_iter().flat_map(|job| job.join().expect("no target panics")).collect::<Vec<_>>()
    });
    failed.sort();
    if failed.is_empty() { Ok(()) } else { Err(Failure::new(format!("findings in: {}", failed.join(", ")))) }
}

/// Fuzzes one target. Its output goes to `fuzz/found/<target>.log`, whose last line, with the number of inputs, is printed.
fn fuzz_one(mut command: Command, target: &str, seconds: u64) -> Outcome {
    let found = root().join(FOLDER).join("found").join(target);
    let log = found.with_extension("log");
    let unwritable = |path: &Path, error| Failure::new(format!("{}: {error}", path.display()));
    fs::create_dir_all(&found).map_err(|error| unwritable(&found, error))?;
    let output = File::create(&log).map_err(|error| unwritable(&log, error))?;
    command.stdout(output.try_clone().map_err(|error| unwritable(&log, error))?).stderr(output);
    command.env("WHISKER_FUZZ", target).arg("parser").arg(&found).arg(format!("corpus/{target}")).arg("--");
    command.args(LIMITS).arg(format!("-max_total_time={seconds}"));
    let outcome = run_command(command);
    let printed = fs::read_to_string(&log).unwrap_or_default();
    match &outcome {
        Ok(()) => println!("{target}: {}", printed.lines().rev().find(|line| line.starts_with("Done ")).unwrap_or("")),
        Err(_) => eprint!("{printed}"),
    }
    outcome
}

/// Parsed arguments.
struct Chosen {
    target: Option<String>,
    seconds: u64,
    /// Number of targets at a time.
    jobs: u64,
}

impl Chosen {
    fn from(arguments: &[String]) -> Result<Self, Failure> {
        let mut chosen = Self { target: None, seconds: SECONDS, jobs: 1 };
        let mut arguments = arguments.iter();
        while let Some(argument) = arguments.next() {
            match argument.as_str() {
                "--seconds" => chosen.seconds = positive("--seconds", arguments.next())?,
                "--jobs" => chosen.jobs = positive("--jobs", arguments.next())?,
                name if chosen.target.is_none() && !name.starts_with('-') => chosen.target = Some(name.into()),
                surplus => {
                    return Err(Failure::new(format!("found `{surplus}`, expected [TARGET] [--seconds N] [--jobs N]")));
                }
            }
        }
        Ok(chosen)
    }
}

/// Value of an option that is a number above zero.
fn positive(option: &str, value: Option<&String>) -> Result<u64, Failure> {
    let value = value.map(String::as_str).unwrap_or_default();
    let number = value.parse().ok().filter(|number| *number > 0);
    number.ok_or_else(|| Failure::new(format!("{option}: found `{value}`, expected a number above zero")))
}

/// Names of the targets, each a folder of the corpus.
fn targets() -> Result<Vec<String>, Failure> {
    let corpus = Path::new(FOLDER).join("corpus");
    let unreadable = |error| Failure::new(format!("{}: {error}", corpus.display()));
    let mut targets = Vec::new();
    for entry in fs::read_dir(root().join(&corpus)).map_err(unreadable)? {
        targets.push(OsStr::to_string_lossy(&entry.map_err(unreadable)?.file_name()).into_owned());
    }
    targets.sort();
    Ok(targets)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn chosen(words: &[&str]) -> Result<Chosen, Failure> {
        Chosen::from(&words.iter().map(|&word| word.to_owned()).collect::<Vec<_>>())
    }

    #[test]
    fn verif_arguments_choose_target_time_and_jobs() {
        let chosen_one = chosen(&["trace", "--seconds", "5", "--jobs", "3"]).unwrap();
        assert_eq!((chosen_one.target.as_deref(), chosen_one.seconds, chosen_one.jobs), (Some("trace"), 5, 3));
        for words in [&["trace", "sidecar"][..], &["--seconds"], &["--seconds", "0"], &["--jobs", "0"], &["--fast"]] {
            assert!(chosen(words).is_err(), "{words:?}");
        }
    }

    #[test]
    fn verif_every_parser_has_a_corpus() {
        assert!(targets().unwrap().iter().any(|target| target == "trace"));
    }
}
