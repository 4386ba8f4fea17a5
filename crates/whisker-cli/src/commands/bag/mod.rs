//! `whisker bag`: recordings for ROS 2 and Foxglove, one file per command.

mod export;
mod import;
mod info;

use std::process::ExitCode;

use clap::Subcommand;

/// Convert traces and logs to ROS 2 recordings (rosbag2, MCAP) and back
#[derive(clap::Args)]
pub(super) struct Arguments {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    Export(export::Arguments),
    Import(import::Arguments),
    Info(info::Arguments),
}

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<ExitCode> {
    match &arguments.command {
        Command::Export(arguments) => export::run(arguments),
        Command::Import(arguments) => import::run(arguments),
        Command::Info(arguments) => info::run(arguments),
    }
}
