//! Fits, evaluations, maps and surfaces of traces in space.

pub mod evaluate;
pub mod fit;
mod glb;
pub mod map;
pub mod mount;
mod participant;
mod ply;
mod run;
pub mod surface;
pub mod view;
mod wire;

pub use run::{SpatialRun, SpatialRunTrial, SpatialRunWhisker, SpatialWritten, evaluate_into};
pub use wire::SpatialWire;
