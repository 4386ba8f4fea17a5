//! The service `increments_beam_test`.

use std::time::Duration;

use bag::topics;
use ros2_client::qos::{Durability, History, QosProfile, WhenFull};
use ros2_client::{Message, Name, ServiceMapping, ServiceTypeName};
use serde::{Deserialize, Serialize};

use crate::node::Node;
use crate::outlet::{Desk, Routine};

/// How long a request may lie before it is seen.
const POLL: Duration = Duration::from_millis(20);

/// `whisker_interfaces/srv/IncrementsBeamTest`, in the published units: millimetres.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Request {
    /// How far to push the whisker \[mm\].
    pub(crate) total_x_distance: f32,
    /// How far the places reach along the whisker \[mm\].
    pub(crate) total_y_distance: f32,
    /// Stops on the way of a push.
    pub(crate) increments_x: u32,
    /// Steps between the first place and the last.
    pub(crate) increments_y: u32,
    /// How long to rest at each stop \[s\].
    pub(crate) pause_sec: u32,
}

/// The answer, which says nothing but that the routine is over.
#[derive(Clone, Copy, Debug, Default, Serialize, Deserialize)]
pub(crate) struct Response {
    /// ROS 2 gives what has no fields this one.
    structure_needs_at_least_one_member: u8,
}

#[cfg(feature = "foxglove")]
impl Request {
    /// Name of the service's type.
    pub(crate) const SERVICE: &str = "whisker_interfaces/srv/IncrementsBeamTest";
    /// Name of the request's own.
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

/// How requests are told apart on the wire, which depends on the middleware of who asks.
#[derive(Clone, Copy, Debug, clap::ValueEnum)]
pub(crate) enum Middleware {
    /// rmw_fastrtps_cpp, ROS 2's default
    Fastrtps,
    /// rmw_cyclonedds_cpp
    Cyclonedds,
}

/// The service on a node.
pub(crate) struct Service {
    server: ros2_client::Server<Request, Response>,
}

impl Service {
    pub(crate) fn new(node: &mut Node, middleware: Middleware) -> anyhow::Result<Self> {
        let mapping = match middleware {
            Middleware::Fastrtps => ServiceMapping::Enhanced,
            Middleware::Cyclonedds => ServiceMapping::Cyclone,
        };
        let quality = QosProfile::publisher_default()
            .reliability_reliable(WhenFull::DEFAULT)
            .durability(Durability::Volatile)
            .history(History::KeepLast { depth: 10 });
        let server = node.ros().create_server(
            mapping,
            &Name::parse(topics::BEAM_TEST)?,
            &ServiceTypeName::new("whisker_interfaces", "IncrementsBeamTest"),
            quality.clone(),
            quality,
        )?;
        Ok(Self { server })
    }
}

impl Desk for Service {
    /// A routine that fails is answered too, since the answer has no word for it; what was wrong goes to stderr.
    fn serve_next(&self, routine: &mut Routine<'_>) -> anyhow::Result<()> {
        match self.server.receive_request() {
            Ok(Some((id, request))) => {
                if let Err(error) = routine(request) {
                    eprintln!("error: {}: {error:#}", topics::BEAM_TEST);
                }
                self.server.send_response(id, Response::default())?;
            }
            Ok(None) => std::thread::sleep(POLL),
            Err(error) => eprintln!("error: {}: {error}", topics::BEAM_TEST),
        }
        Ok(())
    }
}
