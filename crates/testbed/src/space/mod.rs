//! Fit and evaluation of traces in space.

pub mod bound;
pub mod evaluate;
pub mod fit;
mod readings;
pub mod replay;
pub mod rod;
mod run;

pub use readings::{largest_reading_n_m, noisy_readings_n_m, readings_n_m, to_base};
pub use run::{SpatialWritten, evaluate_into};
