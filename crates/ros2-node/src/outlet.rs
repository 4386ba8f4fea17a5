//! Where messages go, and where the service is called from: a ROS 2 network, or Foxglove.

use std::thread;
use std::time::{Duration, Instant};

use anyhow::bail;
use bag::{Error, Message, Publisher};

use crate::service::Request;

/// How often it is looked whether somebody listens.
const POLL: Duration = Duration::from_millis(50);

/// A publisher with listeners.
pub(crate) trait Outlet: Publisher + Send {
    /// Announces a topic, so that listeners find it before its first message.
    fn announce<M: Message>(&mut self, topic: &str) -> Result<(), Error>;

    /// Whether somebody listens to a topic that was announced.
    fn is_heard(&self, topic: &str) -> bool;

    /// Waits until somebody listens to a topic that was announced.
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

/// What a call of the service makes the printer do.
pub(crate) type Routine<'a> = dyn FnMut(Request) -> anyhow::Result<()> + 'a;

/// Where the service is called.
pub(crate) trait Desk {
    /// Answers a call with what the routine makes of it, if one comes soon.
    fn serve_next(&self, routine: &mut Routine<'_>) -> anyhow::Result<()>;
}
