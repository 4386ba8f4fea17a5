//! The Foxglove feed with a foreign client: who may connect, who may move the printer, and how it is stopped.
#![cfg(all(unix, feature = "foxglove"))]

use std::io::{BufRead, BufReader};
use std::net::TcpStream;
use std::process::{Child, ChildStdout, Command, Stdio};
use std::sync::Arc;
use std::time::{Duration, Instant};

use platform::emulate::{Emulated, Emulation, RigTable};
use platform::rig::Rig;
use platform::sensor::format;
use tungstenite::client::IntoClientRequest;
use tungstenite::http::{HeaderValue, StatusCode};
use tungstenite::{Error, Message, WebSocket};

/// Longest wait for a message.
const PATIENCE: Duration = Duration::from_secs(60);
/// Operation codes of a call and of its response in the Foxglove protocol.
const CALL: u8 = 2;
const RESPONSE: u8 = 3;

/// A running node with the feed.
struct Node {
    child: Child,
    output: BufReader<ChildStdout>,
    address: String,
}

impl Node {
    fn start(arguments: &[&str]) -> Self {
        let mut command = Command::new(env!("CARGO_BIN_EXE_ros2-node"));
        command.args(arguments).arg("--foxglove=127.0.0.1:0");
        let mut child = command.stdout(Stdio::piped()).stderr(Stdio::null()).spawn().expect("starts");
        let output = BufReader::new(child.stdout.take().expect("piped"));
        let mut node = Self { child, output, address: String::new() };
        node.address = node.line();
        assert!(node.address.starts_with("ws://127.0.0.1:"), "{}", node.address);
        node
    }

    fn line(&mut self) -> String {
        let mut line = String::new();
        self.output.read_line(&mut line).expect("text");
        line.trim().to_owned()
    }

    /// A connection that states this origin.
    fn connect(&self, origin: Option<&str>) -> Result<WebSocket<TcpStream>, Error> {
        let mut request = self.address.as_str().into_client_request().expect("an address");
        let fields = request.headers_mut();
        fields.insert("Sec-WebSocket-Protocol", HeaderValue::from_static("foxglove.sdk.v1"));
        if let Some(origin) = origin {
            fields.insert("Origin", HeaderValue::from_str(origin).expect("a header"));
        }
        let stream = TcpStream::connect(self.address.trim_start_matches("ws://")).expect("listens");
        stream.set_read_timeout(Some(PATIENCE)).expect("set");
        match tungstenite::client(request, stream) {
            Ok((socket, _)) => Ok(socket),
            Err(tungstenite::HandshakeError::Failure(error)) => Err(error),
            Err(tungstenite::HandshakeError::Interrupted(_)) => panic!("the handshake took too long"),
        }
    }
}

