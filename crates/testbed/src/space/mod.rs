//! Fit and evaluation of traces in space.

pub mod bound;
mod estimates;
#[cfg(feature = "evaluation")]
pub mod evaluate;
pub mod files;
#[cfg(feature = "evaluation")]
pub mod fit;
#[cfg(feature = "evaluation")]
mod glb;
#[cfg(feature = "evaluation")]
pub mod map;
#[cfg(feature = "evaluation")]
pub mod mount;
pub mod object;
#[cfg(feature = "evaluation")]
mod participant;
#[cfg(feature = "evaluation")]
mod ply;
mod readings;
pub mod replay;
pub mod rows;
#[cfg(feature = "evaluation")]
mod run;
pub mod solid;
#[cfg(feature = "evaluation")]
pub mod surface;
pub mod trial;
#[cfg(feature = "evaluation")]
pub mod view;
#[cfg(feature = "evaluation")]
mod wire;

pub use estimates::{SpatialEstimateRow, spatial_estimate_row};
pub(crate) use readings::bending_noise;
pub use readings::{largest_reading_n_m, noisy_readings_n_m, readings_n_m, to_base, to_world, turned_to};
pub use rows::SpatialMapRow;
#[cfg(feature = "evaluation")]
pub use run::{SpatialRun, SpatialRunTrial, SpatialRunWhisker, SpatialWritten, evaluate_into};
#[cfg(feature = "evaluation")]
pub use wire::SpatialWire;
