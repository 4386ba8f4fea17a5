//! Draws a run: every figure as SVG and PNG, and one page that needs no other file.
//!
//! The report knows the files of a run (see [`crate::results`]) and nothing else: it can be drawn again at any time, and
//! the same run gives the same bytes.

use std::fs;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use trace::write_atomically;

mod axes;
mod canvas;
mod compare;
mod figures;
mod outline;
mod page;
mod run_data;
mod style;
mod surface;
#[cfg(test)]
mod tests;

use canvas::Picture;
pub(crate) use figures::FIGURES;
use figures::Figure;
use run_data::RunData;

/// What [`report`] wrote.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ReportPaths {
    /// The page.
    pub page: PathBuf,
    /// The figures, SVG and PNG of each in turn.
    pub figures: Vec<PathBuf>,
}

/// A figure and, where the run has something to show in it, its picture.
type Drawn = (&'static Figure, Option<Picture>);

/// Reads the run in a folder and writes `index.html` and `figures/<name>.svg` and `.png` there.
///
/// # Errors
/// When a file of the run is missing or damaged, holds no scores, or a file cannot be written; the error names the file
/// and, for a damaged one, line and column.
pub fn report(run_dir: &Path) -> Result<ReportPaths> {
    let data = RunData::read(run_dir)?;
    let folder = run_dir.join("figures");
    fs::create_dir_all(&folder).with_context(|| format!("{}: cannot be created", folder.display()))?;
    let mut drawn: Vec<Drawn> = Vec::new();
    let mut paths = Vec::new();
    for figure in FIGURES {
        let picture = (figure.draw)(&data).with_context(|| format!("figure `{}`", figure.name))?;
        let [svg, png] = ["svg", "png"].map(|kind| folder.join(format!("{}.{kind}", figure.name)));
        if let Some(picture) = &picture {
            write_atomically(&svg, picture.to_standalone_svg(figure.title)?.as_bytes())?;
            picture.write_png(&png)?;
            paths.extend([svg, png]);
        } else {
            // A picture of an earlier run must not stand beside a page that leaves it out.
            remove(&svg)?;
            remove(&png)?;
        }
        drawn.push((figure, picture));
    }
    let page = run_dir.join("index.html");
    write_atomically(&page, page::html(&data, &drawn)?.as_bytes())?;
    Ok(ReportPaths { page, figures: paths })
}

/// Removes a file, if it is there.
fn remove(path: &Path) -> Result<()> {
    match fs::remove_file(path) {
        Err(error) if error.kind() != ErrorKind::NotFound => {
            Err(error).with_context(|| format!("{}: cannot be removed", path.display()))
        }
        _ => Ok(()),
    }
}
