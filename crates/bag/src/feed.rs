//! A live feed for Foxglove over a WebSocket.

use std::collections::HashMap;
use std::sync::Arc;

use foxglove::{ChannelBuilder, Context, PartialMetadata, RawChannel, Schema, WebSocketServer, WebSocketServerHandle};

use crate::{Error, Message, Publisher};

/// Sends messages to every Foxglove that is connected, as they come; what nobody listens to is dropped.
pub struct Feed {
    server: WebSocketServerHandle,
    context: Arc<Context>,
    channels: HashMap<String, Arc<RawChannel>>,
}

impl Feed {
    /// Listens on a port of an address, for example `127.0.0.1`; on a free one where the port is 0.
    ///
    /// # Errors
    /// If the system does not give the port.
    pub fn open(address: &str, port: u16) -> Result<Self, Error> {
        let context = Context::new();
        let server = WebSocketServer::new()
            .name("whisker")
            .bind(address, port)
            .context(&context)
            .start_blocking()
            .map_err(|error| Error::Live { topic: format!("{address}:{port}"), reason: error.to_string() })?;
        Ok(Self { server, context, channels: HashMap::new() })
    }

    /// The port that it listens on.
    pub fn port(&self) -> u16 {
        self.server.port()
    }
}

impl Publisher for Feed {
    fn write<M: Message>(&mut self, topic: &str, time_ns: u64, message: &M) -> Result<(), Error> {
        if !self.channels.contains_key(topic) {
            let channel = ChannelBuilder::new(topic)
                .context(&self.context)
                .message_encoding("cdr")
                .schema(Schema::new(M::TYPE, "ros2msg", M::definition().into_bytes()))
                .build_raw()
                .map_err(|error| Error::Live { topic: topic.into(), reason: error.to_string() })?;
            self.channels.insert(topic.into(), channel);
        }
        self.channels[topic].log_with_meta(&message.encode(), PartialMetadata { log_time: Some(time_ns) });
        Ok(())
    }
}
