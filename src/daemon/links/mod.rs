//! Links: one file for each transport, and what they share.
//!
//! In: bytes of a socket, a device or a log. Out: events into an [`Inlet`](super::inlet::Inlet). The other way round a
//! link is an [`Outlet`]: sending to it never waits. What is absent at the start, is unplugged, resets or changes its
//! address is tried again with growing pauses ([`backoff`]); no link waits for another.

mod backoff;
mod bcast;
mod health;
mod outbox;
mod peers;
mod serial;
mod sockets;
mod stream;
mod tcp;
mod tlog;
mod udp;

pub(super) use health::Health;

use super::DaemonError;
use super::inlet::Inlet;
use super::status::Traffic;
use crate::config::{Link, LinkUrl};
use crate::routing::PeerId;
use bcast::BcastLink;
use serial::SerialLink;
use std::net::SocketAddr;
use std::sync::Arc;
use tcp::{TcpClient, TcpServer};
use tlog::LogLink;
use tokio_util::sync::CancellationToken;
use udp::UdpLink;

/// A link that is prepared: ports are bound and files open, where that can be done now.
#[derive(Debug)]
pub(super) enum Bound {
    Udp(Arc<UdpLink>),
    Bcast(Arc<BcastLink>),
    TcpServer(Arc<TcpServer>),
    TcpClient(Arc<TcpClient>),
    Serial(Arc<SerialLink>),
    Log(LogLink),
}

/// The sending side of a link. Sending never waits: see the table in [`super`].
#[derive(Debug, Clone)]
pub(super) enum Outlet {
    Udp(Arc<UdpLink>),
    Bcast(Arc<BcastLink>),
    TcpServer(Arc<TcpServer>),
    TcpClient(Arc<TcpClient>),
    Serial(Arc<SerialLink>),
    /// A log takes nothing.
    Log,
}

impl Bound {
    /// Prepares a link.
    ///
    /// # Errors
    /// A port that another program holds, or a log that cannot be read: what waiting would not mend. Everything else
    /// that is missing is waited for once the link runs.
    pub(super) async fn bind(link: &Link) -> Result<Self, DaemonError> {
        let name = link.name.clone();
        Ok(match &link.url {
            LinkUrl::UdpIn { host, port } => Self::Udp(Arc::new(UdpLink::listen(name, host, *port).await?)),
            LinkUrl::UdpOut { host, port } => Self::Udp(Arc::new(UdpLink::speak_to(name, host, *port).await?)),
            LinkUrl::UdpBcast { host, port } => Self::Bcast(Arc::new(BcastLink::new(name, host, *port))),
            LinkUrl::TcpIn { host, port } => Self::TcpServer(Arc::new(TcpServer::listen(name, host, *port).await?)),
            LinkUrl::TcpOut { host, port } => Self::TcpClient(Arc::new(TcpClient::new(name, host, *port))),
            LinkUrl::Serial { device, baud, flow } => {
                Self::Serial(Arc::new(SerialLink::new(name, device.clone(), *baud, *flow)))
            }
            LinkUrl::Tlog { path, pace } => Self::Log(LogLink::open(name, path, *pace)?),
        })
    }

    pub(super) fn outlet(&self) -> Outlet {
        match self {
            Self::Udp(link) => Outlet::Udp(Arc::clone(link)),
            Self::Bcast(link) => Outlet::Bcast(Arc::clone(link)),
            Self::TcpServer(link) => Outlet::TcpServer(Arc::clone(link)),
            Self::TcpClient(link) => Outlet::TcpClient(Arc::clone(link)),
            Self::Serial(link) => Outlet::Serial(Arc::clone(link)),
            Self::Log(_) => Outlet::Log,
        }
    }

    pub(super) fn local_addr(&self) -> Option<SocketAddr> {
        match self {
            Self::Udp(link) => link.local_addr(),
            Self::TcpServer(link) => link.local_addr(),
            Self::Bcast(_) | Self::TcpClient(_) | Self::Serial(_) | Self::Log(_) => None,
        }
    }

    /// Whether frames may go to it before it has heard anything.
    pub(super) fn is_open(&self) -> bool {
        matches!(self, Self::Udp(link) if link.speaks_to_one())
    }

    /// Runs until `stop`; a log also ends by itself.
    ///
    /// # Errors
    /// What the link cannot recover from.
    pub(super) async fn run(self, inlet: Inlet, stop: CancellationToken) -> Result<(), String> {
        match self {
            Self::Udp(link) => link.run(inlet, stop).await,
            Self::Bcast(link) => link.run(inlet, stop).await,
            Self::TcpServer(link) => link.run(inlet, stop).await,
            Self::TcpClient(link) => link.run(inlet, stop).await,
            Self::Serial(link) => link.run(inlet, stop).await,
            Self::Log(log) => return log.play(inlet, stop).await.map_err(|e| e.to_string()),
        }
        Ok(())
    }
}

impl Outlet {
    /// Sends a frame to one peer, or to all of a link that has no peers to tell apart.
    pub(super) fn send(&self, frame: &[u8], peer: Option<PeerId>) {
        match self {
            Self::Udp(link) => link.send(frame, peer),
            Self::Bcast(link) => link.send(frame),
            Self::TcpServer(link) => link.outboxes.send(frame, peer),
            Self::TcpClient(link) => link.outboxes.send(frame, peer),
            Self::Serial(link) => link.outboxes.send(frame, peer),
            Self::Log => {}
        }
    }

    pub(super) fn traffic(&self) -> Option<&Traffic> {
        match self {
            Self::Udp(link) => Some(&link.traffic),
            Self::Bcast(link) => Some(&link.traffic),
            Self::TcpServer(link) => Some(&link.outboxes.traffic),
            Self::TcpClient(link) => Some(&link.outboxes.traffic),
            Self::Serial(link) => Some(&link.outboxes.traffic),
            Self::Log => None,
        }
    }

    pub(super) fn health(&self) -> Option<&Health> {
        match self {
            Self::Udp(link) => Some(&link.health),
            Self::Bcast(link) => Some(&link.health),
            Self::TcpServer(link) => Some(&link.health),
            Self::TcpClient(link) => Some(&link.health),
            Self::Serial(link) => Some(&link.health),
            Self::Log => None,
        }
    }

    /// Datagrams that the kernel dropped because we were too slow. Streams make their sender wait instead.
    pub(super) fn overruns(&self) -> u64 {
        match self {
            Self::Udp(link) => link.overruns(),
            Self::Bcast(link) => link.overruns(),
            Self::TcpServer(_) | Self::TcpClient(_) | Self::Serial(_) | Self::Log => 0,
        }
    }

    /// How many peers a frame for everyone goes to.
    pub(super) fn peer_count(&self) -> usize {
        match self {
            Self::Udp(link) => link.peer_count(),
            Self::Bcast(link) => usize::from(link.health.is_up()),
            Self::TcpServer(link) => link.outboxes.count(),
            Self::TcpClient(link) => link.outboxes.count(),
            Self::Serial(link) => link.outboxes.count(),
            Self::Log => 0,
        }
    }
}
