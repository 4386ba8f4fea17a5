//! The command line, one file per command.
//!
//! Exit codes: 0 success, 1 failure, 2 usage error, 3 finished with failed items. Results go to stdout, diagnostics to stderr.

mod bag;
mod check;
mod evaluate;
mod fit;
mod front_end;
mod import;
mod list;
mod live;
mod mount;
mod output;
mod platform;
mod played;
mod progress;
mod python;
mod recordings;
mod remarks;
mod replay;
mod report;
mod reproduce;
mod simulate;
mod space;
mod table;

use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use clap::{CommandFactory, FromArgMatches, Parser, Subcommand};
use files::read_json;
use serde::Serialize;
use serde::de::DeserializeOwned;
use serde_json::Value;
use strict_json::{parse_json, reason};
use testbed::settings::SettingsOf;
use trace::MOST_NOISE;

/// Physics testbed for whisker contact localisation.
#[derive(Parser)]
#[command(name = "whisker", version, max_term_width = 100)]
struct Arguments {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    Simulate(simulate::Arguments),
    Import(import::Arguments),
    Fit(fit::Arguments),
    Mount(mount::Arguments),
    Replay(replay::Arguments),
    Live(live::Arguments),
    Evaluate(evaluate::Arguments),
    Recordings(recordings::Arguments),
    Report(report::Arguments),
    Check(check::Arguments),
    List(list::Arguments),
    Platform(platform::Arguments),
    Bag(bag::Arguments),
    Reproduce(reproduce::Arguments),
}

/// Runs the command given by the arguments of the process.
///
/// # Errors
/// If the command fails.
pub fn run() -> anyhow::Result<ExitCode> {
    let matches = with_negative_numbers(Arguments::command()).get_matches();
    match Arguments::from_arg_matches(&matches).unwrap_or_else(|error| error.exit()).command {
        Command::Simulate(arguments) => simulate::run(&arguments),
        Command::Import(arguments) => import::run(&arguments),
        Command::Fit(arguments) => fit::run(&arguments),
        Command::Mount(arguments) => mount::run(&arguments),
        Command::Replay(arguments) => replay::run(&arguments),
        Command::Live(arguments) => live::run(&arguments),
        Command::Evaluate(arguments) => evaluate::run(&arguments),
        Command::Recordings(arguments) => recordings::run(&arguments),
        Command::Report(arguments) => report::run(&arguments),
        Command::Check(arguments) => check::run(&arguments),
        Command::List(arguments) => list::run(&arguments),
        Command::Platform(arguments) => platform::run(&arguments),
        Command::Bag(arguments) => bag::run(&arguments),
        Command::Reproduce(arguments) => reproduce::run(&arguments),
    }
}

/// The command with negative numbers as values of its options, whose errors state the permitted range. By default such a number is
/// an unknown option.
fn with_negative_numbers(command: clap::Command) -> clap::Command {
    let permitted = |argument: clap::Arg| {
        let has_value = argument.get_action().takes_values();
        argument.allow_negative_numbers(has_value)
    };
    command.mut_args(permitted).mut_subcommands(with_negative_numbers)
}

/// Exit code of a batch in which some items failed.
const FINISHED_WITH_FAILURES: u8 = 3;

/// Writes results to stdout.
///
/// # Errors
/// If stdout cannot be written. A closed pipe, as after `head`, is an error that `main` turns into success.
fn print(text: &str) -> io::Result<()> {
    let mut stdout = io::stdout().lock();
    stdout.write_all(text.as_bytes())?;
    stdout.flush()
}

/// Writes a line to stderr. A stderr that is gone, such as that of a closed terminal, does not end the program.
fn diagnose(line: &str) {
    // There is no other place to report it.
    let _ = writeln!(io::stderr(), "{line}");
}

/// Parses a name in a list, which spaces may surround.
fn trimmed(text: &str) -> Result<String, String> {
    match text.trim() {
        "" => Err("found an empty name, expected names separated by commas".into()),
        name => Ok(name.into()),
    }
}

/// Parses measurement noise as a fraction of the largest reading.
fn noise_fraction(text: &str) -> Result<f64, String> {
    match text.trim().parse::<f64>() {
        Ok(value) if (0.0..=MOST_NOISE).contains(&value) => Ok(value),
        _ => Err(format!("expected a fraction of the largest reading, 0 to {MOST_NOISE}, for example 0.01")),
    }
}

/// Parses a seed.
fn seed(text: &str) -> Result<u64, String> {
    text.parse().map_err(|_| format!("expected a whole number, 0 to {}", u64::MAX))
}

/// Parses a value from JSON.
fn json<T: DeserializeOwned + Serialize>(text: &str) -> Result<T, String> {
    parse_json(text.as_bytes()).map_err(|error| match error.column() {
        0 => reason(&error),
        column => format!("column {column}: {}", reason(&error)),
    })
}

/// Whether an argument that is a JSON object or the name of a file is the former.
fn is_literal(text: &str) -> bool {
    text.trim_start().starts_with('{')
}

/// Names the file of the settings of estimators, if there is one, in an error of them.
fn in_file<T>(file: Option<&Path>, result: anyhow::Result<T>) -> anyhow::Result<T> {
    result.map_err(|error| match file {
        Some(path) if error.is::<SettingsOf>() => error.context(path.display().to_string()),
        _ => error,
    })
}

/// A JSON object, and its file unless it is given literally.
#[derive(Clone)]
struct JsonOrFile {
    value: Value,
    file: Option<PathBuf>,
}

impl JsonOrFile {
    fn parsed(text: &str) -> Result<Self, String> {
        Ok(Self { value: json_or_file(text)?, file: (!is_literal(text)).then(|| text.into()) })
    }
}

/// Parses a JSON object, given literally or as a file.
fn json_or_file(text: &str) -> Result<Value, String> {
    if is_literal(text) {
        return json(text);
    }
    let path = Path::new(text);
    if !path.exists() {
        return Err("found neither a JSON object nor a file".into());
    }
    read_json(path).map_err(|error| error.to_string())
}
