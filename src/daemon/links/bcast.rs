//! `udpbcast`: a broadcast address or a multicast group, where everyone hears everyone.
//!
//! One socket listens at the port of the group, which it shares with other programs; another speaks from a free port,
//! and hears the answers of those who reply to it alone. What we say comes back by the first, and is known by the port
//! that it was sent from.

use super::backoff::Backoff;
use super::health::Health;
use super::sockets::{DATAGRAM, Drained, bind, drain, overruns, resolve};
use crate::daemon::clock::unix_us;
use crate::daemon::inlet::Inlet;
use crate::daemon::status::Traffic;
use crate::wire::datagram;
use std::collections::HashMap;
use std::io;
use std::net::{IpAddr, Ipv4Addr, Ipv6Addr, SocketAddr};
use std::sync::{Arc, PoisonError, RwLock};
use tokio::net::UdpSocket;
use tokio_util::sync::CancellationToken;

/// Addresses of which it is remembered whether they are ours.
const MOST_ADDRESSES: usize = 256;

/// A link to a group of hosts.
#[derive(Debug)]
pub(in crate::daemon) struct BcastLink {
    host: String,
    port: u16,
    sockets: RwLock<Option<Arc<Sockets>>>,
    pub(super) traffic: Traffic,
    pub(super) health: Health,
}

#[derive(Debug)]
struct Sockets {
    group: SocketAddr,
    listening: UdpSocket,
    speaking: UdpSocket,
    speaking_port: u16,
}

impl BcastLink {
    pub(super) fn new(name: String, host: &str, port: u16) -> Self {
        let (traffic, health) = (Traffic::default(), Health::new(name));
        Self { host: host.to_owned(), port, sockets: RwLock::default(), traffic, health }
    }

    async fn open(&self) -> io::Result<Arc<Sockets>> {
        let group = resolve(&self.host, self.port).await?;
        let any = match group {
            SocketAddr::V4(_) => IpAddr::V4(Ipv4Addr::UNSPECIFIED),
            SocketAddr::V6(_) => IpAddr::V6(Ipv6Addr::UNSPECIFIED),
        };
        let listening = bind(SocketAddr::new(any, self.port), true).await?;
        match group.ip() {
            IpAddr::V4(ip) if ip.is_multicast() => listening.join_multicast_v4(ip, Ipv4Addr::UNSPECIFIED)?,
            IpAddr::V6(ip) if ip.is_multicast() => listening.join_multicast_v6(&ip, 0)?,
            _ => {}
        }
        let speaking = bind(SocketAddr::new(any, 0), false).await?;
        let speaking_port = speaking.local_addr()?.port();
        Ok(Arc::new(Sockets { group, listening, speaking, speaking_port }))
    }

    fn set_sockets(&self, sockets: Option<Arc<Sockets>>) {
        *self.sockets.write().unwrap_or_else(PoisonError::into_inner) = sockets;
    }

    /// Datagrams that the kernel dropped because we were too slow, since the link came up.
    pub(super) fn overruns(&self) -> u64 {
        let sockets = self.sockets.read().unwrap_or_else(PoisonError::into_inner);
        let both = sockets.as_ref().map(|s| [overruns(&s.listening), overruns(&s.speaking)]);
        both.into_iter().flatten().flatten().sum()
    }

    pub(super) fn send(&self, bytes: &[u8]) {
        let sockets = self.sockets.read().unwrap_or_else(PoisonError::into_inner);
        let Some(sockets) = sockets.as_deref() else { return self.traffic.dropped(1) };
        match sockets.speaking.try_send_to(bytes, sockets.group) {
            Ok(_) => {
                self.traffic.sent(1, bytes.len());
                self.health.can_send();
            }
            Err(error) => {
                self.traffic.dropped(1);
                if error.kind() != io::ErrorKind::WouldBlock {
                    self.health.cannot_send(&error);
                }
            }
        }
    }

    /// Receives until `stop`.
    pub(super) async fn run(self: Arc<Self>, mut inlet: Inlet, stop: CancellationToken) {
        let (mut backoff, mut buffer) = (Backoff::new(), vec![0; DATAGRAM]);
        loop {
            let error = match self.open().await {
                Ok(sockets) => {
                    self.set_sockets(Some(Arc::clone(&sockets)));
                    self.health.up();
                    inlet.open(None);
                    let served = self.serve(&sockets, &mut buffer, &mut inlet, &stop, &mut backoff).await;
                    inlet.close(None);
                    self.set_sockets(None);
                    match served {
                        Ok(()) => return,
                        Err(error) => error,
                    }
                }
                Err(error) => error,
            };
            self.health.down(&error);
            if !backoff.wait(&stop).await {
                return;
            }
        }
    }

    async fn serve(
        &self,
        sockets: &Sockets,
        buffer: &mut [u8],
        inlet: &mut Inlet,
        stop: &CancellationToken,
        backoff: &mut Backoff,
    ) -> io::Result<()> {
        let mut ours = OurAddresses::default();
        loop {
            let socket = tokio::select! {
                biased;
                () = stop.cancelled() => return Ok(()),
                ready = sockets.speaking.readable() => ready.map(|()| &sockets.speaking)?,
                ready = sockets.listening.readable() => ready.map(|()| &sockets.listening)?,
            };
            let now_us = unix_us();
            let drained = drain(socket, buffer, |bytes, from| {
                if from.port() == sockets.speaking_port && ours.contains(from.ip()) {
                    return;
                }
                datagram(bytes).for_each(|event| inlet.take(event, None, now_us));
            });
            match drained {
                Drained::Fine => backoff.reset(),
                Drained::Broken(error) => return Err(error),
            }
            tokio::task::consume_budget().await;
        }
    }
}

/// Which addresses belong to this machine: those that can be bound.
#[derive(Debug, Default)]
struct OurAddresses(HashMap<IpAddr, bool>);

impl OurAddresses {
    fn contains(&mut self, ip: IpAddr) -> bool {
        if self.0.len() >= MOST_ADDRESSES {
            self.0.clear();
        }
        *self.0.entry(ip).or_insert_with(|| std::net::UdpSocket::bind((ip, 0)).is_ok())
    }
}
