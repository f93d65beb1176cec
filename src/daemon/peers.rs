use std::net::SocketAddr;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{PoisonError, RwLock};

/// A peer that was silent for this long is forgotten. Every MAVLink station sends a heartbeat each second.
const SILENCE_MS: u64 = 60_000;
/// More peers than this on one port are not served.
const MOST: usize = 1024;

/// Who was heard on a UDP port. Any thread may read while frames arrive; only a new peer takes the write lock.
#[derive(Debug, Default)]
pub(super) struct Peers {
    list: RwLock<Vec<Peer>>,
}

#[derive(Debug)]
struct Peer {
    address: SocketAddr,
    heard_ms: AtomicU64,
}

/// What hearing from an address meant.
#[derive(Debug, PartialEq, Eq)]
pub(super) enum Heard {
    Known,
    New,
    /// The port has as many peers as it serves.
    TooMany,
}

impl Peers {
    /// A frame came from `address` at `now_ms` of a steady clock.
    pub(super) fn heard(&self, address: SocketAddr, now_ms: u64) -> Heard {
        {
            let list = self.list.read().unwrap_or_else(PoisonError::into_inner);
            if let Some(peer) = list.iter().find(|p| p.address == address) {
                let last_ms = peer.heard_ms.swap(now_ms, Ordering::Relaxed);
                return if now_ms.saturating_sub(last_ms) <= SILENCE_MS { Heard::Known } else { Heard::New };
            }
        }
        let mut list = self.list.write().unwrap_or_else(PoisonError::into_inner);
        list.retain(|p| p.lives(now_ms));
        if list.len() >= MOST {
            return Heard::TooMany;
        }
        list.push(Peer { address, heard_ms: AtomicU64::new(now_ms) });
        Heard::New
    }

    /// Calls `each` with every living peer.
    pub(super) fn for_each(&self, now_ms: u64, mut each: impl FnMut(SocketAddr)) {
        let list = self.list.read().unwrap_or_else(PoisonError::into_inner);
        list.iter().filter(|p| p.lives(now_ms)).for_each(|p| each(p.address));
    }
}

impl Peer {
    fn lives(&self, now_ms: u64) -> bool {
        now_ms.saturating_sub(self.heard_ms.load(Ordering::Relaxed)) <= SILENCE_MS
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn address(n: usize) -> SocketAddr {
        SocketAddr::from(([10, 0, (n / 256) as u8, (n % 256) as u8], 14550))
    }

    fn living(peers: &Peers, now_ms: u64) -> Vec<SocketAddr> {
        let mut list = Vec::new();
        peers.for_each(now_ms, |p| list.push(p));
        list
    }

    #[test]
    fn silent_peers_are_forgotten_and_may_come_back() {
        let peers = Peers::default();
        assert_eq!(peers.heard(address(1), 0), Heard::New);
        assert_eq!(peers.heard(address(2), 50_000), Heard::New);
        assert_eq!(peers.heard(address(2), 60_000), Heard::Known);
        assert_eq!(living(&peers, 60_000), [address(1), address(2)]);
        assert_eq!(living(&peers, 60_001), [address(2)]);
        assert_eq!(peers.heard(address(1), 90_000), Heard::New);
        assert_eq!(living(&peers, 90_000), [address(1), address(2)]);
    }

    #[test]
    fn a_flood_of_addresses_is_bounded_and_passes() {
        let peers = Peers::default();
        for n in 0..MOST {
            assert_eq!(peers.heard(address(n), 5), Heard::New);
        }
        assert_eq!(peers.heard(address(MOST), 6), Heard::TooMany);
        assert_eq!(peers.heard(address(MOST), 6 + SILENCE_MS), Heard::New);
        assert_eq!(living(&peers, 6 + SILENCE_MS), [address(MOST)]);
    }
}
