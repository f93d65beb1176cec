//! UDP links: `udpin` answers whoever speaks to its port, `udpout` speaks to one address.

use super::backoff::Backoff;
use super::health::Health;
use super::peers::{Heard, Peers};
use super::sockets::{DATAGRAM, Drained, bind, drain, overruns, resolve};
use crate::daemon::DaemonError;
use crate::daemon::clock::{Steady, unix_us};
use crate::daemon::inlet::Inlet;
use crate::daemon::status::Traffic;
use crate::routing::PeerId;
use crate::wire::{Event, datagram};
use std::io;
use std::net::{IpAddr, Ipv4Addr, Ipv6Addr, SocketAddr};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, PoisonError, RwLock};
use std::time::Duration;
use tokio::net::UdpSocket;
use tokio::time::{MissedTickBehavior, interval, timeout};
use tokio_util::sync::CancellationToken;
use tracing::info;

/// When stopping, a link takes what has arrived, but no more than so many batches of a peer that never pauses.
const LAST_BATCHES: usize = 64;
const LAST_WAIT: Duration = Duration::from_millis(5);
/// Time between two looks for peers that fell silent.
const SWEEP_EVERY: Duration = Duration::from_secs(1);
/// A host that was silent for this long may have another address by now: its name is asked again.
const ASK_NAME_AFTER_MS: u64 = 10_000;

/// A UDP socket, once it is bound, and who is at its other end.
#[derive(Debug)]
pub(in crate::daemon) struct UdpLink {
    host: String,
    port: u16,
    socket: RwLock<Option<Arc<Socket>>>,
    /// Who was heard; `None` on a link to one address.
    peers: Option<Peers>,
    steady: Steady,
    heard_ms: AtomicU64,
    /// Overruns of sockets that were closed since.
    earlier_overruns: AtomicU64,
    pub(super) traffic: Traffic,
    pub(super) health: Health,
}

#[derive(Debug)]
struct Socket {
    socket: UdpSocket,
    /// The one address that is spoken to. Answers may come from another port of that host.
    target: Option<SocketAddr>,
}

/// Why a socket is no longer served.
enum Ended {
    Stopped,
    Broken(io::Error),
    /// The host's name may lead elsewhere by now.
    AskName,
}

impl UdpLink {
    /// Binds `host:port` and waits for peers.
    pub(super) async fn listen(name: String, host: &str, port: u16) -> Result<Self, DaemonError> {
        Self::new(name, host, port, Some(Peers::default())).await
    }

    /// Sends to `host:port` from a free port.
    pub(super) async fn speak_to(name: String, host: &str, port: u16) -> Result<Self, DaemonError> {
        Self::new(name, host, port, None).await
    }

    async fn new(name: String, host: &str, port: u16, peers: Option<Peers>) -> Result<Self, DaemonError> {
        let link = Self {
            host: host.to_owned(),
            port,
            socket: RwLock::default(),
            peers,
            steady: Steady::start(),
            heard_ms: AtomicU64::new(0),
            earlier_overruns: AtomicU64::new(0),
            traffic: Traffic::default(),
            health: Health::new(name),
        };
        match link.open().await {
            Ok(_) => Ok(link),
            Err(error) if error.kind() == io::ErrorKind::AddrInUse => {
                Err(DaemonError::PortInUse { link: link.health.name().to_owned() })
            }
            Err(error) => {
                link.health.down(&error);
                Ok(link)
            }
        }
    }

    async fn open(&self) -> io::Result<Arc<Socket>> {
        let named = resolve(&self.host, self.port).await?;
        let (address, target) = match (&self.peers, named) {
            (Some(_), address) => (address, None),
            (None, SocketAddr::V4(_)) => (SocketAddr::new(IpAddr::V4(Ipv4Addr::UNSPECIFIED), 0), Some(named)),
            (None, SocketAddr::V6(_)) => (SocketAddr::new(IpAddr::V6(Ipv6Addr::UNSPECIFIED), 0), Some(named)),
        };
        let socket = Arc::new(Socket { socket: bind(address, false).await?, target });
        self.set_socket(Some(Arc::clone(&socket)));
        self.health.up();
        Ok(socket)
    }

