//! Fuzzing of every parser, one target after another. New inputs are kept in `fuzz/found/`, crashes in `fuzz/artifacts/`.

use std::ffi::OsStr;
use std::fs;
use std::path::Path;
use std::process::Command;

use crate::failure::{Failure, Outcome};
use crate::parts::step;
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
    for target in targets.iter().filter(|target| chosen.target.as_ref().is_none_or(|chosen| chosen == *target)) {
        let found = root().join(FOLDER).join("found").join(target);
        fs::create_dir_all(&found).map_err(|error| Failure::new(format!("{}: {error}", found.display())))?;
        let mut command = program("run");
        command.env("WHISKER_FUZZ", target).arg("parser").arg(&found).arg(format!("corpus/{target}")).arg("--");
        command.args(LIMITS).arg(format!("-max_total_time={}", chosen.seconds));
        step(&format!("{target}: {} s", chosen.seconds), || run_command(command))?;
    }
    Ok(())
}

/// Parsed arguments.
struct Chosen {
    target: Option<String>,
    seconds: u64,
}

impl Chosen {
    fn from(arguments: &[String]) -> Result<Self, Failure> {
        let mut chosen = Self { target: None, seconds: SECONDS };
        let mut arguments = arguments.iter();
        while let Some(argument) = arguments.next() {
            match argument.as_str() {
                "--seconds" => {
                    let value = arguments.next().map(String::as_str).unwrap_or_default();
                    let seconds = value.parse().ok().filter(|seconds| *seconds > 0);
                    chosen.seconds = seconds.ok_or_else(|| {
                        Failure::new(format!("--seconds: found `{value}`, expected a number above zero"))
                    })?;
                }
                name if chosen.target.is_none() && !name.starts_with('-') => chosen.target = Some(name.into()),
                surplus => return Err(Failure::new(format!("found `{surplus}`, expected [TARGET] [--seconds N]"))),
            }
        }
        Ok(chosen)
    }
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
    fn arguments_choose_target_and_time() {
        let chosen_one = chosen(&["trace", "--seconds", "5"]).unwrap();
        assert_eq!((chosen_one.target.as_deref(), chosen_one.seconds), (Some("trace"), 5));
        for words in [&["trace", "sidecar"][..], &["--seconds"], &["--seconds", "0"], &["--fast"]] {
            assert!(chosen(words).is_err(), "{words:?}");
        }
    }

    #[test]
    fn every_parser_has_a_corpus() {
        assert!(targets().unwrap().iter().any(|target| target == "trace"));
    }
}
