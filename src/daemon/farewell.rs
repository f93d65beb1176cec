//! Leaving: what the vehicles granted is given back before the links close.

use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;
use tokio::time::{Instant, sleep};

/// How long the estimator's thread may take to say goodbye; with a vehicle there it wakes many times a second.
const PATIENCE: Duration = Duration::from_millis(500);
/// What was said needs this long to leave the links' queues.
const FLUSH: Duration = Duration::from_millis(50);

/// Between the task that stops everything and the thread that talks to the vehicles.
#[derive(Debug, Default)]
pub(super) struct Farewell {
    owed: AtomicBool,
    leaving: AtomicBool,
    said: AtomicBool,
}

impl Farewell {
    /// A vehicle has granted something.
    pub(super) fn owe(&self) {
        self.owed.store(true, Ordering::Relaxed);
    }

    /// Is it time to say goodbye?
    pub(super) fn is_due(&self) -> bool {
        self.leaving.load(Ordering::Acquire) && !self.said.load(Ordering::Acquire)
    }

    /// Goodbye was said.
    pub(super) fn said(&self) {
        self.said.store(true, Ordering::Release);
    }

    /// Lets goodbye be said, and waits for it a little. At once where nothing is owed.
    pub(super) async fn leave(&self) {
        if !self.owed.load(Ordering::Relaxed) {
            return;
        }
        self.leaving.store(true, Ordering::Release);
        let deadline = Instant::now() + PATIENCE;
        while !self.said.load(Ordering::Acquire) && Instant::now() < deadline {
            sleep(Duration::from_millis(5)).await;
        }
        sleep(FLUSH).await;
    }
}
