//! `whisker bag export`: a trace, or an array recording, as a ROS 2 recording.

use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::ensure;
use trace::{ArrayRecording, Sidecar, is_spatial};

use crate::commands::output::{files_of_trace, reserve};
use crate::commands::print;
use crate::ros::{Export, export_array, export_spatial_trace, export_trace};

/// Write a trace, or a recording of several whiskers, as a rosbag2 folder
#[derive(clap::Args)]
pub(super) struct Arguments {
    /// Trace: its .csv or .json file; or recording of several whiskers (.json)
    trace: PathBuf,
    /// Folder to write
    #[arg(long)]
    out: PathBuf,
    /// Estimated contacts to include: a table of `estimates/` in a run of `whisker evaluate`, for a trace in space of
    /// `space_estimates/`
    #[arg(long)]
    estimates: Option<PathBuf>,
}

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<ExitCode> {
    let is_array = arguments.trace.extension().is_some_and(|extension| extension == "json")
        && ArrayRecording::is_one(&arguments.trace)?;
    if is_array {
        ensure!(
            arguments.estimates.is_none(),
            "--estimates: found with a recording of several whiskers, expected with a trace"
        );
        let _lock = reserve(&arguments.out, std::slice::from_ref(&arguments.trace))?;
        return finish(arguments, export_array(&arguments.trace, &arguments.out)?);
    }
    if arguments.trace.with_extension("json").is_file() && is_spatial(&arguments.trace)? {
        let files = ["csv", "json"].map(|extension| arguments.trace.with_extension(extension));
        let _lock = reserve(&arguments.out, &[files.as_slice(), arguments.estimates.as_slice()].concat())?;
        let export = export_spatial_trace(&arguments.trace, arguments.estimates.as_deref(), &arguments.out)?;
        return finish(arguments, export);
    }
    let inputs = files_of_trace(&arguments.trace, &Sidecar::read(&arguments.trace)?);
    let _lock = reserve(&arguments.out, &[inputs.as_slice(), arguments.estimates.as_slice()].concat())?;
    finish(arguments, export_trace(&arguments.trace, arguments.estimates.as_deref(), &arguments.out)?)
}

/// Prints the result.
fn finish(arguments: &Arguments, export: Export) -> anyhow::Result<ExitCode> {
    let note = if export == Export::UpToDate { " (up to date)" } else { "" };
    print(&format!("{}{note}\n", arguments.out.display()))?;
    Ok(ExitCode::SUCCESS)
}
