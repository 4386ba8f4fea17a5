//! A live feed for Foxglove, over a WebSocket.
//!
//! Topics, types and bytes are those of the recordings. Messages of a topic without a subscriber are dropped, and so are the oldest ones of a slow subscriber.

use std::collections::HashMap;
use std::net::SocketAddr;
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use anyhow::{anyhow, bail};
use bag::{Error, Message, Publisher, cdr, topics};
use foxglove::websocket::service::{self, Handler, Responder, ServiceSchema};
use foxglove::websocket::{ChannelView, Client, ServerListener};
use foxglove::{ChannelBuilder, Context, PartialMetadata, RawChannel, Schema, WebSocketServer, WebSocketServerHandle};

use crate::outlet::{Desk, Outlet, Routine};
use crate::request::{Request, Response};

/// Messages that are kept for a slow subscriber: some seconds of all topics.
const DEPTH: usize = 8192;
/// Longest wait for a call.
const POLL: Duration = Duration::from_millis(20);
/// Encodings of messages and of their definitions.
const ENCODING: &str = "cdr";
const DEFINITIONS: &str = "ros2msg";

/// Whether to publish to Foxglove, and the address to listen on.
#[derive(clap::Args)]
pub(crate) struct Foxglove {
    /// Feed Foxglove over a WebSocket instead of ROS 2 [default address: 127.0.0.1:8765]
    #[arg(long = "foxglove", value_name = "ADDRESS", num_args = 0..=1, require_equals = true, default_missing_value = "127.0.0.1:8765")]
    pub(crate) address: Option<SocketAddr>,
}

/// Publisher to every connected Foxglove client.
pub(crate) struct Feed {
    /// Stops when it is dropped.
    _server: WebSocketServerHandle,
    context: Arc<Context>,
    channels: HashMap<String, Arc<RawChannel>>,
    standing: Arc<Standing>,
}

/// Calls of the service by Foxglove.
pub(crate) struct Calls(Receiver<(service::Request, Responder)>);

impl Feed {
    /// Listens on an address and prints it.
    pub(crate) fn open(address: SocketAddr) -> anyhow::Result<(Self, Calls)> {
        let (context, standing) = (Context::new(), Arc::new(Standing::default()));
        let (sender, calls) = channel();
        let part = |name: &str, fields: &str| Schema::new(name, DEFINITIONS, fields.as_bytes().to_vec());
        let schema = ServiceSchema::new(Request::SERVICE)
            .with_request(ENCODING, part(Request::TYPE, Request::DEFINITION))
            .with_response(ENCODING, part(Response::TYPE, Response::DEFINITION));
        let server = WebSocketServer::new()
            .name("whisker")
            .bind(address.ip().to_string(), address.port())
            .context(&context)
            .listener(standing.clone())
            .services([service::Service::builder(topics::BEAM_TEST, schema).handler(Queue(sender))])
            .supported_encodings([ENCODING])
            .message_backlog_size(DEPTH)
            .start_blocking()
            .map_err(|error| anyhow!("{address}: {error}"))?;
        println!("ws://{}", SocketAddr::new(address.ip(), server.port()));
        Ok((Self { _server: server, context, channels: HashMap::new(), standing }, Calls(calls)))
    }
}

impl Outlet for Feed {
    fn announce<M: Message>(&mut self, topic: &str) -> Result<(), Error> {
        let channel = ChannelBuilder::new(topic)
            .context(&self.context)
            .message_encoding(ENCODING)
            .schema(Schema::new(M::TYPE, DEFINITIONS, M::definition().into_bytes()))
            .build_raw()
            .map_err(|error| Error::Live { topic: topic.into(), reason: error.to_string() })?;
        self.channels.insert(topic.into(), channel);
        Ok(())
    }

    fn is_heard(&self, topic: &str) -> bool {
        self.channels.get(topic).is_some_and(|channel| channel.has_sinks())
    }
}

impl Publisher for Feed {
    fn write<M: Message>(&mut self, topic: &str, time_ns: u64, message: &M) -> Result<(), Error> {
        if !self.channels.contains_key(topic) {
            self.announce::<M>(topic)?;
        }
        let (channel, bytes) = (&self.channels[topic], message.encode());
        if channel.schema().is_none_or(|schema| schema.name != M::TYPE) {
            let reason = format!("found a {}, expected the type that the topic had before", M::TYPE);
            return Err(Error::Live { topic: topic.into(), reason });
        }
        channel.log_with_meta(&bytes, at(time_ns));
        if topic == topics::TF_STATIC {
            self.standing.keep(Kept { channel: channel.clone(), time_ns, bytes });
        }
        Ok(())
    }
}

fn at(time_ns: u64) -> PartialMetadata {
    PartialMetadata { log_time: Some(time_ns) }
}

/// Last message of the static frames, for clients that subscribe later.
#[derive(Default)]
struct Standing(Mutex<Option<Kept>>);

/// A sent message.
struct Kept {
    channel: Arc<RawChannel>,
    time_ns: u64,
    bytes: Vec<u8>,
}

impl Standing {
    fn keep(&self, message: Kept) {
        *self.0.lock().unwrap_or_else(PoisonError::into_inner) = Some(message);
    }
}

impl ServerListener for Standing {
    fn on_subscribe(&self, client: Client, subscribed: ChannelView) {
        let standing = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(Kept { channel, time_ns, bytes }) = &*standing
            && channel.id() == subscribed.id()
        {
            channel.log_with_meta_to_sink(bytes, at(*time_ns), client.sink_id());
        }
    }
}

/// Handler that puts calls into the queue of [`Calls`].
struct Queue(Sender<(service::Request, Responder)>);

impl Handler for Queue {
    fn call(&self, request: service::Request, responder: Responder) {
        // After the end of serving the responder is dropped, which answers the call with an error.
        let _ = self.0.send((request, responder));
    }
}

impl Desk for Calls {
    fn serve_next(&self, routine: &mut Routine<'_>) -> anyhow::Result<()> {
        match self.0.recv_timeout(POLL) {
            Ok((request, responder)) => {
                let request = cdr::decode::<Request>(request.payload())
                    .map_err(|found| anyhow!("found {found}, expected a {}", Request::TYPE));
                let done = request.and_then(routine);
                responder
                    .respond(done.map(|()| cdr::encode(&Response::default())).map_err(|error| format!("{error:#}")));
                Ok(())
            }
            Err(RecvTimeoutError::Timeout) => Ok(()),
            Err(RecvTimeoutError::Disconnected) => bail!("{}: the WebSocket server is gone", topics::BEAM_TEST),
        }
    }
}
