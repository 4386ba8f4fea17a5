//! Check of the tables of a run.

use std::path::PathBuf;

use anyhow::Context;
use pyo3::prelude::*;
use testbed::results::RUN_FILES;
use testbed::results::files::run_file;

use crate::error::raised;

/// Checks a table of a run and returns the number of its rows. `ValueError` names file, line and column of a fault.
#[pyfunction]
pub(crate) fn check_table(py: Python<'_>, path: PathBuf) -> PyResult<usize> {
    let count = || {
        let file = run_file(RUN_FILES, &path).and_then(|file| file.rows.as_ref());
        let rows = file.with_context(|| format!("{}: found no table of a run, expected one", path.display()))?;
        rows.counted(&path)
    };
    py.detach(count).map_err(raised)
}
