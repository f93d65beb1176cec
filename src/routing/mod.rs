//! Which links a frame goes to: pure decisions, no sockets, no clock.
//!
//! In: every received frame ([`FrameRef`](crate::wire::FrameRef)) with the end of the link that it came from
//! ([`Origin`]) and the time. Out: the ends that it goes to, each once, and what was held back and why ([`Fate`]).
//! [`Routes`] learns from the traffic who lives where. [`Rules`] are what a config says about one link: group, filters,
//! rate limits.
//!
//! # What MAVLink prescribes, and what this adds
//!
//! 1. A frame without a target, or with target system 0, goes to every end but its own.
//! 2. A frame for a system goes to the ends where that system and component were heard; if the component was never
//!    heard, or is 0, to the ends where the system was. If nobody was, it goes nowhere.
//! 3. Nothing goes back: neither to the end that it came from, nor to one where its sender was heard lately
//!    ([`ECHO_US`]), nor to a link of the same group.
//! 4. What already came from another end is a duplicate and goes nowhere, for a configurable time.
//!
//! Frames of messages that no dialect here defines name no target that could be read, so they fall under 1. May import
//! `wire`.

mod duplicates;
mod filter;
mod limits;
mod routes;
#[cfg(test)]
mod tests;

pub use duplicates::{Duplicates, First};
pub use filter::{Filter, Ids, Selection};
pub use limits::Limits;
pub use routes::{Fate, Routes};

/// A sender heard this recently at an end lives there, and gets none of its own frames back. µs.
pub const ECHO_US: u64 = 10_000_000;

/// Whoever was heard first at another end and is silent for this long has moved: who speaks now is no second one. µs.
pub const TWIN_US: u64 = 3_000_000;

/// Position of a link in the daemon's list.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct LinkId(pub usize);

/// One of several at the other side of a link. Numbers are reused once a peer has left.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct PeerId(pub u32);

/// An end: where a frame came from, and where an answer to its sender goes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct Origin {
    pub link: LinkId,
    /// The peer on a link that has several.
    pub peer: Option<PeerId>,
}

/// What holds for one link.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Rules {
    /// Links of one group lead to the same network: nothing goes from one to another, and who was heard on one is
    /// reached through all.
    pub group: Option<String>,
    /// What is taken from the link. The rest is neither forwarded nor estimated nor recorded.
    pub inward: Filter,
    /// What is sent to the link. Our own messages are not asked.
    pub outward: Filter,
    /// How often a message of one sender is sent to the link.
    pub limits: Limits,
}
