use std::sync::atomic::{AtomicU64, Ordering};

/// What a link sent and what it could not take. Only ever counts up.
#[derive(Debug, Default)]
pub(in crate::daemon) struct Traffic {
    frames_out: AtomicU64,
    bytes_out: AtomicU64,
    dropped_out: AtomicU64,
    strangers: AtomicU64,
}

/// The same at one moment.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(in crate::daemon) struct TrafficCounts {
    pub(in crate::daemon) frames: u64,
    pub(in crate::daemon) bytes: u64,
    pub(in crate::daemon) dropped: u64,
    pub(in crate::daemon) strangers: u64,
}

impl Traffic {
    pub(in crate::daemon) fn sent(&self, frames: u64, bytes: usize) {
        self.frames_out.fetch_add(frames, Ordering::Relaxed);
        self.bytes_out.fetch_add(bytes as u64, Ordering::Relaxed);
    }

    pub(in crate::daemon) fn dropped(&self, frames: u64) {
        self.dropped_out.fetch_add(frames, Ordering::Relaxed);
    }

    /// A datagram or connection of somebody who is not served.
    pub(in crate::daemon) fn stranger(&self) {
        self.strangers.fetch_add(1, Ordering::Relaxed);
    }

    pub(in crate::daemon) fn counts(&self) -> TrafficCounts {
        let count = |counter: &AtomicU64| counter.load(Ordering::Relaxed);
        TrafficCounts {
            frames: count(&self.frames_out),
            bytes: count(&self.bytes_out),
            dropped: count(&self.dropped_out),
            strangers: count(&self.strangers),
        }
    }
}