impl Drop for Node {
    fn drop(&mut self) {
        // It may have ended already.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// The emulated rig and a node on it, with the token that it printed.
fn platform() -> (Emulation, Node, String) {
    let (rig, table) = (Arc::new(Rig::built_in()), Arc::new(RigTable::built_in()));
    let emulated = Emulated { rig, table, format: format("hex").expect("registered"), seed: 1 };
    let emulation = Emulation::start(&emulated).expect("ports");
    let [printer, sensor] = [&emulation.printer, &emulation.sensor].map(|port| port.to_str().expect("text"));
    let mut node = Node::start(&["run", "--printer", printer, "--sensor", sensor, "--speed", "15000"]);
    let token = node.line().strip_prefix("token ").expect("a token").to_owned();
    assert_eq!(node.line(), "ready");
    (emulation, node, token)
}

/// Number of a service.
fn service(socket: &mut WebSocket<TcpStream>, name: &str) -> u32 {
    loop {
        let Message::Text(text) = socket.read().expect("a message") else { continue };
        let message: serde_json::Value = serde_json::from_str(&text).expect("JSON");
        let services = message["services"].as_array().into_iter().flatten();
        if let Some(found) = services.clone().find(|service| service["name"] == name) {
            return u32::try_from(found["id"].as_u64().expect("a number")).expect("small");
        }
    }
}

/// Calls a service.
fn call(socket: &mut WebSocket<TcpStream>, service: u32, number: u32, payload: &[u8]) {
    let mut bytes = vec![CALL];
    for word in [service, number, 3] {
        bytes.extend(word.to_le_bytes());
    }
    bytes.extend(b"cdr");
    bytes.extend(payload);
    socket.send(Message::binary(bytes)).expect("sent");
}

/// Response to a call, or the reason of its failure.
fn response(socket: &mut WebSocket<TcpStream>, number: u32) -> Result<Vec<u8>, String> {
    loop {
        match socket.read().expect("a message") {
            Message::Binary(bytes) if bytes[0] == RESPONSE && bytes[5..9] == number.to_le_bytes() => {
                return Ok(bytes[16..].to_vec());
            }
            Message::Text(text) => {
                let message: serde_json::Value = serde_json::from_str(&text).expect("JSON");
                if message["op"] == "serviceCallFailure" && message["callId"] == number {
                    return Err(message["message"].as_str().expect("text").to_owned());
                }
            }
            _ => {}
        }
    }
}

/// Request of the routine: pushes of `x_mm` at two places.
fn request(x_mm: f32, pause_s: u32, token: &str) -> Vec<u8> {
    let mut bytes = vec![0, 1, 0, 0];
    bytes.extend([x_mm, 20.0].iter().flat_map(|value| value.to_le_bytes()));
    bytes.extend([0, 1, pause_s, token.len() as u32 + 1].iter().flat_map(|value| value.to_le_bytes()));
    bytes.extend(token.as_bytes());
    bytes.push(0);
    bytes
}

#[test]
fn robust_a_page_of_another_origin_is_refused() {
    let folder = tempfile::tempdir().expect("a folder");
    let recording = folder.path().join("recording");
    let mut writer = bag::Writer::create(&recording).expect("a recording");
    let message = bag::messages::Float64 { data: 1.0 };
    bag::Publisher::write(&mut writer, "/truth/arc_m", 0, &message).expect("kept");
    writer.finish().expect("written");
    let recording = recording.to_str().expect("text");
    let play = ["play", recording, "--wait-for", "/truth/arc_m"];
    let refused = |node: &Node, origin: &str| match node.connect(Some(origin)) {
        Err(Error::Http(response)) => response.status() == StatusCode::FORBIDDEN,
        Err(error) => panic!("{origin}: {error}"),
        Ok(_) => false,
    };
    let node = Node::start(&play);
    for origin in ["https://evil.example", "null", "http://127.0.0.1:8765", "https://app.foxglove.dev.evil.example"] {
        assert!(refused(&node, origin), "{origin}");
    }
    for origin in [None, Some("https://app.foxglove.dev")] {
        node.connect(origin).expect("allowed");
    }
    let node = Node::start(&[&play[..], &["--allow-origin", "http://localhost:8080"]].concat());
    assert!(refused(&node, "https://app.foxglove.dev") && !refused(&node, "http://localhost:8080"));
}

#[test]
fn robust_another_machine_is_not_served_unless_it_is_allowed_by_name() {
    let run = ["run", "--printer", "/dev/none", "--sensor", "/dev/none", "--foxglove=0.0.0.0:0"];
    let output = Command::new(env!("CARGO_BIN_EXE_ros2-node")).args(run).output().expect("starts");
    let stderr = String::from_utf8(output.stderr).expect("text");
    assert!(!output.status.success() && stderr.contains("--allow-remote"), "{stderr}");
    let output =
        Command::new(env!("CARGO_BIN_EXE_ros2-node")).args(run).arg("--allow-remote").output().expect("starts");
    let stderr = String::from_utf8(output.stderr).expect("text");
    assert!(stderr.contains("/dev/none: cannot be opened"), "{stderr}");
}

#[test]
fn robust_the_printer_moves_for_the_token_and_stops_for_everyone() {
    let (_emulation, mut node, token) = platform();
    let mut socket = node.connect(None).expect("allowed");
    let routine = service(&mut socket, "/increments_beam_test");
    for (number, (payload, words)) in (1..).zip([
        (request(6.0, 0, ""), "token: found another one"),
        (request(6.0, 0, &"0".repeat(token.len())), "token: found another one"),
        (request(103.0, 0, &token), "the largest push at"),
        (request(6.0, 61, &token), "pause: found 61 s, expected 0 to 60 s"),
        (request(6.0, 0, &token)[..20].to_vec(), "expected a whisker_interfaces/srv/IncrementsBeamTest_Request"),
    ]) {
        call(&mut socket, routine, number, &payload);
        let refusal = response(&mut socket, number).expect_err("refused");
        assert!(refusal.contains(words), "{words}: {refusal}");
    }
    call(&mut socket, routine, 10, &request(6.0, 0, &token));
    assert_eq!(response(&mut socket, 10).expect("done"), [0, 1, 0, 0, 0]);

    // While a routine runs, a bounded number of calls waits.
    for number in 20..28 {
        call(&mut socket, routine, number, &request(6.0, 60, &token));
    }
    assert!(response(&mut socket, 27).expect_err("refused").contains("found 4 calls that wait"));
    // A stop, from a client without the token, ends the move and the program.
    let mut other = node.connect(None).expect("allowed");
    let stop = service(&mut other, "/stop");
    let begun = Instant::now();
    call(&mut other, stop, 1, &[0, 1, 0, 0, 0]);
    let stopped = response(&mut other, 1).expect("done");
    assert_eq!(stopped[4], 1, "success");
    assert!(response(&mut socket, 20).expect_err("stopped").contains("the printer was stopped at once"));
    assert!(node.child.wait().is_ok() && begun.elapsed() < Duration::from_secs(10));
}
