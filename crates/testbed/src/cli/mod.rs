//! The command line: one file a command.
//!
//! Exit codes: 0 good, 1 failed, 2 wrong usage, 3 finished with failed items. Results go to stdout, diagnostics to stderr.

mod check;
mod evaluate;
mod fit;
mod list;
mod python;
mod replay;
mod report;
mod reproduce;
mod simulate;
mod table;

use std::process::ExitCode;
use std::time::Duration;

use clap::{Parser, Subcommand};
use indicatif::{ProgressBar, ProgressStyle};

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
    Fit(fit::Arguments),
    Replay(replay::Arguments),
    Evaluate(evaluate::Arguments),
    Report(report::Arguments),
    Check(check::Arguments),
    List(list::Arguments),
    Reproduce(reproduce::Arguments),
}

/// Runs the command that the program's arguments name.
///
/// # Errors
/// Whatever keeps the command from its end.
pub fn run() -> anyhow::Result<ExitCode> {
    match Arguments::parse().command {
        Command::Simulate(arguments) => simulate::run(&arguments),
        Command::Fit(arguments) => fit::run(&arguments),
        Command::Replay(arguments) => replay::run(&arguments),
        Command::Evaluate(arguments) => evaluate::run(&arguments),
        Command::Report(arguments) => report::run(&arguments),
        Command::Check(arguments) => check::run(&arguments),
        Command::List(arguments) => list::run(&arguments),
        Command::Reproduce(arguments) => reproduce::run(&arguments),
    }
}

/// A progress bar on stderr with an estimate of the time left.
fn progress_bar(what: &'static str) -> ProgressBar {
    let style = ProgressStyle::with_template("{msg} [{bar:30}] {pos}/{len}, {eta} left")
        .expect("the template is valid")
        .progress_chars("=> ");
    let bar = ProgressBar::no_length().with_style(style).with_message(what);
    bar.enable_steady_tick(Duration::from_millis(200));
    bar
}

/// A fraction that measurement noise can be.
fn noise_fraction(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(value) if value.is_finite() && value >= 0.0 => Ok(value),
        _ => Err("expected a fraction of the largest reading, 0 or more, for example 0.01".into()),
    }
}
