//! Request and response of the service `increments_beam_test`.

use ros2_client::Message;
use serde::{Deserialize, Serialize};

/// `whisker_interfaces/srv/IncrementsBeamTest`, in the published units: millimetres.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Request {
    /// Depth of a push \[mm\].
    pub(crate) total_x_distance: f32,
    /// Length along the whisker over which the places are spread \[mm\].
    pub(crate) total_y_distance: f32,
    /// Number of stops on the way of a push.
    pub(crate) increments_x: u32,
    /// Number of steps between the first place and the last.
    pub(crate) increments_y: u32,
    /// Rest at each stop \[s\].
    pub(crate) pause_sec: u32,
}

/// The answer: the routine is over. It has no field for a failure.
#[derive(Clone, Copy, Debug, Default, Serialize, Deserialize)]
pub(crate) struct Response {
    /// Placeholder that ROS 2 gives a structure without fields.
    structure_needs_at_least_one_member: u8,
}

#[cfg(feature = "foxglove")]
impl Request {
    /// Name of the service's type.
    pub(crate) const SERVICE: &str = "whisker_interfaces/srv/IncrementsBeamTest";
    /// Name of its type.
    pub(crate) const TYPE: &str = "whisker_interfaces/srv/IncrementsBeamTest_Request";
    /// Its fields.
    pub(crate) const DEFINITION: &str = "float32 total_x_distance\nfloat32 total_y_distance\nuint32 increments_x\nuint32 increments_y\nuint32 pause_sec\n";
}

#[cfg(feature = "foxglove")]
impl Response {
    /// Name of its type.
    pub(crate) const TYPE: &str = "whisker_interfaces/srv/IncrementsBeamTest_Response";
    /// Its fields.
    pub(crate) const DEFINITION: &str = "uint8 structure_needs_at_least_one_member\n";
}

impl Message for Request {}
impl Message for Response {}
