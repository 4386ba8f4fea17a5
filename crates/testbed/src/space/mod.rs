//! Replay, scores, maps and surfaces of traces in space, and the files of a run.

pub mod bound;
mod estimates;
pub mod files;
mod glb;
pub mod map;
pub mod object;
mod ply;
mod readings;
pub mod replay;
pub mod rows;
pub mod run;
pub mod solid;
pub mod surface;
pub mod trial;
pub mod view;
pub mod wire;

pub use estimates::{SpatialEstimateRow, spatial_estimate_row};
pub use readings::{largest_reading_n_m, readings_n_m, to_base, to_world, turned_to};
pub use rows::SpatialMapRow;
