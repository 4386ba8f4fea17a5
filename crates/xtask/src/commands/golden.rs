//! The golden traces that the tests of both languages read.

use crate::failure::Outcome;
use crate::pipeline;
use crate::python::{self, Progress, Requirements};

pub(crate) fn run() -> Outcome {
    python::install(Requirements::Runtime, Progress::Counter)?;
    pipeline::simulate("golden")
}
