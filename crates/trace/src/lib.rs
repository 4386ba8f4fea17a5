//! Traces of whisker experiments and the files around them: suites, outlines, array recordings and calibrations.
//!
//! A [`Trace`] consists of a [`Sidecar`] (description and provenance), a [`Recording`] (times, base poses and root
//! moments: the input of an estimator) and a [`Truth`] (the contact as simulated or measured, for scoring only). The
//! estimators belong to the crate `whisker`, on which this crate depends, so they cannot access the ground truth. A trace
//! is read and written whole, or row by row with [`TraceRows`] and [`TraceWriter`]. An [`ArrayRecording`] ties together
//! the traces of several whiskers on one [`Arm`]; a [`Suite`] lists the scenes of an evaluation; a [`CalibrationFile`]
//! stores fitted sensor models. A [`SpatialTrace`] is a trace in space, with readings and ground truth as vectors.
//! `datasets/FORMAT.md` specifies all files.
//!
//! # Example: delay of a contact detector
//!
//! A whisker is swept against a pin. A detector compares the moment at the root with a threshold of 2 % of its range. It
//! receives the recording alone; its delay is then computed from the ground truth:
//!
//! ```
//! use std::path::Path;
//!
//! use trace::{Recording, Trace};
//!
//! /// Time at which the root moment first exceeds a threshold.
//! fn detect_s(recording: &Recording, threshold_n_m: f64) -> Option<f64> {
//!     let exceeding = recording.instants.iter().find(|instant| instant.moment_z_n_m.abs() > threshold_n_m);
//!     exceeding.map(|instant| instant.t_s)
//! }
//!
//! let golden = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../datasets/golden");
//! let Trace { sidecar, recording, truth } = Trace::read(&golden.join("golden_pin.csv"))?;
//! assert_eq!((sidecar.rate_hz, recording.instants.len()), (250.0, 301));
//!
//! let largest_n_m = recording.instants.iter().map(|instant| instant.moment_z_n_m.abs()).fold(0.0, f64::max);
//! let detected_s = detect_s(&recording, 0.02 * largest_n_m).expect("the whisker is deflected");
//!
//! let onset = truth.instants.iter().position(|instant| instant.touching == Some(true)).expect("a contact");
//! let delay_s = detected_s - recording.instants[onset].t_s;
//! assert!((delay_s - 0.004).abs() < 1e-9, "one sample late, not {delay_s} s");
//! # Ok::<(), files::Error>(())
//! ```

mod arm;
mod array;
mod calibration;
mod certificate;
mod characteristic;
mod effects;
mod fitted;
mod object_class;
mod outline;
mod rows;
mod scene;
mod sidecar;
mod spatial;
mod suite;
mod table;
mod writer;

pub use arm::{Arm, JOINTS, JointInstant, Link, PoseMatrix, wrapped_rad};
pub use array::{ArrayRecording, ArraySidecar, MountedWhisker, PartFile, SceneObject};
pub use calibration::{
    CalibrationFile, CrossTalk, FaceFile, FittedData, FrontEndFile, MOST_NOISE, ModelFile, SensorFile,
};
pub use certificate::{Breach, Certificate};
pub use characteristic::{Characteristic, through_zero};
pub use effects::{Miscalibration, ReplayEffects};
pub use fitted::{FittedTraces, TraceData, data_sha256};
pub use object_class::ObjectClass;
pub use outline::Outline;
pub use rows::TraceRows;
pub use scene::{SceneDifference, scene_difference};
pub use sidecar::{Contour, Generator, RATES_HZ, Recorded, Role, Sidecar, is_plain_name};
pub use spatial::{
    BendingResponse, BendingSensor, Feature, LearntMounting, SPATIAL_COLUMNS, SPATIAL_FORMAT, SpatialCalibrationFile,
    SpatialCertificate, SpatialCharacteristic, SpatialContactTruth, SpatialFrontEndFile, SpatialInstant,
    SpatialModelFile, SpatialPose, SpatialRecorded, SpatialRecording, SpatialSensor, SpatialSidecar, SpatialTrace,
    SpatialTruth, SpatialTruthInstant, SpatialTwist, StatedSuspension, is_spatial,
};
pub use suite::{RandomDraws, Suite, SuiteRun, SuiteScene};
pub use table::{
    COLUMNS, FARTHEST_M, FRICTION_COLUMNS, FrictionTruth, FurtherColumns, Instant, LARGEST, Recording, SECOND_COLUMNS,
    SecondTruth, Trace, Truth, TruthInstant, YIELDING_COLUMNS, YieldingTruth, is_trace_table,
};
pub use writer::TraceWriter;
