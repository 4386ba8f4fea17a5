//! The gate of every change: checks and tests.

use super::{check, test};
use crate::failure::Outcome;
use crate::parts;

pub(crate) fn run() -> Outcome {
    parts::run_all(&[check::PARTS, test::PARTS].concat())
}
