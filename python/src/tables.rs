//! Checks of the folder and of the tables of a run.

use std::path::PathBuf;

use anyhow::Context;
use pyo3::exceptions::PyFileNotFoundError;
use pyo3::prelude::*;
use testbed::results::files::run_file;
use testbed::results::{RUN_FILES, ResultsKind};
use testbed::space::files::SPATIAL_RUN_FILES;

use crate::error::{raised, refused};

/// Name of the record of the run in a folder: `run.json`, in space `space_run.json`. Other folders are refused: `ValueError` names
/// other results, `FileNotFoundError` says that there are none.
#[pyfunction]
pub(crate) fn check_run(folder: PathBuf) -> PyResult<&'static str> {
    let [planar, in_space] = [ResultsKind::Run, ResultsKind::SpatialRun].map(ResultsKind::file);
    let expected = format!("{planar} or {in_space}, as `whisker evaluate` writes them");
    let at = folder.display().to_string();
    match ResultsKind::of(&folder) {
        Some(kind @ (ResultsKind::Run | ResultsKind::SpatialRun)) => Ok(kind.file()),
        Some(other) => Err(refused(&at, format!("{} ({})", other.about(), other.file()), &expected)),
        None => Err(PyFileNotFoundError::new_err(format!("{at}: found no run, expected {expected}"))),
    }
}

/// Checks a table of a run and returns the number of its rows. `ValueError` names file, line and column of a fault.
#[pyfunction]
pub(crate) fn check_table(py: Python<'_>, path: PathBuf) -> PyResult<usize> {
    let count = || {
        let file = run_file(SPATIAL_RUN_FILES, &path).or_else(|| run_file(RUN_FILES, &path));
        let file = file.and_then(|file| file.rows.as_ref());
        let rows = file.with_context(|| format!("{}: found no table of a run, expected one", path.display()))?;
        rows.counted(&path)
    };
    py.detach(count).map_err(raised)
}
