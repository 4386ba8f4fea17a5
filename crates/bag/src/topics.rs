//! Names of topics and frames. Those of the calibration platform are the published ones of OpenWhisker.

/// Readings of the magnetometer: [`MagneticFieldArray`](crate::messages::MagneticFieldArray).
pub const MAGNETOMETER: &str = "/magnetometer_reading";
/// Estimated contact: [`PoseStamped`](crate::messages::PoseStamped) in [`WHISKER`].
pub const DETECTED_CONTACT: &str = "/detected_contact";
/// Moving frames: [`TfMessage`](crate::messages::TfMessage).
pub const TF: &str = "/tf";
/// Static frames: [`TfMessage`](crate::messages::TfMessage).
pub const TF_STATIC: &str = "/tf_static";
/// Bending moment at the root: [`WrenchStamped`](crate::messages::WrenchStamped) in [`WHISKER`].
pub const MOMENT: &str = "/moment";
/// Angles of the base and of the whisker's root: [`JointState`](crate::messages::JointState).
pub const JOINT_STATES: &str = "/joint_states";
/// Twist of the base: [`TwistStamped`](crate::messages::TwistStamped) in [`WHISKER`].
pub const BASE_TWIST: &str = "/base_twist";

/// Service that pushes the whisker at places along it.
pub const BEAM_TEST: &str = "/increments_beam_test";

/// Service that stops the printer at once.
pub const STOP: &str = "/stop";

/// World frame.
pub const WORLD: &str = "world";
/// Frame at the root of the whisker.
pub const WHISKER: &str = "whisker_base_link";
/// Frame of the printer.
pub const PRINTER: &str = "printer_base_link";
/// Frame of the printer's head.
pub const PRINTER_HEAD: &str = "printer_head_link";

/// Estimated contact of a live whisker, after `<prefix>/<name>`:
/// [`PoseWithCovarianceStamped`](crate::messages::PoseWithCovarianceStamped).
pub const CONTACT: &str = "contact";
/// Whiskers, contacts and outlines as drawn objects, after the prefix: [`MarkerArray`](crate::messages::MarkerArray).
pub const MARKERS: &str = "markers";
/// Whiskers, contacts and outlines as a scene of Foxglove, after the prefix.
pub const SCENE: &str = "scene";
/// Map of the touched and of the free space in the plane, after the prefix:
/// [`OccupancyGrid`](crate::messages::OccupancyGrid).
pub const MAP: &str = "map";
/// Touched points in space, after the prefix: [`PointCloud2`](crate::messages::PointCloud2).
pub const MAP_POINTS: &str = "map_points";
/// Touched and free voxels in space, after the prefix: [`PointCloud2`](crate::messages::PointCloud2).
pub const MAP_VOXELS: &str = "map_voxels";
/// Whether the last message of a topic is kept for later subscribers: static frames and maps.
pub fn is_kept(topic: &str) -> bool {
    topic == TF_STATIC || topic.rsplit('/').next().is_some_and(|end| [MAP, MAP_POINTS, MAP_VOXELS].contains(&end))
}

/// States of live whiskers: [`DiagnosticArray`](crate::messages::DiagnosticArray).
pub const DIAGNOSTICS: &str = "/diagnostics";
