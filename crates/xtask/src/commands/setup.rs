//! The Python packages that simulate, in `.venv`.

use crate::failure::Outcome;
use crate::python::{self, Progress, Requirements};

pub(crate) fn run() -> Outcome {
    python::install(Requirements::Runtime, Progress::Counter)
}
