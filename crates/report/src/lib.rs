//! Draws results: every figure as SVG and PNG, and one page that needs no other file.
//!
//! There are two kinds of results, evaluated runs (see [`testbed::results`]) and the study of the physics (`physics`). The
//! report knows their files and nothing else: it can be drawn again at any time, and the same results give the same bytes.

use std::path::{Path, PathBuf};

use anyhow::Result;
use files::write_atomically;

mod all_metrics;
mod animations;
mod axes;
mod canvas;
mod compare;
mod consistency;
mod contour_panel;
mod contours;
mod figure;
mod figures;
mod page;
mod physics;
mod replay;
mod run_data;
mod style;
mod surface;
#[cfg(test)]
mod tests;

use figure::draw_all;
use figures::FIGURES;
use run_data::RunData;

/// What [`report`] wrote.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ReportPaths {
    /// The page.
    pub page: PathBuf,
    /// The figures, SVG and PNG of each in turn.
    pub figures: Vec<PathBuf>,
}

/// Copies the animations of a run's sets from a folder into that of the run, from which the report links them.
///
/// # Errors
/// When a folder is missing, or a file cannot be copied; the error names it.
pub fn take_animations(run: &Path, from: &Path) -> Result<()> {
    animations::take(run, from)
}

/// Reads the results in a folder and writes `index.html` and `figures/<name>.svg` and `.png` there.
///
/// # Errors
/// When a file of the results is missing or damaged, holds no scores, or a file cannot be written; the error names the file
/// and, for a damaged one, line and column.
pub fn report(folder: &Path) -> Result<ReportPaths> {
    let (html, figures) = if physics::is_study(folder) {
        let data = physics::Data::read(folder)?;
        let (drawn, figures) = draw_all(folder, physics::FIGURES, &data)?;
        (physics::html(&data, &drawn)?, figures)
    } else {
        let data = RunData::read(folder)?;
        let (drawn, figures) = draw_all(folder, FIGURES, &data)?;
        let animations = animations::read(folder, &data.run.sets)?;
        (page::html(&data, &animations, &drawn)?, figures)
    };
    let page = folder.join("index.html");
    write_atomically(&page, html.as_bytes())?;
    Ok(ReportPaths { page, figures })
}

/// Name and title of every figure of an evaluated run, in the order of the page.
pub fn figures() -> impl Iterator<Item = (&'static str, &'static str)> {
    FIGURES.iter().map(|figure| (figure.name, figure.title))
}

/// Name and title of every figure of the physics study, in the order of the page.
pub fn physics_figures() -> impl Iterator<Item = (&'static str, &'static str)> {
    physics::FIGURES.iter().map(|figure| (figure.name, figure.title))
}
