//! `ros2-node play`: a recording at its original pace.

use std::collections::HashSet;
use std::path::PathBuf;
use std::thread;
use std::time::{Duration, Instant};

use anyhow::ensure;
use bag::messages::AnyMessage;
use bag::{Message, Publisher, Reader, Record};

#[cfg(feature = "foxglove")]
use crate::feed::Foxglove;
use crate::node::{Network, Node};
use crate::outlet::Outlet;

/// Publish the messages of a recording at its original pace
#[derive(clap::Args)]
pub(crate) struct Arguments {
    /// A rosbag2 folder or an MCAP file
    recording: PathBuf,
    /// Begin once this topic of the recording has a subscriber
    #[arg(long)]
    wait_for: Option<String>,
    #[command(flatten)]
    network: Network,
    #[cfg(feature = "foxglove")]
    #[command(flatten)]
    foxglove: Foxglove,
}

/// Longest wait for a subscriber.
const PATIENCE: Duration = Duration::from_secs(60);
/// Time for the last messages to arrive.
const LINGER: Duration = Duration::from_secs(2);

pub(crate) fn run(arguments: &Arguments) -> anyhow::Result<()> {
    // The whole recording is read first, so that the pace does not depend on the disk.
    let mut messages = Vec::new();
    let mut unknown = 0_u64;
    for record in Reader::open(&arguments.recording)?.records() {
        let record = record?;
        match record.decode_any()? {
            Some(message) => messages.push((record, message)),
            None => unknown += 1,
        }
    }
    ensure!(
        !messages.is_empty(),
        "{}: found no message of a known type, expected at least one",
        arguments.recording.display()
    );
    if unknown > 0 {
        eprintln!("warning: {unknown} messages of unknown types are left out");
    }
    #[cfg(feature = "foxglove")]
    if let Some(address) = arguments.foxglove.address {
        return send(&messages, arguments.foxglove.feed(address)?, arguments.wait_for.as_deref());
    }
    send(&messages, Node::new(&arguments.network)?, arguments.wait_for.as_deref())
}

/// Publishes the messages at their original pace, once the topic to wait for has a subscriber.
fn send(messages: &[(Record, AnyMessage)], mut outlet: impl Outlet, wait_for: Option<&str>) -> anyhow::Result<()> {
    let mut announced = HashSet::new();
    for (record, message) in messages {
        if announced.insert(record.topic.as_str()) {
            message.write(&mut Announcer(&mut outlet), &record.topic, 0)?;
        }
    }
    if let Some(topic) = wait_for {
        ensure!(announced.contains(topic), "{topic}: found no such topic in the recording");
        outlet.wait_for_listener(topic, PATIENCE)?;
        // The subscriber may discover this and the other topics a little later.
        thread::sleep(LINGER);
    }
    let first_ns = messages.first().map_or(0, |(record, _)| record.time_ns);
    let begin = Instant::now();
    for (record, message) in messages {
        let due = Duration::from_nanos(record.time_ns.saturating_sub(first_ns));
        thread::sleep(due.saturating_sub(begin.elapsed()));
        message.write(&mut outlet, &record.topic, record.time_ns)?;
    }
    thread::sleep(LINGER);
    println!("{} messages", messages.len());
    Ok(())
}

/// Publisher that announces the topic of a message instead of publishing it.
struct Announcer<'a, O>(&'a mut O);

impl<O: Outlet> Publisher for Announcer<'_, O> {
    fn write<M: Message>(&mut self, topic: &str, _time_ns: u64, _message: &M) -> Result<(), bag::Error> {
        self.0.announce::<M>(topic)
    }
}
