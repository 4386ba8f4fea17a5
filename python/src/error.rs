//! Rust errors as Python exceptions with the same message.

use std::io;

use pyo3::exceptions::PyValueError;
use pyo3::{PyErr, Python};

/// Exception of an error: that of its kind (`FileNotFoundError`, `PermissionError`, ...) for an error of the operating
/// system, an exception that Python code raised unchanged, `ValueError` for all others.
pub(crate) fn raised(error: impl Into<anyhow::Error>) -> PyErr {
    let error = match error.into().downcast::<PyErr>() {
        Ok(exception) => return exception,
        Err(error) => error,
    };
    let words = format!("{error:#}");
    let kind = error.chain().find_map(|cause| match cause.downcast_ref::<files::Error>() {
        Some(files::Error::Io { reason, .. }) => Some(reason.kind()),
        _ => cause.downcast_ref::<io::Error>().map(io::Error::kind),
    });
    match kind {
        Some(kind) => io::Error::new(kind, words).into(),
        None => PyValueError::new_err(words),
    }
}

/// An exception with the name of the argument that it belongs to.
pub(crate) fn of_argument(py: Python<'_>, what: &str, error: PyErr) -> PyErr {
    PyErr::from_type(error.get_type(py), format!("{what}: {}", error.value(py)))
}

/// `ValueError` that names the quantity, the value found and the value expected.
pub(crate) fn refused(what: &str, found: impl std::fmt::Display, expected: &str) -> PyErr {
    PyValueError::new_err(format!("{what}: found {found}, expected {expected}"))
}
