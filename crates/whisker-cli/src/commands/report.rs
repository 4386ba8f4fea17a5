//! `whisker report`: figures and page of a run.

use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::{Context, bail};
use files::remove_temporary;
use report::{report, take_animations};

use super::output::reserve_folder;
use super::print;
use super::progress::Progress;

/// Draw the figures and the page of an evaluated run into its folder (index.html, figures/)
#[derive(clap::Args)]
pub(super) struct Arguments {
    /// Folder of the run, for example results/standard
    run: PathBuf,
    /// Folder of animations (`whisker-sim render`) to copy into the run and to link
    #[arg(long)]
    animations: Option<PathBuf>,
}

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<ExitCode> {
    if !arguments.run.is_dir() {
        bail!("{}: no such run; make it by `whisker evaluate`", arguments.run.display());
    }
    let _lock = reserve_folder(&arguments.run, &[])?;
    let figures = arguments.run.join("figures");
    if figures.is_dir() {
        remove_temporary(&figures).with_context(|| figures.display().to_string())?;
    }
    if let Some(folder) = &arguments.animations {
        take_animations(&arguments.run, folder)?;
    }
    let paths = report(&arguments.run, &Progress::of("drawing"))?;
    let lines = std::iter::once(&paths.page).chain(&paths.figures).map(|path| format!("{}\n", path.display()));
    print(&lines.collect::<String>())?;
    Ok(ExitCode::SUCCESS)
}
