//! `ros2-node contact`: live contact estimation on ROS 2 topics.
//!
//! ```text
//! subscriptions (one thread each) -> router -> whiskers (one thread each) -> contacts
//!                                                    |-> drawer: whiskers, outlines, map and diagnostics
//! ```

mod dispatch;
mod draw;

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, sync_channel};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};

use anyhow::Context;
use bag::messages::{DiagnosticArray, OccupancyGrid, PointCloud2, PoseWithCovarianceStamped};
use bag::{Publisher, topics};
use live::Event;
use live_ros::{Drawing, Mapping, Routed, Setup, Taken, Whisker};
use platform::inference::Times;
use platform::interrupt;

use crate::both::Both;
#[cfg(feature = "foxglove")]
use crate::feed::Foxglove;
use crate::node::{Network, Node};
use crate::outlet::Outlet;
use dispatch::{Dispatch, listen_to};

/// Estimate contacts live from readings, and from /tf or joint states, and publish contacts, whiskers, outlines, a map and
/// diagnostics
#[derive(clap::Args)]
pub(crate) struct Arguments {
    /// Mapping of topics, frames and calibrations to whiskers (.json), as specified in docs/LIVE.md
    mapping: PathBuf,
    /// Interval between two drawings of the whiskers and outlines (s)
    #[arg(long, default_value_t = 0.1, value_parser = interval_s)]
    draw_every: f64,
    /// Interval between two maps (s)
    #[arg(long, default_value_t = 1.0, value_parser = interval_s)]
    map_every: f64,
    /// Subscribe with best effort, as publishers of sensor data with best effort require; messages may be lost
    #[arg(long)]
    best_effort: bool,
    #[command(flatten)]
    network: Network,
    #[cfg(feature = "foxglove")]
    #[command(flatten)]
    foxglove: Foxglove,
}

/// Inputs of a whisker that wait for its thread.
const AHEAD: usize = 1 << 12;
/// Longest wait of a whisker without a waiting reading, and so the delay of an interrupt.
const NAP: Duration = Duration::from_millis(50);
/// Largest number of printed events of a whisker and kind; further ones are counted.
const MOST_NOTES: u64 = 10;

/// A whisker that its thread and the drawer use.
struct Shared {
    whisker: Mutex<Box<dyn Whisker>>,
    latency: Mutex<Times>,
    /// Printed events by kind.
    notes: Mutex<BTreeMap<&'static str, u64>>,
}

/// Parts that all threads have in common.
struct Session {
    outlet: Mutex<Both>,
    whiskers: Vec<Shared>,
    mapping: Mapping,
    origin: Instant,
    stop: Arc<AtomicBool>,
    /// Whether the diagnostics are to be published soon.
    urgent: AtomicBool,
}

pub(crate) fn run(arguments: &Arguments) -> anyhow::Result<()> {
    let Setup { mapping, is_in_space, whiskers, router } = Setup::read(&arguments.mapping)?;
    let stop = interrupt::asked()?;
    let mut outlet = Both {
        node: Node::new(&arguments.network)?,
        #[cfg(feature = "foxglove")]
        feed: arguments.foxglove.address.map(|address| arguments.foxglove.feed(address)).transpose()?,
    };
    eprintln!(
        "warning: {}: everyone who reaches it reads the contacts, and can publish the readings and poses that determine \
        them; confine it with --localhost-only, --interface, ROS_DOMAIN_ID or a firewall",
        arguments.network
    );
    announce(&mut outlet, &mapping, is_in_space)?;
    let origin = Instant::now();
    let (senders, receivers): (Vec<_>, Vec<_>) = whiskers.iter().map(|_| sync_channel(AHEAD)).unzip();
    let topics = router.topics();
    let dispatch = Arc::new(Dispatch::new(router, senders, origin));
    for topic in &topics {
        listen_to(&mut outlet.node, &topic.name, topic.type_name, arguments.best_effort, &dispatch)?;
    }
    let shared = |whisker| Shared { whisker: Mutex::new(whisker), latency: Mutex::default(), notes: Mutex::default() };
    let (outlet, whiskers) = (Mutex::new(outlet), whiskers.into_iter().map(shared).collect());
    let session =
        Arc::new(Session { outlet, whiskers, mapping, origin, stop: stop.clone(), urgent: AtomicBool::new(false) });
    let threads = (0..).zip(receivers).map(|(index, inputs)| session.start(index, inputs));
    let threads: Vec<_> = threads.collect::<Result<_, _>>()?;
    println!("ready");
    let drawn = session.draw_until_stopped(arguments.draw_every, arguments.map_every);
    stop.store(true, Ordering::Relaxed);
    let ended: Vec<anyhow::Result<()>> =
        threads.into_iter().map(|thread| thread.join().expect("the thread does not panic")).collect();
    session.summarise(&dispatch);
    ended.into_iter().chain([drawn]).collect()
}

