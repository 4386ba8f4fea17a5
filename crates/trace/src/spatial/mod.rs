//! Traces in space, format 2: base with six degrees of freedom, readings and ground truth as vectors.
//!
//! A [`SpatialTrace`] is read and written whole. Planar traces (format 1) have the type [`crate::Trace`]; each of the two
//! readers names the other kind if it is given one.

mod calibration;
mod certificate;
mod characteristic;
mod columns;
mod front_end;
mod lifted;
mod recorded;
mod sidecar;
mod table;

pub(crate) use sidecar::other_format;

pub use calibration::{LearntMounting, SpatialCalibrationFile, SpatialModelFile};
pub use certificate::SpatialCertificate;
pub use characteristic::SpatialCharacteristic;
pub use columns::SPATIAL_COLUMNS;
pub use front_end::{SpatialFrontEndFile, SpatialSensor};
pub use recorded::{BendingResponse, BendingSensor, SpatialRecorded};
pub use sidecar::{SPATIAL_FORMAT, SpatialSidecar, StatedSuspension, is_spatial};
pub use table::{
    Feature, SpatialContactTruth, SpatialInstant, SpatialPose, SpatialRecording, SpatialTrace, SpatialTruth,
    SpatialTruthInstant, SpatialTwist,
};
