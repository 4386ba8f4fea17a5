//! The golden traces that the tests of both languages read.

use crate::failure::Outcome;
use crate::pipeline;
use crate::python::{self, Requirements};

pub(crate) fn run() -> Outcome {
    python::install(Requirements::Runtime)?;
    pipeline::simulate("golden")
}
