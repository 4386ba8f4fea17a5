//! `whisker platform`: the calibration platform, one file a subcommand.

mod cross_validate;
mod fit;
mod infer;
mod logs;

use std::process::ExitCode;

use clap::Subcommand;

/// The calibration platform: a printer pushes a whisker, a magnetometer listens
#[derive(clap::Args)]
pub(super) struct Arguments {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    Fit(fit::Arguments),
    CrossValidate(cross_validate::Arguments),
    Infer(infer::Arguments),
}

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<ExitCode> {
    match &arguments.command {
        Command::Fit(arguments) => fit::run(arguments),
        Command::CrossValidate(arguments) => cross_validate::run(arguments),
        Command::Infer(arguments) => infer::run(arguments),
    }
}
