//! Subscriptions, and the way of their messages to the whiskers.

use std::sync::mpsc::SyncSender;
use std::sync::{Arc, Mutex};
use std::thread;
use std::time::Instant;

use anyhow::Context;
use bag::Message;
use bag::messages::{AnyMessage, JointState, MagneticField, MagneticFieldArray, TfMessage, WrenchStamped};
use futures::StreamExt;
use futures::executor::block_on;
use live_ros::{Routed, Router};

use super::locked;
use crate::node::Node;

/// Way of messages to the threads of the whiskers.
pub(super) struct Dispatch {
    router: Mutex<Router>,
    whiskers: Vec<SyncSender<(Routed, f64)>>,
    origin: Instant,
}

/// Subscribes to a topic; its messages are dispatched by a thread.
pub(super) fn listen_to(
    node: &mut Node,
    topic: &str,
    type_name: &str,
    best_effort: bool,
    dispatch: &Arc<Dispatch>,
) -> anyhow::Result<()> {
    match type_name {
        WrenchStamped::TYPE => listen(node, topic, best_effort, AnyMessage::WrenchStamped, dispatch),
        TfMessage::TYPE => listen(node, topic, best_effort, AnyMessage::TfMessage, dispatch),
        JointState::TYPE => listen(node, topic, best_effort, AnyMessage::JointState, dispatch),
        MagneticField::TYPE => listen(node, topic, best_effort, AnyMessage::MagneticField, dispatch),
        MagneticFieldArray::TYPE => listen(node, topic, best_effort, AnyMessage::MagneticFieldArray, dispatch),
        other => anyhow::bail!("{topic}: found the type {other}, expected one of a reading or a pose"),
    }
}

fn listen<M: Message>(
    node: &mut Node,
    topic: &str,
    best_effort: bool,
    any: fn(M) -> AnyMessage,
    dispatch: &Arc<Dispatch>,
) -> anyhow::Result<()> {
    let subscription = node.subscribe::<M>(topic, best_effort)?;
    let (topic, dispatch) = (topic.to_owned(), dispatch.clone());
    let listens = move || {
        let mut messages = Box::pin(subscription.async_stream());
        while let Some(received) = block_on(messages.next()) {
            match received {
                Ok((message, _)) => dispatch.take(&topic, &any(message)),
                Err(error) => eprintln!("error: {topic}: {error}; the message is left out"),
            }
        }
    };
    thread::Builder::new().name("subscription".into()).spawn(listens).context("thread of a subscription")?;
    Ok(())
}

impl Dispatch {
    /// A way through this router to the threads of the whiskers, for arrivals since `origin`.
    pub(super) fn new(router: Router, whiskers: Vec<SyncSender<(Routed, f64)>>, origin: Instant) -> Self {
        Self { router: Mutex::new(router), whiskers, origin }
    }

    /// See [`Router::refused`].
    pub(super) fn refused(&self) -> u64 {
        locked(&self.router).refused()
    }

    /// See [`Router::foreign`].
    pub(super) fn foreign(&self) -> u64 {
        locked(&self.router).foreign()
    }

    /// Passes a message that has just arrived to the threads of its whiskers.
    fn take(&self, topic: &str, message: &AnyMessage) {
        let mut routed = Vec::new();
        // The lock keeps the inputs of a whisker in the order of their arrivals.
        let mut router = locked(&self.router);
        let now_s = self.origin.elapsed().as_secs_f64();
        router.route(topic, message, &mut routed);
        router.take_notes().iter().for_each(|note| eprintln!("error: {note}"));
        for input in routed {
            let of = input.whisker.map_or(0..self.whiskers.len(), |index| index..index + 1);
            for whisker in &self.whiskers[of] {
                // The thread of the whisker has ended if nobody receives.
                let _ = whisker.send((input.clone(), now_s));
            }
        }
    }
}
