//! `whisker bag import`: a recording as a trace or a log.

use std::path::PathBuf;
use std::process::ExitCode;
use std::slice;

use crate::commands::output::reserve;
use crate::commands::print;
use crate::ros;

/// Convert a recording back into its trace, or its readings into a log for `whisker platform`
#[derive(clap::Args)]
pub(super) struct Arguments {
    /// Rosbag2 folder or MCAP file
    recording: PathBuf,
    /// Folder to write to
    #[arg(long)]
    out: PathBuf,
    /// Convert an interrupted recording, up to the point of interruption
    #[arg(long)]
    salvage: bool,
}

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<ExitCode> {
    let _lock = reserve(&arguments.out, slice::from_ref(&arguments.recording))?;
    for file in ros::import(&arguments.recording, arguments.salvage, &arguments.out)? {
        print(&format!("{}\n", file.display()))?;
    }
    Ok(ExitCode::SUCCESS)
}
