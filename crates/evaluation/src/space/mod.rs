//! Fits and evaluations of traces in space.

pub mod evaluate;
pub mod fit;
pub mod mount;
mod participant;
mod run;

pub use run::{SpatialWritten, evaluate_into};
