//! Fit and evaluation of traces in space.

#[cfg(feature = "evaluation")]
pub mod bound;
#[cfg(feature = "evaluation")]
mod estimates;
#[cfg(feature = "evaluation")]
pub mod evaluate;
#[cfg(feature = "evaluation")]
pub mod files;
#[cfg(feature = "evaluation")]
pub mod fit;
#[cfg(feature = "evaluation")]
mod glb;
#[cfg(feature = "evaluation")]
pub mod map;
#[cfg(feature = "evaluation")]
pub mod object;
#[cfg(feature = "evaluation")]
mod participant;
mod readings;
pub mod replay;
#[cfg(feature = "evaluation")]
mod run;
#[cfg(feature = "evaluation")]
pub mod solid;
#[cfg(feature = "evaluation")]
mod wire;

#[cfg(feature = "evaluation")]
pub use estimates::{SpatialEstimateRow, spatial_estimate_row};
pub use readings::{largest_reading_n_m, noisy_readings_n_m, readings_n_m, to_base, to_world};
#[cfg(feature = "evaluation")]
pub use run::{SpatialMapRow, SpatialRun, SpatialRunTrial, SpatialRunWhisker, SpatialWritten, evaluate_into};
#[cfg(feature = "evaluation")]
pub use wire::SpatialWire;
