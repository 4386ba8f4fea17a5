//! `whisker report`: figures and page of a run.

use std::path::PathBuf;
use std::process::ExitCode;

use report::{report, take_animations};

use super::print;

/// Draw the figures and the page of an evaluated run
#[derive(clap::Args)]
pub(super) struct Arguments {
    /// Folder of the run, for example results/standard
    run: PathBuf,
    /// Folder of animations (`whisker-sim render`) to copy into the run and to link
    #[arg(long)]
    animations: Option<PathBuf>,
}

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<ExitCode> {
    if let Some(folder) = &arguments.animations {
        take_animations(&arguments.run, folder)?;
    }
    let paths = report(&arguments.run)?;
    let lines = std::iter::once(&paths.page).chain(&paths.figures).map(|path| format!("{}\n", path.display()));
    print(&lines.collect::<String>())?;
    Ok(ExitCode::SUCCESS)
}
