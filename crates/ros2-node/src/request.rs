//! Requests and responses of the services.

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

/// Request of `std_srvs/srv/Trigger`, by which the printer is stopped.
#[derive(Clone, Copy, Debug, Default, Serialize, Deserialize)]
pub(crate) struct Trigger {
    structure_needs_at_least_one_member: u8,
}

/// Response of `std_srvs/srv/Trigger`.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(crate) struct Triggered {
    /// Whether the request was fulfilled.
    success: bool,
    /// Text for the user.
    message: String,
}

impl Triggered {
    /// The printer is being stopped.
    pub(crate) fn stopped() -> Self {
        let message = "the printer is stopped at once, and the program ends; reset the printer before it moves again";
        Self { success: true, message: message.into() }
    }
}

/// Request of the routine by Foxglove: [`Request`] and the token.
#[cfg(feature = "foxglove")]
#[derive(Clone, Debug, Deserialize)]
pub(crate) struct Authorised {
    /// The request.
    pub(crate) request: Request,
    /// The token that the program printed.
    pub(crate) token: String,
}

/// Names of types, and their fields as Foxglove shows them.
#[cfg(feature = "foxglove")]
pub(crate) mod schema {
    pub(crate) const BEAM_TEST: &str = "whisker_interfaces/srv/IncrementsBeamTest";
    pub(crate) const BEAM_TEST_REQUEST: (&str, &str) = (
        "whisker_interfaces/srv/IncrementsBeamTest_Request",
        "float32 total_x_distance\nfloat32 total_y_distance\nuint32 increments_x\nuint32 increments_y\nuint32 pause_sec\nstring token\n",
    );
    pub(crate) const BEAM_TEST_RESPONSE: (&str, &str) =
        ("whisker_interfaces/srv/IncrementsBeamTest_Response", "uint8 structure_needs_at_least_one_member\n");
    pub(crate) const TRIGGER: &str = "std_srvs/srv/Trigger";
    pub(crate) const TRIGGER_REQUEST: (&str, &str) =
        ("std_srvs/srv/Trigger_Request", "uint8 structure_needs_at_least_one_member\n");
    pub(crate) const TRIGGER_RESPONSE: (&str, &str) =
        ("std_srvs/srv/Trigger_Response", "bool success\nstring message\n");
}

impl Message for Request {}
impl Message for Response {}
impl Message for Trigger {}
impl Message for Triggered {}
