//! `whisker platform`: the calibration platform, one file per subcommand.

mod cross_validate;
#[cfg(unix)]
mod emulate;
mod events;
mod fit;
mod infer;
mod list;
mod logs;
mod run;

use std::path::Path;
use std::process::ExitCode;

use anyhow::Context;
use clap::Subcommand;
use platform::calibration::{Calibration, Live, is_same_rate};
use platform::inference::Inference;
use platform::rig::Rig;
use platform::sensor::{self, FORMATS, FormatRow, Report};

use super::diagnose;

/// Drive the calibration platform: a printer pushes a ruler against a whisker, a magnetometer measures its deflection
#[derive(clap::Args)]
pub(super) struct Arguments {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    Run(run::Arguments),
    #[cfg(unix)]
    Emulate(emulate::Arguments),
    List(list::Arguments),
    Fit(fit::Arguments),
    CrossValidate(cross_validate::Arguments),
    Infer(infer::Arguments),
}

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<ExitCode> {
    match &arguments.command {
        Command::Run(arguments) => run::run(arguments),
        #[cfg(unix)]
        Command::Emulate(arguments) => emulate::run(arguments),
        Command::List(arguments) => list::run(arguments),
        Command::Fit(arguments) => fit::run(arguments),
        Command::CrossValidate(arguments) => cross_validate::run(arguments),
        Command::Infer(arguments) => infer::run(arguments),
    }
}

/// The rig of a file, or the built-in one.
fn rig(path: Option<&Path>) -> anyhow::Result<Rig> {
    Ok(path.map_or_else(|| Ok(Rig::built_in()), Rig::read)?)
}

/// Row of the registry of line formats.
fn format(name: &str) -> anyhow::Result<&'static FormatRow> {
    sensor::format(name).with_context(|| {
        let known: Vec<_> = FORMATS.iter().map(|row| row.name).collect();
        format!("unknown line format `{name}`, expected one of: {}", known.join(", "))
    })
}

/// Reads a calibration, with a note on stderr if it has no coefficients and was fitted again.
fn calibration(path: &Path) -> anyhow::Result<Calibration> {
    let calibration = Calibration::read(path)?;
    if calibration.was_fitted_on_reading() {
        diagnose(&format!(
            "note: {}: has no coefficients and was fitted again; `whisker platform fit` on its logs stores them",
            path.display()
        ));
    }
    Ok(calibration)
}

/// Inference on a stream of samples; the path is for the error.
fn inference<'a>(calibration: &'a Calibration, path: &Path) -> anyhow::Result<Inference<'a>> {
    let live = Live::new(calibration)?.with_context(|| {
        format!(
            "{}: chain: found null, expected the chain of a calibration from logs of samples; this one is from a table of presses",
            path.display()
        )
    })?;
    Ok(Inference::new(live))
}

/// Prints the statistics of a port to stderr, with a warning if its rate is not the calibration's.
fn report(report: &Report, calibration: Option<&Calibration>) {
    diagnose(&report.to_string());
    if let Some(calibration) = calibration {
        warn_of_rate(report.rate_hz, calibration);
    }
}

/// Warns on stderr if the sampling rate is not the calibration's, whose low-pass and slopes count samples.
fn warn_of_rate(found_hz: f64, calibration: &Calibration) {
    let calibrated_hz = calibration.chain().map(|chain| chain.rate_hz);
    if let Some(rate_hz) = calibrated_hz.filter(|rate_hz| !is_same_rate(found_hz, *rate_hz)) {
        diagnose(&format!(
            "warning: found {found_hz:.1} samples a second, expected {rate_hz:.1} as in the calibration: its distances are wrong"
        ));
    }
}

/// Parses a rate in readings per second.
fn rate_hz(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(value) if (1.0..=10_000.0).contains(&value) => Ok(value),
        _ => Err("expected readings per second, 1 to 10000, for example 800".into()),
    }
}
