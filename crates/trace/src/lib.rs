//! Traces, suites, calibration files and where they come from.
//!
//! `datasets/FORMAT.md` specifies the files. A [`Trace`] is read whole, or row by row ([`TraceRows`], [`TraceWriter`]), checked, and comes apart into what the robot knows, the
//! [`Recording`], and what only the simulator knows, the [`Truth`]. Estimators live upstream of this crate, so they cannot
//! name the second. An [`ArrayRecording`] ties the traces of several whiskers on one [`Arm`].

mod arm;
mod array;
mod calibration;
mod certificate;
mod characteristic;
mod object_class;
mod outline;
mod rows;
mod sidecar;
mod suite;
mod table;
mod writer;

pub use arm::{Arm, JOINTS, JointInstant, Link, PoseMatrix};
pub use array::{ArrayRecording, ArraySidecar, MountedWhisker, PartFile, SceneObject};
pub use calibration::{CalibrationFile, CrossTalk, FaceFile, FrontEndFile, MOST_NOISE, ModelFile, SensorFile};
pub use certificate::{Breach, Certificate};
pub use characteristic::{Characteristic, through_zero};
pub use object_class::ObjectClass;
pub use outline::Outline;
pub use rows::TraceRows;
pub use sidecar::{Contour, Generator, Recorded, Role, Sidecar, is_plain_name};
pub use suite::{Suite, SuiteScene};
pub use table::{COLUMNS, Instant, Recording, Trace, Truth, TruthInstant};
pub use writer::TraceWriter;
