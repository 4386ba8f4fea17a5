//! Fit and evaluation of traces in space.

pub mod bound;
mod estimates;
pub mod evaluate;
pub mod fit;
mod glb;
pub mod map;
mod participant;
mod readings;
pub mod replay;
pub mod rod;
mod run;
pub mod solid;
mod wire;

pub use estimates::{SpatialEstimateRow, spatial_estimate_row};
pub use readings::{largest_reading_n_m, noisy_readings_n_m, readings_n_m, to_base};
pub use run::{SpatialMapRow, SpatialRun, SpatialRunTrial, SpatialRunWhisker, SpatialWritten, evaluate_into};
pub use wire::SpatialWire;
