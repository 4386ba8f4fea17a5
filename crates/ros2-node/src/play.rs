//! `ros2-node play`: a recording, at its own pace.

use std::path::PathBuf;
use std::thread;
use std::time::{Duration, Instant};

use anyhow::Context;
use bag::{Message, Publisher, Reader};

use crate::node::{Network, Node};

/// Publish the messages of a recording at its own pace
#[derive(clap::Args)]
pub(crate) struct Arguments {
    /// A rosbag2 folder or an MCAP file
    recording: PathBuf,
    /// Begin once somebody has subscribed to this topic of the recording
    #[arg(long)]
    wait_for: Option<String>,
    #[command(flatten)]
    network: Network,
}

/// How long a subscriber is waited for.
const PATIENCE: Duration = Duration::from_secs(60);
/// How long the last messages may take to arrive.
const LINGER: Duration = Duration::from_secs(2);

pub(crate) fn run(arguments: &Arguments) -> anyhow::Result<()> {
    // Read whole, so that the pace is the recording's and not the disk's.
    let mut messages = Vec::new();
    let mut unknown = 0_u64;
    for record in Reader::open(&arguments.recording)?.records() {
        let record = record?;
        match record.decode_any()? {
            Some(message) => messages.push((record, message)),
            None => unknown += 1,
        }
    }
    let first_ns = messages.first().map(|(record, _)| record.time_ns).context("no message of a known type")?;
    if unknown > 0 {
        eprintln!("warning: {unknown} messages of unknown types are left out");
    }
    let mut node = Node::new(&arguments.network)?;
    if let Some(topic) = &arguments.wait_for {
        let (_, message) = messages
            .iter()
            .find(|(record, _)| record.topic == *topic)
            .with_context(|| format!("{topic}: not in it"))?;
        message.write(&mut Announcer(&mut node), topic, 0)?;
        node.wait_for_subscriber(topic, PATIENCE)?;
        // The other side may know a little later than this one.
        thread::sleep(LINGER);
    }
    let begin = Instant::now();
    for (record, message) in &messages {
        let due = Duration::from_nanos(record.time_ns.saturating_sub(first_ns));
        thread::sleep(due.saturating_sub(begin.elapsed()));
        message.write(&mut node, &record.topic, record.time_ns)?;
    }
    thread::sleep(LINGER);
    println!("{} messages", messages.len());
    Ok(())
}

/// Announces the topic of a message instead of sending it.
struct Announcer<'a>(&'a mut Node);

impl Publisher for Announcer<'_> {
    fn write<M: Message>(&mut self, topic: &str, _time_ns: u64, _message: &M) -> Result<(), bag::Error> {
        self.0.announce::<M>(topic)
    }
}
