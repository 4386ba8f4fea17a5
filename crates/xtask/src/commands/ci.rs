//! Checks and tests, required for every change.

use super::{check, test};
use crate::failure::Outcome;
use crate::parts;

pub(crate) fn run() -> Outcome {
    parts::run_all(&[check::PARTS, test::PARTS].concat())
}
