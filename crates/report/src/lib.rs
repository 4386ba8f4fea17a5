//! Figures (SVG and PNG) and a self-contained HTML page of the results of an evaluation.
//!
//! Reads the folder of a run, whose files [`testbed::results`] defines (`run.json`, `summary.csv`, `trials.csv` and the others),
//! the folder of a run in space (`space_run.json` and its tables), or the folder of the physics study, which `python -m
//! whisker_sim.physics` writes (`watermark.json`, `claims.csv` and its tables). Writes into the same folder:
//!
//! | file | content |
//! | --- | --- |
//! | `index.html` | tables, figures, interactive replay and provenance; loads no other file |
//! | `figures/<name>.svg`, `.png` | one figure, with a few methods if the run has many |
//! | `figures/all/<name>_<number>.svg`, `.png` | the same with all methods, in groups |
//!
//! No other files are read. A report can therefore be drawn again at any time, and the same results give the same
//! bytes. PNG files are rasterised from the SVG with two image pixels per CSS pixel and the embedded typeface.
//!
//! # Example
//! The report of an evaluation of the filter `ekf` on one sweep, made as on the front page of the crate `testbed`:
//!
//! ```
//! # use std::path::Path;
//! #
//! # use files::sha256;
//! use indicatif::ProgressBar;
//! # use testbed::dataset::Dataset;
//! # use evaluation::evaluate::{EvaluateSettings, evaluate};
//! # use evaluation::fit::{FitSettings, Models, fit};
//! # use trace::{Role, Trace};
//!
//! # fn main() -> anyhow::Result<()> {
//! # let golden = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../datasets/golden");
//! # let folder = tempfile::tempdir()?;
//! # for (of, name, role) in [
//! #     ("golden_pin", "pin", Role::Trial),
//! #     ("golden_pin", "grid_0", Role::Calibration),
//! #     ("golden_circle", "grid_1", Role::Calibration),
//! # ] {
//! #     let mut trace = Trace::read(&golden.join(of).with_extension("csv"))?;
//! #     (trace.sidecar.name, trace.sidecar.role, trace.sidecar.contour) = (name.into(), role, None);
//! #     trace.sidecar.csv_sha256 = sha256(trace.to_csv());
//! #     trace.write(folder.path())?;
//! # }
//! # let dataset = Dataset::open(folder.path(), None)?;
//! # let models = Models::One { kind: "elastica".into(), config: serde_json::json!({}) };
//! # let fit_settings = FitSettings { models, noise: 0.01, seed: 1, front_end: Default::default(), sensors: Vec::new() };
//! # fit(&dataset, &fit_settings, &dataset.calibrations("white"), &ProgressBar::hidden())?;
//! # let settings = EvaluateSettings {
//! #     name: "golden".into(),
//! #     estimators: Some(vec!["ekf".into()]),
//! #     noise: vec![0.01],
//! #     seeds: vec![1],
//! #     results: folder.path().join("results"),
//! #     ..Default::default()
//! # };
//! // Data: the folder of a run.
//! let run = evaluate(&[dataset], &settings, &ProgressBar::hidden())?.folder;
//!
//! // Answer: a page and its figures beside the results.
//! let written = report::report(&run, &ProgressBar::hidden())?;
//! assert_eq!(written.page, run.join("index.html"));
//! assert!(written.figures.iter().any(|path| path.ends_with("figures/error_over_time.svg")));
//! # Ok(())
//! # }
//! ```
//!
//! The figures of a run, each with its title; a figure whose data the run lacks is left out:
//!
//! ```
//! let titles: Vec<_> = report::figures().filter(|(name, _)| *name == "consistency").collect();
//! assert_eq!(titles, [("consistency", "Consistency (NEES, NIS)")]);
//! ```

use std::path::{Path, PathBuf};

use anyhow::Result;
use files::write_atomically;
use indicatif::ProgressBar;

mod all_metrics;
mod animations;
mod axes;
mod canvas;
mod color;
mod compare;
mod consistency;
mod contour_panel;
mod contours;
mod figure;
mod figures;
mod font;
mod methods;
mod page;
mod physics;
mod replay;
mod run_data;
mod space;
mod style;
#[cfg(test)]
mod tests;

use figure::draw_all;
use figures::FIGURES;
use run_data::RunData;

/// Files that [`report`] wrote.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ReportPaths {
    /// The page.
    pub page: PathBuf,
    /// The figures: SVG and PNG of each picture in turn.
    pub figures: Vec<PathBuf>,
}

/// Copies the animations of a run's sets from the folder `from` into that of the run, from which the page links them.
///
/// # Errors
/// When a folder is missing, or a file cannot be copied; the error names it.
pub fn take_animations(run: &Path, from: &Path) -> Result<()> {
    animations::take(run, from)
}

/// Reads the results in a folder and writes its figures and `index.html` there. The unit of progress is one figure.
///
/// # Errors
/// When a file of the results is missing or damaged or holds no scores, or a file cannot be written. The error names the file
/// and, for a damaged one, line and column.
pub fn report(folder: &Path, progress: &ProgressBar) -> Result<ReportPaths> {
    let (html, figures) = if physics::is_study(folder) {
        let data = physics::Data::read(folder)?;
        let figures = draw_all(folder, physics::FIGURES, &data, progress)?;
        (physics::html(&data, &figures)?, figures.files)
    } else if let Some(data) = space::Data::read(folder)? {
        let figures = draw_all(folder, space::FIGURES, &data, progress)?;
        (space::html(&data, &figures)?, figures.files)
    } else {
        let data = RunData::read(folder)?;
        let figures = draw_all(folder, FIGURES, &data, progress)?;
        let animations = animations::read(folder, &data.run.sets)?;
        (page::html(&data, &animations, &figures)?, figures.files)
    };
    let page = folder.join("index.html");
    write_atomically(&page, html.as_bytes())?;
    Ok(ReportPaths { page, figures })
}

/// Name and title of every figure of an evaluated run, in the order of the page.
pub fn figures() -> impl Iterator<Item = (&'static str, &'static str)> {
    FIGURES.iter().map(|figure| (figure.name, figure.title))
}

/// Name and title of every figure of a run in space, in the order of the page.
pub fn space_figures() -> impl Iterator<Item = (&'static str, &'static str)> {
    space::FIGURES.iter().map(|figure| (figure.name, figure.title))
}

/// Name and title of every figure of the physics study, in the order of the page.
pub fn physics_figures() -> impl Iterator<Item = (&'static str, &'static str)> {
    physics::FIGURES.iter().map(|figure| (figure.name, figure.title))
}
