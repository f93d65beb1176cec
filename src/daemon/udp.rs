//! UDP links: `udpin` answers whoever speaks to its port, `udpout` speaks to one address.

use super::DaemonError;
use super::clock::{Steady, unix_us};
use super::inlet::Inlet;
use super::peers::{Heard, Peers};
use super::router::Origin;
use super::status::Traffic;
use crate::wire::{Event, datagram};
use std::io;
use std::net::{IpAddr, Ipv4Addr, Ipv6Addr, SocketAddr};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;
use tokio::net::{UdpSocket, lookup_host};
use tokio::time::timeout;
use tokio_util::sync::CancellationToken;
use tracing::{debug, info, warn};

/// The longest datagram that UDP carries.
const DATAGRAM: usize = 65_536;
/// Datagrams taken in one go before other tasks of the runtime have their turn.
const BATCH: usize = 64;
/// When stopping, a link takes what has arrived, but no more than so many batches of a peer that never pauses.
const LAST_BATCHES: usize = 64;
const LAST_WAIT: Duration = Duration::from_millis(5);

/// A bound UDP socket and who is at its other end.
#[derive(Debug)]
pub(super) struct UdpLink {
    name: String,
    socket: UdpSocket,
    ends: Ends,
    steady: Steady,
    pub(super) traffic: Traffic,
    failing: AtomicBool,
}

#[derive(Debug)]
enum Ends {
    /// Whoever was heard.
    Heard(Peers),
    /// One address. Answers may come from another port of that host, or of any if it is a group of hosts.
    Fixed(SocketAddr),
}

impl UdpLink {
    /// Binds `host:port` and waits for peers.
    pub(super) async fn listen(name: String, host: &str, port: u16) -> Result<Self, DaemonError> {
        let address = resolve(&name, host, port).await?;
        Self::bind(name, address, Ends::Heard(Peers::default())).await
    }

    /// Sends to `host:port` from a free port.
    pub(super) async fn speak_to(name: String, host: &str, port: u16) -> Result<Self, DaemonError> {
        let target = resolve(&name, host, port).await?;
        let any = match target {
            SocketAddr::V4(_) => IpAddr::V4(Ipv4Addr::UNSPECIFIED),
            SocketAddr::V6(_) => IpAddr::V6(Ipv6Addr::UNSPECIFIED),
        };
        Self::bind(name, SocketAddr::new(any, 0), Ends::Fixed(target)).await
    }

    async fn bind(name: String, address: SocketAddr, ends: Ends) -> Result<Self, DaemonError> {
        let failed = |source: io::Error, link: String| match source.kind() {
            io::ErrorKind::AddrInUse => DaemonError::PortInUse { link },
            _ => DaemonError::Socket { link, source },
        };
        let socket = match UdpSocket::bind(address).await {
            Ok(socket) => socket,
            Err(source) => return Err(failed(source, name)),
        };
        // without this the kernel refuses broadcast targets; it changes nothing for others
        if let Err(source) = socket.set_broadcast(true) {
            return Err(failed(source, name));
        }
        // `try_send_to` needs to have seen the socket writable once
        if let Err(source) = socket.writable().await {
            return Err(failed(source, name));
        }
        let (steady, traffic) = (Steady::start(), Traffic::default());
        Ok(Self { name, socket, ends, steady, traffic, failing: AtomicBool::new(false) })
    }

    pub(super) fn name(&self) -> &str {
        &self.name
    }

    pub(super) fn local_addr(&self) -> Option<SocketAddr> {
        self.socket.local_addr().ok()
    }

    /// How many peers a frame for everyone goes to.
    pub(super) fn peer_count(&self) -> usize {
        match &self.ends {
            Ends::Fixed(_) => 1,
            Ends::Heard(peers) => {
                let mut count = 0;
                peers.for_each(self.steady.ms(), |_| count += 1);
                count
            }
        }
    }

