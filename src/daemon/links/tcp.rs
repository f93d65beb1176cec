//! TCP: `tcpin` serves every client, `tcpout` connects again and again.

use super::backoff::Backoff;
use super::health::Health;
use super::outbox::Outboxes;
use super::sockets::resolve;
use super::stream::{Ends, Pumped, pump};
use crate::daemon::DaemonError;
use crate::daemon::inlet::Inlet;
use crate::daemon::lock::lock;
use socket2::{SockRef, TcpKeepalive};
use std::io;
use std::net::SocketAddr;
use std::sync::{Arc, Mutex};
use std::time::Duration;
use tokio::net::{TcpListener, TcpStream};
use tokio::task::JoinSet;
use tokio::time::timeout;
use tokio_util::sync::CancellationToken;
use tracing::{debug, info, warn};

/// Bytes that wait for one connection beside the kernel's buffer: a second or more of a busy vehicle.
const OUTBOX: usize = 256 * 1024;
const CONNECT_WITHIN: Duration = Duration::from_secs(5);
/// A connection whose other side vanished is found dead after about this long.
const DEAD_AFTER: Duration = Duration::from_secs(15);

/// Listens on a port.
#[derive(Debug)]
pub(in crate::daemon) struct TcpServer {
    host: String,
    port: u16,
    /// Bound, but not yet taken by [`Self::run`].
    listener: Mutex<Option<TcpListener>>,
    address: Mutex<Option<SocketAddr>>,
    pub(super) outboxes: Outboxes,
    pub(super) health: Health,
}

impl TcpServer {
    /// Binds `host:port`.
    pub(super) async fn listen(name: String, host: &str, port: u16) -> Result<Self, DaemonError> {
        let server = Self {
            host: host.to_owned(),
            port,
            listener: Mutex::default(),
            address: Mutex::default(),
            outboxes: Outboxes::new(OUTBOX),
            health: Health::new(name),
        };
        match server.bind().await {
            Ok(listener) => {
                *lock(&server.listener) = Some(listener);
                Ok(server)
            }
            Err(error) if error.kind() == io::ErrorKind::AddrInUse => {
                Err(DaemonError::PortInUse { link: server.health.name().to_owned() })
            }
            Err(error) => {
                server.health.down(&error);
                Ok(server)
            }
        }
    }

    async fn bind(&self) -> io::Result<TcpListener> {
        let listener = TcpListener::bind(resolve(&self.host, self.port).await?).await?;
        *lock(&self.address) = listener.local_addr().ok();
        self.health.up();
        Ok(listener)
    }

    pub(super) fn local_addr(&self) -> Option<SocketAddr> {
        *lock(&self.address)
    }

    /// Serves clients until `stop`.
    pub(super) async fn run(self: Arc<Self>, inlet: Inlet, stop: CancellationToken) {
        let mut backoff = Backoff::new();
        let mut clients = JoinSet::new();
        loop {
            let bound = lock(&self.listener).take();
            let listener = match bound {
                Some(listener) => Ok(listener),
                None => self.bind().await,
            };
            let error = match listener {
                Ok(listener) => match self.accept(&listener, &inlet, &stop, &mut clients, &mut backoff).await {
                    Ok(()) => break,
                    Err(error) => error,
                },
                Err(error) => error,
            };
            self.health.down(&error);
            if !backoff.wait(&stop).await {
                break;
            }
        }
        // they stop by the same token
        while clients.join_next().await.is_some() {}
    }

    async fn accept(
        self: &Arc<Self>,
        listener: &TcpListener,
        inlet: &Inlet,
        stop: &CancellationToken,
        clients: &mut JoinSet<()>,
        backoff: &mut Backoff,
    ) -> io::Result<()> {
        loop {
            let (stream, peer) = tokio::select! {
                () = stop.cancelled() => return Ok(()),
                Some(ended) = clients.join_next() => {
                    if let Err(error) = ended {
                        warn!(link = self.health.name(), "a client's task was stopped by a defect: {error}");
                    }
                    continue;
                }
                accepted = listener.accept() => match accepted {
                    Ok(accepted) => accepted,
                    // the client has gone again before it was served
                    Err(error) if error.kind() == io::ErrorKind::ConnectionAborted => continue,
                    Err(error) => return Err(error),
                },
            };
            backoff.reset();
            let (server, inlet, stop) = (Arc::clone(self), inlet.clone(), stop.clone());
            clients.spawn(async move { server.serve(stream, peer, inlet, stop).await });
        }
    }

