//! The ROS 2 node and its publishers.

use std::any::Any;
use std::collections::HashMap;
use std::fmt;
use std::net::{IpAddr, Ipv4Addr};
use std::thread;
use std::time::{Duration, Instant};

use bag::{Error, Message, Publisher, topics};
use futures::executor::block_on;
use ros2_client::dds::rustdds::DomainParticipantBuilder;
use ros2_client::qos::{Durability, History, QosProfile, WhenFull};
use ros2_client::{Context, MessageTypeName, Name, NodeName, NodeOptions, WriteError};

use crate::outlet::Outlet;

/// Messages that are kept for a slow subscriber: more than a second of readings.
const DEPTH: usize = 1000;
/// Longest time that a message waits for a slow subscriber.
const PATIENCE: Duration = Duration::from_millis(100);
/// Time for which the messages of a topic are dropped without a wait after one for which there was no room.
const PAUSE: Duration = Duration::from_secs(1);

/// Network of the node.
#[derive(clap::Args)]
pub(crate) struct Network {
    /// ROS 2 domain of the node
    #[arg(long, env = "ROS_DOMAIN_ID", default_value_t = 0, value_parser = clap::value_parser!(u16).range(..=232))]
    domain: u16,
    /// Announce the node on this machine alone, as other nodes do if ROS_LOCALHOST_ONLY is 1
    #[arg(long)]
    localhost_only: bool,
    /// Address of a network interface to announce the node on; may be repeated [default: all interfaces]
    #[arg(long, value_name = "ADDRESS", conflicts_with = "localhost_only")]
    interface: Vec<IpAddr>,
}

impl Network {
    /// Addresses of the interfaces to announce the node on. `None`: all interfaces.
    fn interfaces(&self) -> Option<Vec<IpAddr>> {
        let by_environment = || std::env::var_os("ROS_LOCALHOST_ONLY").is_some_and(|value| value == "1");
        if !self.interface.is_empty() {
            Some(self.interface.clone())
        } else if self.localhost_only || by_environment() {
            Some(vec![Ipv4Addr::LOCALHOST.into()])
        } else {
            None
        }
    }
}

impl fmt::Display for Network {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "ROS 2 domain {}, announced on ", self.domain)?;
        match self.interfaces() {
            None => f.write_str("every network interface"),
            Some(interfaces) => {
                let named: Vec<String> = interfaces.iter().map(ToString::to_string).collect();
                f.write_str(&named.join(", "))
            }
        }
    }
}

/// A node and its publishers, one for each topic.
pub(crate) struct Node {
    node: ros2_client::Node,
    publishers: HashMap<String, Box<dyn Any + Send>>,
    dropped: Dropped,
}

/// Messages that were dropped because a subscriber did not acknowledge those before, by topic.
#[derive(Default)]
struct Dropped(HashMap<String, Blocked>);

/// A topic without room for further messages.
struct Blocked {
    until: Instant,
    count: u64,
}

impl Dropped {
    /// Writes a message. If there is no room for it, it is dropped, and so are those of the next [`PAUSE`] without a wait: a
    /// subscriber that has vanished is known as such only after seconds, and each wait would delay all whiskers. The first one of a
    /// topic is noted.
    fn write<M: fmt::Debug>(
        &mut self,
        topic: &str,
        write: impl FnOnce() -> Result<(), WriteError<M>>,
    ) -> Result<(), Error> {
        if let Some(blocked) = self.0.get_mut(topic).filter(|blocked| Instant::now() < blocked.until) {
            blocked.count += 1;
            return Ok(());
        }
        match write() {
            Ok(()) => Ok(()),
            Err(WriteError::WouldBlock { .. }) => {
                let until = Instant::now() + PAUSE;
                if !self.0.contains_key(topic) {
                    eprintln!(
                        "{topic}: found a subscriber that acknowledged no message for {} ms, expected earlier ones to be acknowledged; \
                         messages are dropped (they are counted)",
                        PATIENCE.as_millis()
                    );
                }
                let blocked = self.0.entry(topic.into()).or_insert(Blocked { until, count: 0 });
                (blocked.until, blocked.count) = (until, blocked.count + 1);
                Ok(())
            }
            Err(error) => Err(Error::Live { topic: topic.into(), reason: format!("{error:?}") }),
        }
    }
}

/// Prints the counts.
impl Drop for Dropped {
    fn drop(&mut self) {
        for (topic, blocked) in &self.0 {
            eprintln!("{topic}: {} messages were dropped", blocked.count);
        }
    }
}

impl Node {
    pub(crate) fn new(network: &Network) -> anyhow::Result<Self> {
        let mut participant = DomainParticipantBuilder::new(network.domain);
        if let Some(interfaces) = network.interfaces() {
            participant = participant.with_only_networks(interfaces);
        }
        let context = Context::from_domain_participant(participant.build()?)?;
        let mut node = context.new_node(NodeName::new("/", "whisker")?, NodeOptions::new())?;
        let spinner = node.spinner()?;
        thread::spawn(move || block_on(spinner.spin()));
        Ok(Self { node, publishers: HashMap::new(), dropped: Dropped::default() })
    }

    /// Subscribes to a topic. A publisher that sends with best effort is heard only with `best_effort`, by which messages may be
    /// lost.
    pub(crate) fn subscribe<M: Message>(
        &mut self,
        topic: &str,
        best_effort: bool,
    ) -> anyhow::Result<ros2_client::Subscription<M>> {
        let quality = quality(topic);
        let quality = if best_effort && !topics::is_kept(topic) { quality.reliability_best_effort() } else { quality };
        let (package, kind) = M::TYPE.split_once("/msg/").expect("types are named package/msg/Type");
        let name = Name::parse(topic).map_err(|error| anyhow::anyhow!("{topic}: {error:?}"))?;
        let topic = self.node.create_topic(&name, MessageTypeName::new(package, kind), &quality)?;
        Ok(self.node.create_subscription(&topic, Some(quality))?)
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
        let publisher = self.publishers[topic]
            .downcast_ref::<ros2_client::Publisher<M>>()
            .ok_or_else(|| failed(format!("found a {}, expected the type that the topic had before", M::TYPE)))?;
        self.dropped.write(topic, || publisher.publish(message.clone()))
    }
}

/// Quality of service of a topic: reliable; static frames and maps are kept for later subscribers.
fn quality(topic: &str) -> QosProfile {
    let quality = QosProfile::publisher_default().reliability_reliable(WhenFull::Wait(PATIENCE));
    if topics::is_kept(topic) {
        quality.durability(Durability::TransientLocal).history(History::KeepLast { depth: 1 })
    } else {
        quality.durability(Durability::Volatile).history(History::KeepLast { depth: DEPTH })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn robust_messages_that_no_subscriber_acknowledges_are_dropped_and_counted() {
        let mut dropped = Dropped::default();
        let mut attempts = 0;
        for _ in 0..3 {
            let mut write = || {
                attempts += 1;
                Err(WriteError::WouldBlock { data: 1 })
            };
            dropped.write("/a", &mut write).expect("dropped");
        }
        assert_eq!((attempts, dropped.0["/a"].count), (1, 3), "one wait");
        // Other topics are written, and so is this one after the pause.
        dropped.write::<u8>("/b", || Ok(())).expect("written");
        dropped.0.get_mut("/a").expect("blocked").until = Instant::now();
        let error = dropped.write::<u8>("/a", || Err(WriteError::Internal { reason: "broken".into() }));
        assert!(error.expect_err("an error").to_string().contains("broken"));
    }
}
