use std::fmt::Display;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Mutex, PoisonError};
use tracing::{debug, info, warn};

/// Whether a link works, and how often it came up.
#[derive(Debug)]
pub(in crate::daemon) struct Health {
    name: String,
    up: AtomicBool,
    times_up: AtomicU64,
    /// Why it is down, as last told.
    trouble: Mutex<Option<String>>,
    send_fails: AtomicBool,
}

impl Health {
    pub(super) fn new(name: String) -> Self {
        Self {
            name,
            up: AtomicBool::new(false),
            times_up: AtomicU64::new(0),
            trouble: Mutex::new(None),
            send_fails: AtomicBool::new(false),
        }
    }

    pub(super) fn name(&self) -> &str {
        &self.name
    }

    /// It works.
    pub(super) fn up(&self) {
        self.times_up.fetch_add(1, Ordering::Relaxed);
        let was_in_trouble = self.trouble().take().is_some();
        if !self.up.swap(true, Ordering::Relaxed) && was_in_trouble {
            info!(link = self.name, "up again");
        }
    }

    /// It does not, for this reason, and is tried again. Told once as a warning; the same reason again is no news.
    pub(super) fn down(&self, why: &dyn Display) {
        self.up.store(false, Ordering::Relaxed);
        let why = why.to_string();
        let mut trouble = self.trouble();
        if trouble.as_ref() == Some(&why) {
            debug!(link = self.name, "still down: {why}");
        } else {
            warn!(link = self.name, "down: {why}; trying again");
            *trouble = Some(why);
        }
    }

    /// A send failed for another reason than a full buffer. Told once until one works again.
    pub(super) fn cannot_send(&self, why: &dyn Display) {
        if !self.send_fails.swap(true, Ordering::Relaxed) {
            warn!(link = self.name, "cannot send: {why}");
        }
    }

    pub(super) fn can_send(&self) {
        if self.send_fails.load(Ordering::Relaxed) && self.send_fails.swap(false, Ordering::Relaxed) {
            info!(link = self.name, "sending works again");
        }
    }

    pub(in crate::daemon) fn is_up(&self) -> bool {
        self.up.load(Ordering::Relaxed)
    }

    /// How often the link came up, the first time included.
    pub(in crate::daemon) fn times_up(&self) -> u64 {
        self.times_up.load(Ordering::Relaxed)
    }

    /// Why it is down.
    pub(in crate::daemon) fn why_down(&self) -> Option<String> {
        self.trouble().clone()
    }

    fn trouble(&self) -> std::sync::MutexGuard<'_, Option<String>> {
        self.trouble.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
