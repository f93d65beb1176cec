use super::Origin;
use crate::wire::FrameRef;
use std::collections::hash_map::RandomState;
use std::hash::BuildHasher;

/// Frames that one set remembers; the oldest makes room.
const WAYS: usize = 16;
/// Sets: 64 Ki frames in all, so half a second of 50 000 frames a second fits with room to spare.
const SETS: usize = 4 * 1024;

/// Remembers the frames of the last moments, to know those that come by a second way.
///
/// Whole frames are compared by a 64-bit keyed hash. The same bytes from the same end again are no second way: a sender
/// that does not number its frames repeats itself.
#[derive(Debug)]
pub struct Duplicates {
    window_us: u64,
    hasher: RandomState,
    /// Empty where the window is.
    seen: Vec<[Seen; WAYS]>,
}

/// Where a duplicate came from first; `None` is ourselves.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct First {
    pub from: Option<Origin>,
}

#[derive(Debug, Clone, Copy, Default)]
struct Seen {
    hash: u64,
    at_us: u64,
    from: Option<Origin>,
    used: bool,
}

impl Duplicates {
    /// Remembers for `window_us`; 0 never finds a duplicate.
    pub fn new(window_us: u64) -> Self {
        let seen = if window_us > 0 { vec![Default::default(); SETS] } else { Vec::new() };
        Self { window_us, hasher: RandomState::new(), seen }
    }

    pub fn window_us(&self) -> u64 {
        self.window_us
    }

    /// Whether the same frame came from another end within the window. `None` is ourselves.
    pub fn seen(&mut self, frame: FrameRef<'_>, from: Option<Origin>, now_us: u64) -> Option<First> {
        if self.seen.is_empty() {
            return None;
        }
        let hash = self.hasher.hash_one(frame.bytes());
        let set = &mut self.seen[hash as usize % SETS];
        let fresh = |s: &Seen| s.used && now_us.abs_diff(s.at_us) <= self.window_us;
        if let Some(seen) = set.iter_mut().find(|s| s.hash == hash && fresh(s)) {
            if seen.from != from {
                return Some(First { from: seen.from });
            }
            seen.at_us = now_us;
            return None;
        }
        // a set has WAYS members
        let oldest = (0..WAYS).min_by_key(|&i| if fresh(&set[i]) { set[i].at_us } else { 0 }).unwrap_or(0);
        set[oldest] = Seen { hash, at_us: now_us, from, used: true };
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::routing::LinkId;
    use crate::wire::dialect::ardupilotmega::SYSTEM_TIME_DATA;
    use crate::wire::{Encoder, FrameBuf};

    const A: Option<Origin> = Some(Origin { link: LinkId(0), peer: None });
    const B: Option<Origin> = Some(Origin { link: LinkId(1), peer: None });

    fn frame(number: u32) -> FrameBuf {
        Encoder::new(1, 1).encode(&SYSTEM_TIME_DATA { time_unix_usec: 7, time_boot_ms: number })
    }

    #[test]
    fn the_second_way_is_found_within_the_window_only() {
        let mut duplicates = Duplicates::new(500);
        assert_eq!(duplicates.seen(frame(1).as_ref(), A, 1_000), None);
        assert_eq!(duplicates.seen(frame(1).as_ref(), B, 1_500), Some(First { from: A }));
        assert_eq!(duplicates.seen(frame(1).as_ref(), A, 1_500), None, "its own end repeats it");
        assert_eq!(duplicates.seen(frame(2).as_ref(), B, 1_500), None, "another frame");
        assert_eq!(duplicates.seen(frame(2).as_ref(), None, 1_500), Some(First { from: B }));
        assert_eq!(duplicates.seen(frame(2).as_ref(), A, 2_001), None, "later than the window");
        assert_eq!(Duplicates::new(0).seen(frame(1).as_ref(), A, 0), None);
    }

    #[test]
    fn half_a_second_of_fifty_thousand_a_second_is_remembered() {
        let mut duplicates = Duplicates::new(500_000);
        for k in 0..25_000 {
            assert_eq!(duplicates.seen(frame(k).as_ref(), A, u64::from(k) * 20), None);
        }
        let found = (0..25_000).filter(|&k| duplicates.seen(frame(k).as_ref(), B, 500_000).is_some()).count();
        // six frames in the mean meet sixteen places: hardly a set overflows
        assert!(found > 24_900, "{found}");
    }
}
