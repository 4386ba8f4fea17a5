//! The ROS 2 node and its publishers.

use std::any::Any;
use std::collections::HashMap;
use std::thread;
use std::time::Duration;

use bag::{Error, Message, Publisher, topics};
use futures::executor::block_on;
use ros2_client::qos::{Durability, History, QosProfile, WhenFull};
use ros2_client::{Context, ContextOptions, MessageTypeName, Name, NodeName, NodeOptions};

use crate::outlet::Outlet;

/// Messages that are kept for a slow subscriber: more than a second of readings.
const DEPTH: usize = 1000;
/// Longest time that a message waits for a slow subscriber.
const PATIENCE: Duration = Duration::from_millis(100);

/// Network of the node.
#[derive(clap::Args)]
pub(crate) struct Network {
    /// ROS 2 domain of the node
    #[arg(long, env = "ROS_DOMAIN_ID", default_value_t = 0, value_parser = clap::value_parser!(u16).range(..=232))]
    domain: u16,
}

/// A node and its publishers, one for each topic.
pub(crate) struct Node {
    node: ros2_client::Node,
    publishers: HashMap<String, Box<dyn Any + Send>>,
}

impl Node {
    pub(crate) fn new(network: &Network) -> anyhow::Result<Self> {
        let options = ContextOptions::new().domain_id(network.domain);
        let context = Context::with_options(options)?;
        let mut node = context.new_node(NodeName::new("/", "whisker")?, NodeOptions::new())?;
        let spinner = node.spinner()?;
        thread::spawn(move || block_on(spinner.spin()));
        Ok(Self { node, publishers: HashMap::new() })
    }

    /// The node of `ros2-client`.
    pub(crate) fn ros(&mut self) -> &mut ros2_client::Node {
        &mut self.node
    }
}

impl Outlet for Node {
    fn announce<M: Message>(&mut self, topic: &str) -> Result<(), Error> {
        let failed = |reason: String| Error::Live { topic: topic.into(), reason };
        let (package, kind) = M::TYPE.split_once("/msg/").expect("types are named package/msg/Type");
        let name = Name::parse(topic).map_err(|error| failed(format!("{error:?}")))?;
        let topic_of = self.node.create_topic(&name, MessageTypeName::new(package, kind), &quality(topic));
        let publisher = topic_of
            .and_then(|of| self.node.create_publisher::<M>(&of, None))
            .map_err(|error| failed(error.to_string()))?;
        self.publishers.insert(topic.into(), Box::new(publisher));
        Ok(())
    }

    fn is_heard(&self, topic: &str) -> bool {
        self.node.subscription_count(topic) > 0
    }
}

impl Publisher for Node {
    fn write<M: Message>(&mut self, topic: &str, _time_ns: u64, message: &M) -> Result<(), Error> {
        if !self.publishers.contains_key(topic) {
            self.announce::<M>(topic)?;
        }
        let failed = |reason: String| Error::Live { topic: topic.into(), reason };
        self.publishers[topic]
            .downcast_ref::<ros2_client::Publisher<M>>()
            .ok_or_else(|| failed(format!("found a {}, expected the type that the topic had before", M::TYPE)))?
            .publish(message.clone())
            .map_err(|error| failed(format!("{error:?}")))
    }
}

/// Quality of service of a topic: reliable; static frames are kept for later subscribers.
fn quality(topic: &str) -> QosProfile {
    let quality = QosProfile::publisher_default().reliability_reliable(WhenFull::Wait(PATIENCE));
    if topic == topics::TF_STATIC {
        quality.durability(Durability::TransientLocal).history(History::KeepLast { depth: 1 })
    } else {
        quality.durability(Durability::Volatile).history(History::KeepLast { depth: DEPTH })
    }
}
