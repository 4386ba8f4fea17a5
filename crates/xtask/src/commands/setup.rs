//! The Python packages that simulate, in `.venv`.

use crate::failure::Outcome;
use crate::python::{self, Requirements};

pub(crate) fn run() -> Outcome {
    python::install(Requirements::Runtime)
}
