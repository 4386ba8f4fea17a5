//! Live contact estimation on ROS 2 messages, without a network: the messages of sensors and arms in, contacts, drawings,
//! maps and diagnostics out.
//!
//! ```text
//! messages -> Router -> Whisker: counts -> readings, transforms or joint angles -> pose -> live::LiveEstimator
//!                          -> contacts (PoseWithCovarianceStamped), shapes (Drawing), states (DiagnosticStatus)
//!                          -> observations -> Mapper -> map (OccupancyGrid or PointCloud2) and objects
//! ```
//!
//! | item | contents |
//! | --- | --- |
//! | [`Mapping`] | the file that names topics, frames and calibrations |
//! | [`Setup`] | whiskers of a mapping, and the [`Router`] of messages to them |
//! | [`Whisker`] | estimator of one whisker on its messages, in the plane or in space |
//! | [`Plane`] | plane of planar estimators, on which the poses of a base are projected |
//! | [`Drawing`], [`Mapper`] | shapes and maps |
//!
//! The crate opens no socket and starts no thread: each message is passed with the time of its arrival. `ros2-node contact`
//! connects it to ROS 2 and to Foxglove. `docs/LIVE.md` specifies topics and files.
//!

mod arm;
mod chain;
mod drawing;
mod epoch;
mod frames;
mod map;
mod mapping;
mod planar;
mod router;
mod setup;
mod spatial;
mod whisker;

pub use chain::{Measured, Plane};
pub use drawing::{COVERAGE, Drawing, Form, Shape};
pub use epoch::Epoch;
pub use map::{Map, Mapper, Observed};
pub use mapping::{Axis, CountsEntry, CountsMessage, Mapping, PlaneEntry, WhiskerEntry};
pub use router::{Routed, Router, Topic};
pub use setup::Setup;
pub use whisker::{Contact, Input, Latency, Taken, Whisker};