    fn set_socket(&self, socket: Option<Arc<Socket>>) {
        if let Some(count) = self.socket().and_then(|before| overruns(&before.socket)) {
            self.earlier_overruns.fetch_add(count, Ordering::Relaxed);
        }
        *self.socket.write().unwrap_or_else(PoisonError::into_inner) = socket;
    }

    fn socket(&self) -> Option<Arc<Socket>> {
        self.socket.read().unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// Whether it needs to hear nobody first.
    pub(super) fn speaks_to_one(&self) -> bool {
        self.peers.is_none()
    }

    pub(super) fn local_addr(&self) -> Option<SocketAddr> {
        self.socket()?.socket.local_addr().ok()
    }

    /// Datagrams that the kernel dropped because we were too slow.
    pub(super) fn overruns(&self) -> u64 {
        let now = self.socket().and_then(|socket| overruns(&socket.socket)).unwrap_or(0);
        self.earlier_overruns.load(Ordering::Relaxed) + now
    }

    pub(super) fn peer_count(&self) -> usize {
        self.peers.as_ref().map_or(1, Peers::count)
    }

    /// Sends to one peer, or to everyone.
    pub(super) fn send(&self, bytes: &[u8], peer: Option<PeerId>) {
        let socket = self.socket.read().unwrap_or_else(PoisonError::into_inner);
        let Some(Socket { socket, target }) = socket.as_deref() else { return self.traffic.dropped(1) };
        match (&self.peers, peer, target) {
            (Some(peers), Some(peer), _) => match peers.address(peer) {
                Some(address) => self.send_to(socket, bytes, address),
                None => self.traffic.dropped(1),
            },
            (Some(peers), None, _) => peers.for_each(|address| self.send_to(socket, bytes, address)),
            (None, _, Some(target)) => self.send_to(socket, bytes, *target),
            (None, _, None) => {}
        }
    }

    /// Sends to one address, or drops and counts if the socket's buffer is full or the network refuses.
    fn send_to(&self, socket: &UdpSocket, bytes: &[u8], peer: SocketAddr) {
        match socket.try_send_to(bytes, peer) {
            Ok(_) => {
                self.traffic.sent(1, bytes.len());
                self.health.can_send();
            }
            Err(error) => {
                self.traffic.dropped(1);
                if error.kind() != io::ErrorKind::WouldBlock {
                    self.health.cannot_send(&format_args!("{peer}: {error}"));
                }
            }
        }
    }

    /// Receives until `stop`. What the socket holds by then is still taken.
    pub(super) async fn run(self: Arc<Self>, mut inlet: Inlet, stop: CancellationToken) {
        let mut backoff = Backoff::new();
        let mut buffer = vec![0; DATAGRAM];
        loop {
            let socket = match self.socket() {
                Some(socket) => Ok(socket),
                None => self.open().await,
            };
            let ended = match socket {
                Ok(socket) => self.serve(&socket, &mut buffer, &mut inlet, &stop, &mut backoff).await,
                Err(error) => Ended::Broken(error),
            };
            match ended {
                Ended::Stopped => return,
                Ended::Broken(error) => {
                    self.set_socket(None);
                    self.health.down(&error);
                    if !backoff.wait(&stop).await {
                        return;
                    }
                }
                Ended::AskName => self.ask_name().await,
            }
        }
    }

    async fn serve(
        &self,
        socket: &Socket,
        buffer: &mut [u8],
        inlet: &mut Inlet,
        stop: &CancellationToken,
        backoff: &mut Backoff,
    ) -> Ended {
        let mut sweep = interval(SWEEP_EVERY);
        sweep.set_missed_tick_behavior(MissedTickBehavior::Delay);
        // registered once, not for every wake-up
        let mut stopped = std::pin::pin!(stop.cancelled());
        loop {
            tokio::select! {
                // in this order, or a peer that never pauses would keep the others out
                biased;
                () = &mut stopped => break,
                _ = sweep.tick() => {
                    self.sweep(inlet);
                    if self.name_is_due(socket) {
                        return Ended::AskName;
                    }
                    continue;
                }
                ready = socket.socket.readable() => if let Err(error) = ready { return Ended::Broken(error) },
            }
            match self.take(socket, buffer, inlet) {
                Drained::Fine => backoff.reset(),
                Drained::Broken(error) => return Ended::Broken(error),
            }
            tokio::task::consume_budget().await;
        }
        for _ in 0..LAST_BATCHES {
            let ready = timeout(LAST_WAIT, socket.socket.readable()).await;
            if !matches!(ready, Ok(Ok(()))) || matches!(self.take(socket, buffer, inlet), Drained::Broken(_)) {
                break;
            }
        }
        Ended::Stopped
    }

    fn take(&self, socket: &Socket, buffer: &mut [u8], inlet: &mut Inlet) -> Drained {
        let now_us = unix_us();
        drain(&socket.socket, buffer, |bytes, from| self.datagram(socket.target, bytes, from, inlet, now_us))
    }

    fn datagram(&self, target: Option<SocketAddr>, bytes: &[u8], from: SocketAddr, inlet: &mut Inlet, now_us: u64) {
        if target.is_some_and(|target| !answers(target, from)) {
            return self.traffic.stranger();
        }
        let now_ms = self.steady.ms();
        self.heard_ms.store(now_ms, Ordering::Relaxed);
        let mut peer = None;
        for event in datagram(bytes) {
            // whoever sends no MAVLink gets none
            if let (Event::Frame(_), Some(peers), None) = (&event, &self.peers, peer) {
                match peers.heard(from, now_ms) {
                    Heard::Known(id) => peer = Some(id),
                    Heard::New(id) => {
                        info!(link = self.health.name(), peer = %from, "new peer");
                        inlet.open(Some(id));
                        peer = Some(id);
                    }
                    Heard::TooMany => return self.traffic.stranger(),
                }
            }
            inlet.take(event, peer, now_us);
        }
    }

    fn sweep(&self, inlet: &mut Inlet) {
        let gone = self.peers.as_ref().map(|peers| peers.sweep(self.steady.ms())).unwrap_or_default();
        for (id, address) in gone {
            info!(link = self.health.name(), peer = %address, "peer is silent and forgotten");
            inlet.close(Some(id));
        }
    }

    fn name_is_due(&self, socket: &Socket) -> bool {
        let silent_ms = self.steady.ms().saturating_sub(self.heard_ms.load(Ordering::Relaxed));
        socket.target.is_some() && self.host.parse::<IpAddr>().is_err() && silent_ms > ASK_NAME_AFTER_MS
    }

    /// Looks where the host's name leads now; a new address gets a new socket.
    async fn ask_name(&self) {
        // counts as heard, so that the name is not asked every second
        self.heard_ms.store(self.steady.ms(), Ordering::Relaxed);
        let Ok(now) = resolve(&self.host, self.port).await else { return };
        if self.socket().is_some_and(|socket| socket.target != Some(now)) {
            info!(link = self.health.name(), address = %now, "the host has another address");
            self.set_socket(None);
        }
    }
}

/// Whether a datagram from `peer` may be the answer to one for `target`: of that host, or of any if it is a group.
fn answers(target: SocketAddr, peer: SocketAddr) -> bool {
    let many = match target.ip() {
        IpAddr::V4(ip) => ip.is_multicast() || ip.octets()[3] == 255,
        IpAddr::V6(ip) => ip.is_multicast(),
    };
    many || target.ip() == peer.ip()
}
