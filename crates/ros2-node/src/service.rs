//! The services of the platform on a ROS 2 node: `increments_beam_test` and `stop`.

use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::sleep;
use std::time::Duration;

use bag::topics;
use ros2_client::qos::{Durability, History, QosProfile, WhenFull};
use ros2_client::{Name, ServiceMapping, ServiceTypeName};

use crate::node::Node;
use crate::outlet::{Desk, Routine};
use crate::request::{Request, Response, Trigger, Triggered};

/// Polling interval of requests.
const POLL: Duration = Duration::from_millis(20);

/// Middleware of the caller, which determines how requests are identified on the wire.
#[derive(Clone, Copy, Debug, clap::ValueEnum)]
pub(crate) enum Middleware {
    /// rmw_fastrtps_cpp, ROS 2's default
    Fastrtps,
    /// rmw_cyclonedds_cpp
    Cyclonedds,
}

/// Quality of service of a service. At most as many calls wait as it keeps.
fn quality() -> QosProfile {
    QosProfile::publisher_default()
        .reliability_reliable(WhenFull::DEFAULT)
        .durability(Durability::Volatile)
        .history(History::KeepLast { depth: 10 })
}

/// The service that stops the printer.
pub(crate) struct Stops {
    server: ros2_client::Server<Trigger, Triggered>,
}

impl Stops {
    pub(crate) fn new(node: &mut Node, middleware: Middleware) -> anyhow::Result<Self> {
        let (name, type_name) = (Name::parse(topics::STOP)?, ServiceTypeName::new("std_srvs", "Trigger"));
        let server = node.ros().create_server(middleware.mapping(), &name, &type_name, quality(), quality())?;
        Ok(Self { server })
    }

    /// Sets `stop` when it is called. Returns once `stop` is set.
    pub(crate) fn serve(&self, stop: &AtomicBool) {
        while !stop.load(Ordering::Relaxed) {
            match self.server.receive_request() {
                Ok(Some((id, _))) => {
                    stop.store(true, Ordering::Relaxed);
                    if let Err(error) = self.server.send_response(id, Triggered::stopped()) {
                        eprintln!("error: {}: {error}", topics::STOP);
                    }
                }
                Ok(None) => sleep(POLL),
                Err(error) => {
                    eprintln!("error: {}: {error}", topics::STOP);
                    sleep(POLL);
                }
            }
        }
    }
}

impl Middleware {
    fn mapping(self) -> ServiceMapping {
        match self {
            Self::Fastrtps => ServiceMapping::Enhanced,
            Self::Cyclonedds => ServiceMapping::Cyclone,
        }
    }
}

/// The service on a node.
pub(crate) struct Service {
    server: ros2_client::Server<Request, Response>,
}

impl Service {
    pub(crate) fn new(node: &mut Node, middleware: Middleware) -> anyhow::Result<Self> {
        let quality = quality();
        let server = node.ros().create_server(
            middleware.mapping(),
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
            Ok(None) => sleep(POLL),
            Err(error) => eprintln!("error: {}: {error}", topics::BEAM_TEST),
        }
        Ok(())
    }
}
