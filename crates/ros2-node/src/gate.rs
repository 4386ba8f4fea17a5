//! Gate in front of the WebSocket server: the check of a connection's origin.
//!
//! A browser lets every web page open a WebSocket to this machine and states the page's origin in the handshake (RFC
//! 6455, 10.2). The gate reads the head of the handshake, refuses origins that are not in its list, and forwards all
//! other connections, byte for byte, to the server. Programs other than browsers state no origin and are forwarded.
//!
//! The server listens on a loopback address that is chosen at random for each run, on Linux out of 127.0.0.0/8, so that
//! no web page finds it by trying.

use std::collections::HashSet;
use std::io::{self, Read, Write};
use std::net::{Ipv4Addr, Shutdown, SocketAddr, TcpListener, TcpStream};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread;
use std::time::{Duration, Instant};

use anyhow::Context;

/// Longest head of a handshake in bytes.
const LONGEST_HEAD: usize = 16 << 10;
/// Largest number of header fields of a handshake.
const MOST_FIELDS: usize = 64;
/// Longest time for a handshake.
const PATIENCE: Duration = Duration::from_secs(5);
/// Largest number of connections at a time.
const MOST_CONNECTIONS: usize = 32;
/// Largest number of refused origins that are reported.
const MOST_REPORTED: usize = 16;

/// Rules of the gate and its state.
struct Gate {
    server: SocketAddr,
    origins: Vec<String>,
    connections: AtomicUsize,
    reported: Mutex<HashSet<String>>,
}

/// Random loopback address for the server.
pub(crate) fn hidden_address() -> anyhow::Result<Ipv4Addr> {
    if !cfg!(target_os = "linux") {
        return Ok(Ipv4Addr::LOCALHOST);
    }
    let mut bytes = [0; 3];
    getrandom::fill(&mut bytes).context("random numbers of the system")?;
    let [a, b, c] = bytes;
    // Not the network's own address, nor its broadcast address.
    Ok(Ipv4Addr::new(127, a, b, c.clamp(1, 254)))
}

/// Listens on an address and forwards connections of these origins, and without an origin, to the server. Returns the
/// address with the port.
pub(crate) fn open(address: SocketAddr, origins: Vec<String>, server: SocketAddr) -> anyhow::Result<SocketAddr> {
    let listener = TcpListener::bind(address).with_context(|| address.to_string())?;
    let at = listener.local_addr()?;
    let gate = Arc::new(Gate { server, origins, connections: AtomicUsize::new(0), reported: Mutex::default() });
    let accepts = move || {
        for stream in listener.incoming().flatten() {
            let Some(connection) = Connection::of(&gate) else { continue };
            let forwards = move || {
                // A connection that breaks off concerns its client alone.
                let _ = connection.pass(stream);
            };
            if let Err(error) = thread::Builder::new().name("connection".into()).spawn(forwards) {
                eprintln!("error: thread of a connection: {error}");
            }
        }
    };
    thread::Builder::new().name("gate".into()).spawn(accepts).context("thread of the gate")?;
    Ok(at)
}

/// One of the connections at a time; counted until it is dropped, also if its thread cannot be started or panics.
struct Connection(Arc<Gate>);

impl Connection {
    /// `None` if there are [`MOST_CONNECTIONS`].
    fn of(gate: &Arc<Gate>) -> Option<Self> {
        let connection = Self(gate.clone());
        (gate.connections.fetch_add(1, Ordering::Relaxed) < MOST_CONNECTIONS).then_some(connection)
    }

    /// Checks the handshake of the client and forwards the connection, see [`Gate::pass`].
    fn pass(self, client: TcpStream) -> io::Result<()> {
        self.0.pass(client)
    }
}

impl Drop for Connection {
    fn drop(&mut self) {
        self.0.connections.fetch_sub(1, Ordering::Relaxed);
    }
}

