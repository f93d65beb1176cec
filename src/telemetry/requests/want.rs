use super::carriers::Subject;

/// A channel that is wanted, and how far that has come.
#[derive(Debug)]
pub(super) struct Want {
    pub(super) subject: Subject,
    pub(super) rate_hz: f64,
    /// Nobody is told when it is missing.
    pub(super) optional: bool,
    /// Indices into `streams`: messages, then groups.
    pub(super) streams: Vec<usize>,
    pub(super) state: WantState,
    pub(super) reported: bool,
    pub(super) rest_ms: u64,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum WantState {
    Asking,
    /// Arrives well enough since then.
    Met {
        since_ms: u64,
    },
    /// Given up until then.
    Resting {
        until_ms: u64,
    },
}
