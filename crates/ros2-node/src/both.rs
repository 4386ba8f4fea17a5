//! Outlet of one stream to ROS 2 and, if it is asked for, to Foxglove.

use bag::{Error, Message, Publisher};
use live_ros::Drawing;

#[cfg(feature = "foxglove")]
use crate::feed::Feed;
use crate::node::Node;
use crate::outlet::Outlet;

/// A node and a feed with the same topics.
pub(crate) struct Both {
    pub(crate) node: Node,
    #[cfg(feature = "foxglove")]
    pub(crate) feed: Option<Feed>,
}

/// Calls a function for each outlet.
macro_rules! each {
    ($both:expr, $outlet:ident => $done:expr) => {{
        let $outlet = &mut $both.node;
        $done?;
        #[cfg(feature = "foxglove")]
        if let Some($outlet) = &mut $both.feed {
            $done?;
        }
        Ok(())
    }};
}

impl Publisher for Both {
    fn write<M: Message>(&mut self, topic: &str, time_ns: u64, message: &M) -> Result<(), Error> {
        each!(self, outlet => outlet.write(topic, time_ns, message))
    }
}

impl Outlet for Both {
    fn announce<M: Message>(&mut self, topic: &str) -> Result<(), Error> {
        each!(self, outlet => outlet.announce::<M>(topic))
    }

    fn is_heard(&self, topic: &str) -> bool {
        #[cfg(feature = "foxglove")]
        if self.feed.as_ref().is_some_and(|feed| feed.is_heard(topic)) {
            return true;
        }
        self.node.is_heard(topic)
    }

    fn draw(&mut self, prefix: &str, drawing: &Drawing) -> Result<(), Error> {
        each!(self, outlet => outlet.draw(prefix, drawing))
    }
}
