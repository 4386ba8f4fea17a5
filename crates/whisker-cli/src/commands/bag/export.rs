//! `whisker bag export`: a trace as a recording.

use std::path::PathBuf;
use std::process::ExitCode;

use trace::Sidecar;

use crate::commands::output::{files_of_trace, reserve};
use crate::commands::print;
use crate::ros::{Export, export_trace};

/// Write a trace as a rosbag2 folder
#[derive(clap::Args)]
pub(super) struct Arguments {
    /// Trace: its .csv or .json file
    trace: PathBuf,
    /// Folder to write
    #[arg(long)]
    out: PathBuf,
    /// Estimated contacts to include: a table of `estimates/` in a run of `whisker evaluate`
    #[arg(long)]
    estimates: Option<PathBuf>,
}

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<ExitCode> {
    let inputs = files_of_trace(&arguments.trace, &Sidecar::read(&arguments.trace)?);
    let _lock = reserve(&arguments.out, &[inputs.as_slice(), arguments.estimates.as_slice()].concat())?;
    let export = export_trace(&arguments.trace, arguments.estimates.as_deref(), &arguments.out)?;
    let note = if export == Export::UpToDate { " (up to date)" } else { "" };
    print(&format!("{}{note}\n", arguments.out.display()))?;
    Ok(ExitCode::SUCCESS)
}