/// Announces the topics, so that subscribers find them before the first contact.
fn announce(outlet: &mut Both, mapping: &Mapping, is_in_space: bool) -> anyhow::Result<()> {
    for whisker in &mapping.whiskers {
        outlet.announce::<PoseWithCovarianceStamped>(&contact_topic(mapping, &whisker.name))?;
    }
    let (frame, shapes) = (mapping.fixed_frame.clone(), Vec::new());
    outlet.draw(&mapping.prefix, &Drawing { frame, time_ns: 0, lifetime_s: 0.0, shapes })?;
    if is_in_space {
        for layer in [topics::MAP_POINTS, topics::MAP_VOXELS] {
            outlet.announce::<PointCloud2>(&layer_topic(mapping, layer))?;
        }
    } else {
        outlet.announce::<OccupancyGrid>(&layer_topic(mapping, topics::MAP))?;
    }
    Ok(outlet.announce::<DiagnosticArray>(topics::DIAGNOSTICS)?)
}

fn contact_topic(mapping: &Mapping, whisker: &str) -> String {
    format!("{}/{whisker}/{}", mapping.prefix, topics::CONTACT)
}

/// Topic of a layer of the map.
fn layer_topic(mapping: &Mapping, layer: &str) -> String {
    format!("{}/{layer}", mapping.prefix)
}

impl Session {
    /// Starts the thread of a whisker.
    fn start(
        self: &Arc<Self>,
        index: usize,
        inputs: Receiver<(Routed, f64)>,
    ) -> anyhow::Result<JoinHandle<anyhow::Result<()>>> {
        let session = self.clone();
        let works = move || {
            let done = session.work(index, &inputs);
            // Without one of its whiskers the node does not continue.
            session.stop.store(true, Ordering::Relaxed);
            done
        };
        thread::Builder::new().name("whisker".into()).spawn(works).context("thread of a whisker")
    }

    /// Runs the estimator of a whisker on its inputs until an interrupt.
    fn work(&self, index: usize, inputs: &Receiver<(Routed, f64)>) -> anyhow::Result<()> {
        let shared = &self.whiskers[index];
        let topic = contact_topic(&self.mapping, locked(&shared.whisker).name());
        let mut taken = Taken::default();
        while !self.stop.load(Ordering::Relaxed) {
            let due_s = locked(&shared.whisker).deadline_s();
            let left_s = due_s.map(|due_s| (due_s - self.origin.elapsed().as_secs_f64()).max(0.0));
            let wait = left_s.map_or(NAP, Duration::from_secs_f64).min(NAP);
            let arrived = match inputs.recv_timeout(wait) {
                Ok(arrived) => Some(arrived),
                Err(RecvTimeoutError::Timeout) => None,
                Err(RecvTimeoutError::Disconnected) => break,
            };
            let at_s = arrived.as_ref().map_or_else(|| self.origin.elapsed().as_secs_f64(), |(_, at_s)| *at_s);
            {
                let mut whisker = locked(&shared.whisker);
                while let Some(due_s) = whisker.deadline_s().filter(|due_s| *due_s <= at_s) {
                    whisker.poll(due_s, &mut taken)?;
                }
                if let Some((Routed { t_s, input, .. }, _)) = arrived {
                    whisker.take(t_s, input, at_s, &mut taken)?;
                }
            }
            self.publish(shared, &topic, &mut taken)?;
        }
        locked(&shared.whisker).finish(&mut taken)?;
        self.publish(shared, &topic, &mut taken)
    }

