//! `whisker platform list`: the registry of line formats.

use std::process::ExitCode;

use platform::sensor::FORMATS;

use crate::commands::print;

/// List the line formats of magnetometers
#[derive(clap::Args)]
pub(super) struct Arguments {}

pub(super) fn run(_: &Arguments) -> anyhow::Result<ExitCode> {
    let rows = FORMATS.iter().map(|row| format!("{:<12} {} ({} Hz)\n", row.name, row.about, row.rate_hz));
    print(&rows.collect::<String>())?;
    Ok(ExitCode::SUCCESS)
}
