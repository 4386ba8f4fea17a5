//! A live feed for Foxglove, over a WebSocket, and the services of the platform on it.
//!
//! Topics, types and bytes are those of the recordings. Messages of a topic without a subscriber are dropped, and so
//! are the oldest ones of a slow subscriber. Connections pass the [`gate`]; the routine runs only for calls with the
//! [`Token`].

use std::collections::HashMap;
use std::net::SocketAddr;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, TrySendError, sync_channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use anyhow::{anyhow, bail};
use bag::{Error, Message, Publisher, cdr, topics};
use foxglove::websocket::service::{self, Handler, Responder, Service, ServiceSchema};
use foxglove::websocket::{ChannelView, Client, ServerListener};
use foxglove::{
    Channel, ChannelBuilder, ChannelId, Context, PartialMetadata, RawChannel, Schema, WebSocketServer,
    WebSocketServerHandle,
};

use foxglove::messages::SceneUpdate;
use live_ros::Drawing;

use crate::gate;
use crate::outlet::{Desk, Outlet, Routine};
use crate::request::{Authorised, Request, Response, Triggered, schema};
use crate::scene::scene_update;
use crate::token::Token;

/// Messages that are kept for a slow subscriber: some seconds of all topics.
const DEPTH: usize = 8192;
/// Largest number of calls that wait for the end of a routine.
const MOST_WAITING: usize = 4;
/// Longest wait for a call.
const POLL: Duration = Duration::from_millis(20);
/// Encodings of messages and of their definitions.
const ENCODING: &str = "cdr";
const DEFINITIONS: &str = "ros2msg";
/// Origin of the Foxglove application in a browser.
const APPLICATION: &str = "https://app.foxglove.dev";

/// Whether to publish to Foxglove, and who may connect.
#[derive(clap::Args)]
pub(crate) struct Foxglove {
    /// Feed Foxglove over a WebSocket instead of ROS 2 [default address: 127.0.0.1:8765]
    #[arg(long = "foxglove", value_name = "ADDRESS", num_args = 0..=1, require_equals = true)]
    #[arg(default_missing_value = "127.0.0.1:8765")]
    pub(crate) address: Option<SocketAddr>,
    /// Allow web pages of this origin to connect, such as http://localhost:8080; may be repeated [default:
    /// https://app.foxglove.dev]
    #[arg(long, value_name = "ORIGIN", requires = "address")]
    allow_origin: Vec<String>,
    /// Allow an address that other machines reach
    #[arg(long, requires = "address")]
    allow_remote: bool,
}

/// Publisher to every connected Foxglove client.
pub(crate) struct Feed {
    /// `None` once it is dropped.
    server: Option<WebSocketServerHandle>,
    context: Arc<Context>,
    channels: HashMap<String, Arc<RawChannel>>,
    scenes: HashMap<String, Channel<SceneUpdate>>,
    standing: Arc<Standing>,
}

/// Calls of the routine by Foxglove.
pub(crate) struct Calls(Receiver<(Request, Responder)>);

impl Foxglove {
    /// Publishes on an address and prints it.
    pub(crate) fn feed(&self, address: SocketAddr) -> anyhow::Result<Feed> {
        self.open(address, Vec::new())
    }

    /// Publishes on an address, offers the services of the platform, and prints the address and the token. A call of
    /// the service that stops sets `stop`.
    pub(crate) fn platform(&self, address: SocketAddr, stop: Arc<AtomicBool>) -> anyhow::Result<(Feed, Calls)> {
        let (token, (sender, calls)) = (Token::random()?, sync_channel(MOST_WAITING));
        let shown = format!("token {}", token.text());
        let part = |(name, fields): (&str, &str)| Schema::new(name, DEFINITIONS, fields.as_bytes().to_vec());
        let [routine, stopping] = [
            (schema::BEAM_TEST, schema::BEAM_TEST_REQUEST, schema::BEAM_TEST_RESPONSE),
            (schema::TRIGGER, schema::TRIGGER_REQUEST, schema::TRIGGER_RESPONSE),
        ]
        .map(|(name, request, response)| {
            ServiceSchema::new(name).with_request(ENCODING, part(request)).with_response(ENCODING, part(response))
        });
        let stops = move |_: service::Request| {
            stop.store(true, Ordering::Relaxed);
            Ok::<_, Error>(cdr::encode(&Triggered::stopped()))
        };
        let services = vec![
            Service::builder(topics::BEAM_TEST, routine).handler(Queue { token, sender }),
            Service::builder(topics::STOP, stopping).handler_fn(stops),
        ];
        let feed = self.open(address, services)?;
        println!("{shown}");
        Ok((feed, Calls(calls)))
    }

