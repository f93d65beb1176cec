use crate::routing::PeerId;
use std::collections::HashMap;
use std::net::SocketAddr;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{PoisonError, RwLock, RwLockReadGuard};

/// A peer that was silent for this long is forgotten. Every MAVLink station sends a heartbeat each second.
const SILENCE_MS: u64 = 60_000;
/// More peers than this on one port are not served.
const MOST: usize = 1024;

/// Who was heard on a UDP port. Any thread may read while frames arrive; only a new or leaving peer takes the write
/// lock.
#[derive(Debug, Default)]
pub(super) struct Peers {
    list: RwLock<List>,
}

#[derive(Debug, Default)]
struct List {
    /// A peer's id is its place.
    places: Vec<Option<Peer>>,
    by_address: HashMap<SocketAddr, u32>,
}

#[derive(Debug)]
struct Peer {
    address: SocketAddr,
    heard_ms: AtomicU64,
}

/// What hearing from an address meant.
#[derive(Debug, PartialEq, Eq)]
pub(super) enum Heard {
    Known(PeerId),
    New(PeerId),
    /// The port has as many peers as it serves.
    TooMany,
}

impl Peers {
    /// A frame came from `address` at `now_ms` of a steady clock.
    pub(super) fn heard(&self, address: SocketAddr, now_ms: u64) -> Heard {
        {
            let list = self.read();
            let place = list.by_address.get(&address).copied();
            if let Some((place, peer)) = place.and_then(|p| Some((p, list.places.get(p as usize)?.as_ref()?))) {
                peer.heard_ms.store(now_ms, Ordering::Relaxed);
                return Heard::Known(PeerId(place));
            }
        }
        let mut list = self.list.write().unwrap_or_else(PoisonError::into_inner);
        if list.by_address.len() >= MOST {
            return Heard::TooMany;
        }
        let place = list.places.iter().position(Option::is_none).unwrap_or_else(|| {
            list.places.push(None);
            list.places.len() - 1
        });
        list.places[place] = Some(Peer { address, heard_ms: AtomicU64::new(now_ms) });
        // there are at most MOST places
        list.by_address.insert(address, place as u32);
        Heard::New(PeerId(place as u32))
    }

    pub(super) fn address(&self, peer: PeerId) -> Option<SocketAddr> {
        self.read().places.get(peer.0 as usize)?.as_ref().map(|p| p.address)
    }

    pub(super) fn for_each(&self, mut each: impl FnMut(SocketAddr)) {
        self.read().places.iter().flatten().for_each(|p| each(p.address));
    }

    pub(super) fn count(&self) -> usize {
        self.read().by_address.len()
    }

    /// Forgets the peers that have been silent for long, and gives them.
    pub(super) fn sweep(&self, now_ms: u64) -> Vec<(PeerId, SocketAddr)> {
        let silent = |peer: &Peer| now_ms.saturating_sub(peer.heard_ms.load(Ordering::Relaxed)) > SILENCE_MS;
        if !self.read().places.iter().flatten().any(silent) {
            return Vec::new();
        }
        let mut list = self.list.write().unwrap_or_else(PoisonError::into_inner);
        let mut gone = Vec::new();
        for (place, slot) in list.places.iter_mut().enumerate() {
            if let Some(peer) = slot.take_if(|peer| silent(peer)) {
                gone.push((PeerId(place as u32), peer.address));
            }
        }
        for (_, address) in &gone {
            list.by_address.remove(address);
        }
        gone
    }

    fn read(&self) -> RwLockReadGuard<'_, List> {
        self.list.read().unwrap_or_else(PoisonError::into_inner)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn address(n: usize) -> SocketAddr {
        SocketAddr::from(([10, 0, (n / 256) as u8, (n % 256) as u8], 14550))
    }

    fn living(peers: &Peers) -> Vec<SocketAddr> {
        let mut list = Vec::new();
        peers.for_each(|p| list.push(p));
        list
    }

    #[test]
    fn silent_peers_are_forgotten_and_may_come_back() {
        let peers = Peers::default();
        assert_eq!(peers.heard(address(1), 0), Heard::New(PeerId(0)));
        assert_eq!(peers.heard(address(2), 50_000), Heard::New(PeerId(1)));
        assert_eq!(peers.heard(address(2), 60_000), Heard::Known(PeerId(1)));
        assert_eq!(peers.sweep(60_000), []);
        assert_eq!(peers.sweep(60_001), [(PeerId(0), address(1))]);
        assert_eq!((living(&peers), peers.count()), (vec![address(2)], 1));
        assert_eq!(peers.heard(address(3), 90_000), Heard::New(PeerId(0)));
        assert_eq!(peers.heard(address(1), 90_000), Heard::New(PeerId(2)));
        assert_eq!(peers.address(PeerId(0)), Some(address(3)));
        assert_eq!(peers.address(PeerId(9)), None);
    }

    #[test]
    fn a_flood_of_addresses_is_bounded_and_passes() {
        let peers = Peers::default();
        for n in 0..MOST {
            assert_eq!(peers.heard(address(n), 5), Heard::New(PeerId(n as u32)));
        }
        assert_eq!(peers.heard(address(MOST), 6), Heard::TooMany);
        assert_eq!(peers.sweep(6 + SILENCE_MS).len(), MOST);
        assert_eq!(peers.heard(address(MOST), 6 + SILENCE_MS), Heard::New(PeerId(0)));
    }
}
