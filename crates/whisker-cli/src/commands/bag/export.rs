//! `whisker bag export`: a trace as a recording.

use std::path::PathBuf;
use std::process::ExitCode;

use crate::commands::print;
use crate::ros::export_trace;

/// Write a trace as a rosbag2 folder
#[derive(clap::Args)]
pub(super) struct Arguments {
    /// Trace: its .csv or .json file
    trace: PathBuf,
    /// Folder to write; it must not exist
    #[arg(long)]
    out: PathBuf,
    /// Estimated contacts to include: a table of `estimates/` in a run of `whisker evaluate`
    #[arg(long)]
    estimates: Option<PathBuf>,
}

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<ExitCode> {
    export_trace(&arguments.trace, arguments.estimates.as_deref(), &arguments.out)?;
    print(&format!("{}\n", arguments.out.display()))?;
    Ok(ExitCode::SUCCESS)
}