    fn open(&self, address: SocketAddr, services: Vec<Service>) -> anyhow::Result<Feed> {
        if !(address.ip().is_loopback() || self.allow_remote) {
            bail!(
                "{address}: found an address that other machines reach, expected a loopback address or --allow-remote"
            );
        }
        let mut origins = self.allow_origin.clone();
        if origins.is_empty() {
            origins.push(APPLICATION.into());
        }
        let (context, standing) = (Context::new(), Arc::new(Standing::default()));
        let hidden = gate::hidden_address()?;
        let server = WebSocketServer::new()
            .name("whisker")
            .bind(hidden.to_string(), 0)
            .context(&context)
            .listener(standing.clone())
            .services(services)
            .supported_encodings([ENCODING])
            .message_backlog_size(DEPTH)
            .start_blocking()
            .map_err(|error| anyhow!("{hidden}: {error}"))?;
        let at = gate::open(address, origins, SocketAddr::new(hidden.into(), server.port()))?;
        println!("ws://{at}");
        Ok(Feed { server: Some(server), context, channels: HashMap::new(), scenes: HashMap::new(), standing })
    }
}

impl Drop for Feed {
    /// Ends the connections after their last responses.
    fn drop(&mut self) {
        if let Some(server) = self.server.take() {
            server.stop().wait_blocking();
        }
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
        let has_scene = self.scenes.get(topic).is_some_and(|channel| channel.has_sinks());
        has_scene || self.channels.get(topic).is_some_and(|channel| channel.has_sinks())
    }

    /// Shapes are markers, and a scene of Foxglove.
    fn draw(&mut self, prefix: &str, drawing: &Drawing) -> Result<(), Error> {
        self.write(&format!("{prefix}/{}", topics::MARKERS), drawing.time_ns, &drawing.markers())?;
        let topic = format!("{prefix}/{}", topics::SCENE);
        let context = &self.context;
        let build = || ChannelBuilder::new(&topic).context(context).build::<SceneUpdate>();
        let channel = self.scenes.entry(topic.clone()).or_insert_with(build);
        channel.log_with_meta(&scene_update(drawing), at(drawing.time_ns));
        Ok(())
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
        if topics::is_kept(topic) {
            self.standing.keep(Kept { channel: channel.clone(), time_ns, bytes });
        }
        Ok(())
    }
}

fn at(time_ns: u64) -> PartialMetadata {
    PartialMetadata { log_time: Some(time_ns) }
}

/// Last messages of the static frames and of maps, for clients that subscribe later.
#[derive(Default)]
struct Standing(Mutex<HashMap<ChannelId, Kept>>);

/// A sent message.
struct Kept {
    channel: Arc<RawChannel>,
    time_ns: u64,
    bytes: Vec<u8>,
}

impl Standing {
    fn keep(&self, message: Kept) {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).insert(message.channel.id(), message);
    }
}

impl ServerListener for Standing {
    fn on_subscribe(&self, client: Client, subscribed: ChannelView) {
        let standing = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(Kept { channel, time_ns, bytes }) = standing.get(&subscribed.id()) {
            channel.log_with_meta_to_sink(bytes, at(*time_ns), client.sink_id());
        }
    }
}

/// Handler that puts calls with the token into the queue of [`Calls`].
struct Queue {
    token: Token,
    sender: SyncSender<(Request, Responder)>,
}

impl Queue {
    /// The routine that a call requests, if it has the token.
    fn authorised(&self, call: &service::Request) -> Result<Request, String> {
        let found = cdr::decode::<Authorised>(call.payload());
        let Authorised { request, token } =
            found.map_err(|found| format!("found {found}, expected a {}", schema::BEAM_TEST_REQUEST.0))?;
        if !self.token.is(&token) {
            return Err("token: found another one, expected the token that the program printed when it started".into());
        }
        Ok(request)
    }
}

impl Handler for Queue {
    fn call(&self, call: service::Request, responder: Responder) {
        let request = match self.authorised(&call) {
            Ok(request) => request,
            Err(refusal) => return responder.respond_err(refusal),
        };
        match self.sender.try_send((request, responder)) {
            Ok(()) => {}
            Err(TrySendError::Full((_, responder))) => {
                responder
                    .respond_err(format!("found {MOST_WAITING} calls that wait, expected fewer: call again later"));
            }
            Err(TrySendError::Disconnected((_, responder))) => responder.respond_err("the program ends".into()),
        }
    }
}

impl Desk for Calls {
    fn serve_next(&self, routine: &mut Routine<'_>) -> anyhow::Result<()> {
        match self.0.recv_timeout(POLL) {
            Ok((request, responder)) => {
                let done = routine(request);
                responder
                    .respond(done.map(|()| cdr::encode(&Response::default())).map_err(|error| format!("{error:#}")));
                Ok(())
            }
            Err(RecvTimeoutError::Timeout) => Ok(()),
            Err(RecvTimeoutError::Disconnected) => bail!("{}: the WebSocket server is gone", topics::BEAM_TEST),
        }
    }
}