    /// Publishes contacts and prints events.
    fn publish(&self, shared: &Shared, topic: &str, taken: &mut Taken) -> anyhow::Result<()> {
        if !taken.contacts.is_empty() {
            let mut outlet = locked(&self.outlet);
            for contact in &taken.contacts {
                outlet.write(topic, contact.time_ns, &contact.message)?;
            }
        }
        let now_s = self.origin.elapsed().as_secs_f64();
        let mut latency = locked(&shared.latency);
        for contact in taken.contacts.drain(..) {
            latency.push(Duration::from_secs_f64((now_s - contact.arrived_s).max(0.0)));
        }
        for event in taken.events.drain(..) {
            self.urgent.store(true, Ordering::Relaxed);
            let mut notes = locked(&shared.notes);
            let (kind, is_error) = kind_of(&event);
            let count = notes.entry(kind).or_default();
            *count += 1;
            if *count <= MOST_NOTES {
                let further = if *count == MOST_NOTES { " (further ones are counted)" } else { "" };
                let name = locked(&shared.whisker).name().to_owned();
                eprintln!("{}{name}: {event}{further}", if is_error { "error: " } else { "" });
            }
        }
        Ok(())
    }

    /// Prints the counts of the whiskers and the latency.
    fn summarise(&self, dispatch: &Dispatch) {
        for shared in &self.whiskers {
            let whisker = locked(&shared.whisker);
            eprintln!("{}: {}", whisker.name(), whisker.counters());
            for remark in whisker.counters().remarks() {
                eprintln!("{}: note: {remark}", whisker.name());
            }
            let latency = locked(&shared.latency);
            if latency.count() > 0 {
                eprintln!(
                    "{}: latency from reading to contact: {} contacts, {}",
                    whisker.name(),
                    latency.count(),
                    *latency
                );
            }
            for (kind, count) in locked(&shared.notes).iter().filter(|(_, count)| **count > 1) {
                eprintln!("{}: {kind}: {count}", whisker.name());
            }
        }
        let left_out = [
            ("transforms without a valid rotation", dispatch.refused()),
            ("moments in another frame than that of the base", dispatch.foreign()),
        ];
        for (kind, count) in left_out.into_iter().filter(|(_, count)| *count > 0) {
            eprintln!("{kind}, left out: {count}");
        }
    }
}

/// Kind of an event, and whether it is an error.
fn kind_of(event: &Event) -> (&'static str, bool) {
    match event {
        Event::Stale { .. } => ("stale poses", false),
        Event::Recovered { .. } => ("poses again", false),
        Event::OffPlane { .. } => ("poses off the plane", true),
        Event::Fast { .. } => ("implausibly fast poses", false),
        Event::Jumped { .. } => ("jumps of a clock", true),
        Event::Frozen { .. } => ("frozen readings", false),
        Event::Thawed { .. } => ("readings that change again", false),
        Event::NotFinite { .. } => ("values that are not finite", true),
    }
}

/// Exclusive use of a value.
fn locked<T>(value: &Mutex<T>) -> MutexGuard<'_, T> {
    value.lock().unwrap_or_else(PoisonError::into_inner)
}

fn interval_s(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(value) if (0.02..=60.0).contains(&value) => Ok(value),
        _ => Err("expected seconds, 0.02 to 60, for example 0.1".into()),
    }
}