    /// Sends to every peer but `except`.
    pub(super) fn send(&self, bytes: &[u8], except: Option<SocketAddr>) {
        match &self.ends {
            Ends::Fixed(target) => {
                if except.is_none() {
                    self.send_to(bytes, *target);
                }
            }
            Ends::Heard(peers) => peers.for_each(self.steady.ms(), |peer| {
                if Some(peer) != except {
                    self.send_to(bytes, peer);
                }
            }),
        }
    }

    /// Sends to one address, or drops and counts if the socket's buffer is full or the network refuses.
    pub(super) fn send_to(&self, bytes: &[u8], peer: SocketAddr) {
        match self.socket.try_send_to(bytes, peer) {
            Ok(_) => {
                self.traffic.sent(bytes.len());
                if self.failing.load(Ordering::Relaxed) && self.failing.swap(false, Ordering::Relaxed) {
                    info!(link = self.name, "sending works again");
                }
            }
            Err(error) => {
                self.traffic.dropped();
                if error.kind() != io::ErrorKind::WouldBlock && !self.failing.swap(true, Ordering::Relaxed) {
                    warn!(link = self.name, %peer, "cannot send: {error}");
                }
            }
        }
    }

    /// Receives until `stop`, or until the socket itself fails. What the socket holds by then is still taken.
    pub(super) async fn receive(self: Arc<Self>, mut inlet: Inlet, stop: CancellationToken) -> io::Result<()> {
        let mut buffer = vec![0; DATAGRAM];
        loop {
            tokio::select! {
                () = stop.cancelled() => break,
                ready = self.socket.readable() => ready?,
            }
            self.take(&mut buffer, &mut inlet);
            tokio::task::consume_budget().await;
        }
        for _ in 0..LAST_BATCHES {
            if !matches!(timeout(LAST_WAIT, self.socket.readable()).await, Ok(Ok(()))) {
                break;
            }
            self.take(&mut buffer, &mut inlet);
        }
        Ok(())
    }

    /// Takes at most a batch of the datagrams that are there.
    fn take(&self, buffer: &mut [u8], inlet: &mut Inlet) {
        for _ in 0..BATCH {
            match self.socket.try_recv_from(buffer) {
                Ok((length, peer)) => self.datagram(&buffer[..length], peer, inlet),
                Err(error) if error.kind() == io::ErrorKind::WouldBlock => return,
                // a peer's host said that nobody listens there: its affair
                Err(error) => return debug!(link = self.name, "receiving: {error}"),
            }
        }
    }

    fn datagram(&self, bytes: &[u8], peer: SocketAddr, inlet: &mut Inlet) {
        let now_us = unix_us();
        let origin = match &self.ends {
            Ends::Heard(_) => Origin { link: inlet.link(), peer: Some(peer) },
            Ends::Fixed(target) if answers(*target, peer) => Origin { link: inlet.link(), peer: None },
            Ends::Fixed(_) => return self.traffic.stranger(),
        };
        let mut known = false;
        for event in datagram(bytes) {
            if let (Event::Frame(_), Ends::Heard(peers), false) = (&event, &self.ends, known) {
                // whoever sends no MAVLink gets none
                known = true;
                match peers.heard(peer, self.steady.ms()) {
                    Heard::Known => {}
                    Heard::New => info!(link = self.name, %peer, "new peer"),
                    Heard::TooMany => return self.traffic.stranger(),
                }
            }
            inlet.take(event, origin, now_us);
        }
    }
}

/// Whether a datagram from `peer` may be the answer to one for `target`.
fn answers(target: SocketAddr, peer: SocketAddr) -> bool {
    let many = match target.ip() {
        IpAddr::V4(ip) => ip.is_multicast() || ip.octets()[3] == 255,
        IpAddr::V6(ip) => ip.is_multicast(),
    };
    many || target.ip() == peer.ip()
}

async fn resolve(link: &str, host: &str, port: u16) -> Result<SocketAddr, DaemonError> {
    let failed = |source| DaemonError::Resolve { link: link.to_owned(), source };
    let mut addresses = lookup_host((host, port)).await.map_err(failed)?;
    addresses.next().ok_or_else(|| failed(io::Error::from(io::ErrorKind::NotFound)))
}