    async fn serve(&self, stream: TcpStream, address: SocketAddr, mut inlet: Inlet, stop: CancellationToken) {
        let Some((peer, outbox)) = self.outboxes.open() else {
            self.outboxes.traffic.stranger();
            return;
        };
        info!(link = self.health.name(), peer = %address, "connected");
        prepare(&stream);
        inlet.open(Some(peer));
        let ends = Ends { inlet: &mut inlet, peer: Some(peer), outbox: &outbox, traffic: &self.outboxes.traffic };
        let ended = pump(stream, ends, &stop).await;
        inlet.close(Some(peer));
        self.outboxes.close(peer);
        match ended {
            Ok(_) => info!(link = self.health.name(), peer = %address, "disconnected"),
            Err(error) => info!(link = self.health.name(), peer = %address, "disconnected: {error}"),
        }
    }
}

/// Connects to a server.
#[derive(Debug)]
pub(in crate::daemon) struct TcpClient {
    host: String,
    port: u16,
    pub(super) outboxes: Outboxes,
    pub(super) health: Health,
}

impl TcpClient {
    pub(super) fn new(name: String, host: &str, port: u16) -> Self {
        Self { host: host.to_owned(), port, outboxes: Outboxes::new(OUTBOX), health: Health::new(name) }
    }

    /// Connects, and connects anew, until `stop`.
    pub(super) async fn run(self: Arc<Self>, mut inlet: Inlet, stop: CancellationToken) {
        let mut backoff = Backoff::new();
        loop {
            let connected = tokio::select! {
                () = stop.cancelled() => return,
                connected = self.connect() => connected,
            };
            match connected {
                Ok(stream) => match self.serve(stream, &mut inlet, &stop).await {
                    Ok(Pumped { stopped: true, .. }) => return,
                    Ok(Pumped { received, .. }) => {
                        if received {
                            backoff.reset();
                        }
                        self.health.down(&"the server closed the connection");
                    }
                    Err(error) => self.health.down(&error),
                },
                Err(error) => self.health.down(&error),
            }
            if !backoff.wait(&stop).await {
                return;
            }
        }
    }

    async fn connect(&self) -> io::Result<TcpStream> {
        let address = resolve(&self.host, self.port).await?;
        match timeout(CONNECT_WITHIN, TcpStream::connect(address)).await {
            Ok(connected) => connected,
            Err(_) => Err(io::Error::new(io::ErrorKind::TimedOut, "no answer to the connection request")),
        }
    }

    async fn serve(&self, stream: TcpStream, inlet: &mut Inlet, stop: &CancellationToken) -> io::Result<Pumped> {
        // there is one connection, so there is always a place
        let Some((peer, outbox)) = self.outboxes.open() else { return Err(io::ErrorKind::Other.into()) };
        prepare(&stream);
        self.health.up();
        inlet.open(None);
        let ends = Ends { inlet, peer: None, outbox: &outbox, traffic: &self.outboxes.traffic };
        let ended = pump(stream, ends, stop).await;
        inlet.close(None);
        self.outboxes.close(peer);
        ended
    }
}

/// Frames leave at once, and a peer that vanished is found out.
fn prepare(stream: &TcpStream) {
    let socket = SockRef::from(stream);
    let keepalive = TcpKeepalive::new().with_time(DEAD_AFTER / 3).with_interval(DEAD_AFTER / 3);
    let prepared = socket.set_tcp_nodelay(true).and_then(|()| socket.set_tcp_keepalive(&keepalive));
    #[cfg(any(target_os = "linux", target_os = "android"))]
    let prepared = prepared.and_then(|()| socket.set_tcp_user_timeout(Some(DEAD_AFTER)));
    if let Err(error) = prepared {
        debug!("a connection stays as the system made it: {error}");
    }
}
