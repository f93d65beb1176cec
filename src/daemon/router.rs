//! Which link a frame goes to. For now: to every other.

use super::udp::UdpLink;
use crate::wire::FrameRef;
use std::net::SocketAddr;
use std::sync::Arc;

/// Position of a link in the daemon's list.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct LinkId(pub usize);

/// Where a frame came from, and where an answer to its sender goes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Origin {
    pub(super) link: LinkId,
    /// The peer on a link that has several.
    pub(super) peer: Option<SocketAddr>,
}

/// The sending side of a link. Sending never waits: see the table in [`super`].
#[derive(Debug, Clone)]
pub(super) enum Outlet {
    Udp(Arc<UdpLink>),
    /// A log takes nothing.
    Log,
}

/// Hands frames to links. Any thread may call it.
#[derive(Debug)]
pub(super) struct Router {
    outlets: Vec<Outlet>,
}

impl Router {
    /// `outlets[i]` belongs to `LinkId(i)`.
    pub(super) fn new(outlets: Vec<Outlet>) -> Self {
        Self { outlets }
    }

    /// Passes a received frame on, untouched: to every other link and to the other peers of its own.
    pub(super) fn forward(&self, frame: FrameRef<'_>, from: Origin) {
        for (index, outlet) in self.outlets.iter().enumerate() {
            let Outlet::Udp(link) = outlet else { continue };
            if LinkId(index) != from.link {
                link.send(frame.bytes(), None);
            } else if from.peer.is_some() {
                link.send(frame.bytes(), from.peer);
            }
        }
    }

    /// Sends one of our own frames to everyone on a link.
    pub(super) fn send(&self, frame: FrameRef<'_>, link: LinkId) {
        if let Some(Outlet::Udp(link)) = self.outlets.get(link.0) {
            link.send(frame.bytes(), None);
        }
    }

    /// Sends one of our own frames to where another came from.
    pub(super) fn answer(&self, frame: FrameRef<'_>, to: Origin) {
        if let Some(Outlet::Udp(link)) = self.outlets.get(to.link.0) {
            match to.peer {
                Some(peer) => link.send_to(frame.bytes(), peer),
                None => link.send(frame.bytes(), None),
            }
        }
    }
}
