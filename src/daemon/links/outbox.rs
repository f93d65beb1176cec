//! What waits to be written to a stream: bytes of whole frames, up to a bound.

use crate::daemon::status::Traffic;
use crate::routing::PeerId;
use std::sync::{Arc, Mutex, PoisonError, RwLock};
use tokio::sync::Notify;

/// More clients than this on one TCP port are not served.
pub(super) const MOST_CLIENTS: usize = 256;

/// Frames that leave together.
#[derive(Debug, Default)]
pub(super) struct Batch {
    pub(super) bytes: Vec<u8>,
    pub(super) frames: u64,
}

impl Batch {
    pub(super) fn clear(&mut self) {
        self.bytes.clear();
        self.frames = 0;
    }
}

/// The queue before one stream.
#[derive(Debug)]
pub(super) struct Outbox {
    waiting: Mutex<Batch>,
    filled: Notify,
    capacity: usize,
}

impl Outbox {
    fn new(capacity: usize) -> Self {
        let batch = Batch { bytes: Vec::with_capacity(capacity), frames: 0 };
        Self { waiting: Mutex::new(batch), filled: Notify::new(), capacity }
    }

    /// Takes a frame, unless the queue is full.
    fn push(&self, frame: &[u8]) -> bool {
        let mut waiting = self.waiting.lock().unwrap_or_else(PoisonError::into_inner);
        if waiting.bytes.len() + frame.len() > self.capacity {
            return false;
        }
        waiting.bytes.extend_from_slice(frame);
        waiting.frames += 1;
        let first = waiting.frames == 1;
        drop(waiting);
        if first {
            self.filled.notify_one();
        }
        true
    }

    /// Moves all that waits into `batch`, which must be empty; false if nothing does.
    pub(super) fn take(&self, batch: &mut Batch) -> bool {
        batch.bytes.reserve(self.capacity);
        std::mem::swap(&mut *self.waiting.lock().unwrap_or_else(PoisonError::into_inner), batch);
        batch.frames > 0
    }

    /// Waits until something waits.
    pub(super) async fn next(&self, batch: &mut Batch) {
        while !self.take(batch) {
            self.filled.notified().await;
        }
    }
}

/// The outboxes of a link: one for each client of a server, one while connected for other streams.
#[derive(Debug)]
pub(super) struct Outboxes {
    places: RwLock<Vec<Option<Arc<Outbox>>>>,
    capacity: usize,
    pub(super) traffic: Traffic,
}

impl Outboxes {
    /// Each holds at most `capacity` bytes.
    pub(super) fn new(capacity: usize) -> Self {
        Self { places: RwLock::default(), capacity, traffic: Traffic::default() }
    }

    /// A new outbox and the peer that it is for; `None` if there are as many as a link serves.
    pub(super) fn open(&self) -> Option<(PeerId, Arc<Outbox>)> {
        let mut places = self.places.write().unwrap_or_else(PoisonError::into_inner);
        let place = match places.iter().position(Option::is_none) {
            Some(place) => place,
            None if places.len() >= MOST_CLIENTS => return None,
            None => {
                places.push(None);
                places.len() - 1
            }
        };
        let outbox = Arc::new(Outbox::new(self.capacity));
        places[place] = Some(Arc::clone(&outbox));
        Some((PeerId(place as u32), outbox))
    }

    /// Whatever still waits for this peer is lost, and counted.
    pub(super) fn close(&self, peer: PeerId) {
        let mut places = self.places.write().unwrap_or_else(PoisonError::into_inner);
        let outbox = places.get_mut(peer.0 as usize).and_then(Option::take);
        drop(places);
        if let Some(outbox) = outbox {
            let mut rest = Batch::default();
            outbox.take(&mut rest);
            self.traffic.dropped(rest.frames);
        }
    }

    /// Queues a frame for one peer, or for all; drops and counts it where the queue is full or nobody is connected.
    pub(super) fn send(&self, frame: &[u8], peer: Option<PeerId>) {
        let places = self.places.read().unwrap_or_else(PoisonError::into_inner);
        let give = |outbox: &Arc<Outbox>| {
            if !outbox.push(frame) {
                self.traffic.dropped(1);
            }
        };
        match peer {
            Some(peer) => match places.get(peer.0 as usize).and_then(Option::as_ref) {
                Some(outbox) => give(outbox),
                None => self.traffic.dropped(1),
            },
            None => places.iter().flatten().for_each(give),
        }
    }

    pub(super) fn count(&self) -> usize {
        self.places.read().unwrap_or_else(PoisonError::into_inner).iter().flatten().count()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_full_outbox_drops_the_newest_whole_and_counts() {
        let outboxes = Outboxes::new(10);
        let (peer, outbox) = outboxes.open().expect("the first");
        for frame in [b"aaaa", b"bbbb", b"cccc"] {
            outboxes.send(frame, Some(peer));
        }
        let mut batch = Batch::default();
        assert!(outbox.take(&mut batch));
        assert_eq!((batch.bytes.as_slice(), batch.frames), (&b"aaaabbbb"[..], 2));
        assert_eq!(outboxes.traffic.counts().dropped, 1);
        outboxes.send(b"dd", None);
        outboxes.close(peer);
        assert_eq!(outboxes.traffic.counts().dropped, 2, "what waits when the peer leaves is lost");
        outboxes.send(b"ee", Some(peer));
        assert_eq!((outboxes.traffic.counts().dropped, outboxes.count()), (3, 0));
    }

    #[test]
    fn places_are_bounded_and_used_again() {
        let outboxes = Outboxes::new(10);
        let all: Vec<_> = std::iter::from_fn(|| outboxes.open()).map(|(peer, _)| peer).collect();
        assert_eq!(all.len(), MOST_CLIENTS);
        outboxes.close(PeerId(7));
        assert_eq!(outboxes.open().map(|(peer, _)| peer), Some(PeerId(7)));
    }
}
