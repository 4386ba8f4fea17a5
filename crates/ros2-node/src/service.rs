//! The service `increments_beam_test` on a ROS 2 node.

use std::time::Duration;

use bag::topics;
use ros2_client::qos::{Durability, History, QosProfile, WhenFull};
use ros2_client::{Name, ServiceMapping, ServiceTypeName};

use crate::node::Node;
use crate::outlet::{Desk, Routine};
use crate::request::{Request, Response};

/// Interval between two looks for a request.
const POLL: Duration = Duration::from_millis(20);

/// Middleware of the caller, which determines how requests are identified on the wire.
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
    /// A failed routine is answered too, as the response has no field for a failure; the error goes to stderr.
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
