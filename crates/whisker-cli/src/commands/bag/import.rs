//! `whisker bag import`: a recording as a trace or a log.

use std::path::PathBuf;
use std::process::ExitCode;

use crate::commands::print;
use crate::ros;

/// Turn a recording into the trace that it was made of, or the readings in it into a log for `whisker platform`
#[derive(clap::Args)]
pub(super) struct Arguments {
    /// A rosbag2 folder or an MCAP file
    recording: PathBuf,
    /// Folder to write to
    #[arg(long)]
    out: PathBuf,
    /// Take the readings of a recording that was cut off as far as they go
    #[arg(long)]
    salvage: bool,
}

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<ExitCode> {
    for file in ros::import(&arguments.recording, arguments.salvage, &arguments.out)? {
        print(&format!("{}\n", file.display()))?;
    }
    Ok(ExitCode::SUCCESS)
}
