//! Interfaces to a network of listeners and callers: ROS 2 or Foxglove.

use std::thread;
use std::time::{Duration, Instant};

use anyhow::bail;
use bag::{Error, Message, Publisher, topics};
use live_ros::Drawing;

use crate::request::Request;

/// Interval between two checks for a subscriber.
const POLL: Duration = Duration::from_millis(50);

/// A publisher whose subscribers are known.
pub(crate) trait Outlet: Publisher + Send {
    /// Announces a topic, so that subscribers find it before its first message.
    fn announce<M: Message>(&mut self, topic: &str) -> Result<(), Error>;

    /// Whether an announced topic has a subscriber.
    fn is_heard(&self, topic: &str) -> bool;

    /// Publishes shapes as markers, after a prefix.
    fn draw(&mut self, prefix: &str, drawing: &Drawing) -> Result<(), Error> {
        self.write(&format!("{prefix}/{}", topics::MARKERS), drawing.time_ns, &drawing.markers())
    }

    /// Waits until an announced topic has a subscriber.
    fn wait_for_listener(&self, topic: &str, patience: Duration) -> anyhow::Result<()> {
        let begin = Instant::now();
        while !self.is_heard(topic) {
            if begin.elapsed() > patience {
                bail!("{topic}: no subscriber within {} s", patience.as_secs());
            }
            thread::sleep(POLL);
        }
        Ok(())
    }
}

/// Routine of the printer that a call of the service runs.
pub(crate) type Routine<'a> = dyn FnMut(Request) -> anyhow::Result<()> + 'a;

/// Server of the service.
pub(crate) trait Desk {
    /// Runs the routine for the next call, if one comes soon, and answers it.
    fn serve_next(&self, routine: &mut Routine<'_>) -> anyhow::Result<()>;
}