impl Gate {
    /// Checks the handshake of a client and forwards the connection until one of the two ends.
    fn pass(&self, mut client: TcpStream) -> io::Result<()> {
        let head = read_head(&mut client)?;
        if let Err(refusal) = self.check(&head) {
            let length = refusal.len();
            write!(
                client,
                "HTTP/1.1 403 Forbidden\r\nContent-Type: text/plain; charset=utf-8\r\nContent-Length: {length}\r\nConnection: close\r\n\r\n{refusal}"
            )?;
            return client.shutdown(Shutdown::Both);
        }
        client.set_read_timeout(None)?;
        let mut server = TcpStream::connect_timeout(&self.server, PATIENCE)?;
        for stream in [&client, &server] {
            stream.set_nodelay(true)?;
        }
        server.write_all(&head)?;
        let (from_client, to_server) = (client.try_clone()?, server.try_clone()?);
        thread::scope(|scope| {
            scope.spawn(|| copy(from_client, to_server));
            copy(server, client);
        });
        Ok(())
    }

    /// Checks the origin of a handshake. The error is the answer to the client.
    fn check(&self, head: &[u8]) -> Result<(), String> {
        let mut fields = [httparse::EMPTY_HEADER; MOST_FIELDS];
        let mut request = httparse::Request::new(&mut fields);
        match request.parse(head) {
            Ok(httparse::Status::Complete(_)) => {}
            _ => return Err("found no handshake of a WebSocket\n".into()),
        }
        for field in request.headers.iter().filter(|field| field.name.eq_ignore_ascii_case("origin")) {
            let origin = String::from_utf8_lossy(field.value).escape_debug().to_string();
            if !self.origins.contains(&origin) {
                self.report(&origin);
                return Err(format!("found the origin {origin}, expected one that the program was started to allow\n"));
            }
        }
        Ok(())
    }

    /// Reports a refused origin once.
    fn report(&self, origin: &str) {
        let mut reported = self.reported.lock().unwrap_or_else(PoisonError::into_inner);
        if reported.len() < MOST_REPORTED && reported.insert(origin.into()) {
            eprintln!("refused a connection of the origin {origin}; `--allow-origin {origin}` allows it");
        }
    }
}

/// Head of a request: the bytes up to the first empty line, and those that arrived with them.
fn read_head(client: &mut TcpStream) -> io::Result<Vec<u8>> {
    let (begun, mut head, mut bytes) = (Instant::now(), Vec::new(), [0; 1024]);
    while !head.windows(4).any(|end| end == b"\r\n\r\n") {
        let left = PATIENCE.checked_sub(begun.elapsed()).filter(|left| !left.is_zero());
        if head.len() > LONGEST_HEAD {
            return Err(io::ErrorKind::InvalidData.into());
        }
        client.set_read_timeout(Some(left.ok_or(io::ErrorKind::TimedOut)?))?;
        match client.read(&mut bytes)? {
            0 => return Err(io::ErrorKind::UnexpectedEof.into()),
            count => head.extend_from_slice(&bytes[..count]),
        }
    }
    Ok(head)
}

/// Copies until the source ends, then closes both.
fn copy(mut source: TcpStream, mut sink: TcpStream) {
    // Either end may close at any time.
    let _ = io::copy(&mut source, &mut sink);
    for stream in [&source, &sink] {
        let _ = stream.shutdown(Shutdown::Both);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn robust_a_connection_is_counted_until_it_is_dropped_or_its_thread_panics() {
        let server = SocketAddr::from((Ipv4Addr::LOCALHOST, 1));
        let gate = Gate { server, origins: Vec::new(), connections: AtomicUsize::new(0), reported: Mutex::default() };
        let gate = Arc::new(gate);
        let all: Vec<Connection> = (0..MOST_CONNECTIONS).filter_map(|_| Connection::of(&gate)).collect();
        assert_eq!(all.len(), MOST_CONNECTIONS);
        assert!((0..3).all(|_| Connection::of(&gate).is_none()));
        drop(all);
        for _ in 0..2 * MOST_CONNECTIONS {
            let connection = Connection::of(&gate).expect("a free one");
            let panics = thread::spawn(move || {
                let _connection = connection;
                std::panic::resume_unwind(Box::new(()));
            });
            assert!(panics.join().is_err());
        }
        assert_eq!(gate.connections.load(Ordering::Relaxed), 0);
    }
}
