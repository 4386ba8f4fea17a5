//! `whisker report`: figures and page of a run.

use std::path::PathBuf;
use std::process::ExitCode;

use super::print;

/// Draw the figures and the page of an evaluated run
#[derive(clap::Args)]
pub(super) struct Arguments {
    /// Folder of the run, for example results/standard
    run: PathBuf,
}

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<ExitCode> {
    let paths = crate::report::report(&arguments.run)?;
    let lines = std::iter::once(&paths.page).chain(&paths.figures).map(|path| format!("{}\n", path.display()));
    print(&lines.collect::<String>())?;
    Ok(ExitCode::SUCCESS)
}
