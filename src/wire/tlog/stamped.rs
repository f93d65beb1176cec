//! Where the records of a stamped log begin and end.

use crate::wire::frame::{CHECKSUM, HEADER_V1};
use crate::wire::scan::{Candidate, inspect, is_magic};
use crate::wire::{BadFrame, BadReason, Check, Event, FrameRef, MavlinkVersion};
use std::ops::Range;

/// Length of a stamp.
pub(super) const STAMP: usize = 8;
/// Length of the shortest record: a MAVLink 1 frame without payload.
const SHORTEST: usize = STAMP + HEADER_V1 + CHECKSUM;

/// Stamps further apart than this do not vouch for each other, µs. Recordings pause for hours, but a damaged stamp is
/// off by years in most of its bits.
const PLAUSIBLE_STEP_US: u64 = 24 * 3600 * 1_000_000;

/// What the walk over the records remembers.
#[derive(Debug, Default)]
pub(super) struct Walk {
    /// Receive time of the last record.
    last_us: Option<u64>,
    /// The next frame's stamp was lost: it stands at the very beginning of the data.
    stamp_lost: bool,
}

/// One record at the beginning of the data.
pub(super) struct Step<'a> {
    /// Bytes that it takes.
    pub consumed: usize,
    pub received_unix_us: Option<u64>,
    pub event: Event<'a>,
}

impl Walk {
    /// Takes the record at the beginning of `data`, which is not empty and holds at least two whole records unless it
    /// `ends` the log.
    pub(super) fn step<'a>(&mut self, data: &'a [u8], ends: bool) -> Step<'a> {
        let at = if std::mem::take(&mut self.stamp_lost) { 0 } else { STAMP };
        let own_us = if at == 0 { None } else { stamp(data, 0) };
        let reason = match data.get(at) {
            Some(&byte) if is_magic(byte) => match inspect(&data[at..]) {
                Candidate::Verified { len, version } => {
                    return self.take(data, at, own_us, Event::Frame(frame(data, at, len, version, Check::Verified)));
                }
                Candidate::Unknown { len, version, message_id } => {
                    if self.is_bounded(data, at..at + len, own_us, ends) {
                        let frame = frame(data, at, len, version, Check::UnknownMessage);
                        return self.take(data, at, own_us, Event::Frame(frame));
                    }
                    BadReason::UnconfirmedUnknown { message_id }
                }
                Candidate::Bad { len, reason } => {
                    if self.is_bounded(data, at..at + len, own_us, ends) {
                        let bytes = &data[at..at + len];
                        return self.take(data, at, own_us, Event::Bad(BadFrame { bytes, reason }));
                    }
                    reason
                }
                Candidate::Incomplete { expected } => BadReason::Truncated { expected },
            },
            Some(_) => BadReason::Garbage,
            None => BadReason::Truncated { expected: SHORTEST },
        };
        self.skip(data, ends, reason)
    }

    /// Gives up the bytes before the next verified frame and its stamp.
    fn skip<'a>(&mut self, data: &'a [u8], ends: bool, reason: BadReason) -> Step<'a> {
        // the next frame's stamp may be among the last bytes
        let mut consumed = if ends { data.len() } else { data.len().saturating_sub(STAMP) };
        for (at, _) in data.iter().enumerate().filter(|&(_, &byte)| is_magic(byte)) {
            match inspect(&data[at..]) {
                Candidate::Verified { .. } => {
                    let stamp_at = at.checked_sub(STAMP).filter(|&s| self.is_plausible(stamp(data, s), None));
                    self.stamp_lost = stamp_at.is_none();
                    consumed = stamp_at.unwrap_or(at);
                    break;
                }
                // keep the candidate and room for its stamp until there is more data
                Candidate::Incomplete { .. } if !ends && at > STAMP => {
                    consumed = at - STAMP;
                    break;
                }
                _ => {}
            }
        }
        if consumed == 0 {
            // a frame without any stamp stands here; it is verified, so the next step takes it
            return self.step(data, ends);
        }
        let bytes = &data[..consumed];
        Step { consumed, received_unix_us: self.last_us, event: Event::Bad(BadFrame { bytes, reason }) }
    }

    /// Takes a record whose frame, good or bad, stands at `at`.
    fn take<'a>(&mut self, data: &[u8], at: usize, own_us: Option<u64>, event: Event<'a>) -> Step<'a> {
        let consumed = at + event.bytes().len();
        // A stamp far from the last one is damaged if the next stamp agrees with the last; otherwise the receiver's
        // clock was set.
        let damaged = !self.is_plausible(own_us, None) && self.is_plausible(stamp(data, consumed), None);
        if !damaged {
            self.last_us = own_us.or(self.last_us);
        }
        Step { consumed, received_unix_us: self.last_us, event }
    }

    /// Whether a frame that no checksum vouches for lies here by its own length: a record or the end of the log follows
    /// it, and no verified record begins inside it.
    fn is_bounded(&self, data: &[u8], frame: Range<usize>, own_us: Option<u64>, ends: bool) -> bool {
        let follows = match data.get(frame.end + STAMP) {
            Some(&byte) => is_magic(byte) && self.is_plausible(stamp(data, frame.end), own_us),
            None => ends && frame.end == data.len(),
        };
        let is_record = |at: usize| {
            self.is_plausible(stamp(data, at - STAMP), own_us)
                && matches!(data.get(at..).map(inspect), Some(Candidate::Verified { .. }))
        };
        follows
            && !(frame.start + STAMP..frame.end).any(|at| data.get(at).is_some_and(|&b| is_magic(b)) && is_record(at))
    }

    /// Whether a stamp is near the last one or near `other`. The first stamp of a log is believed.
    fn is_plausible(&self, stamp_us: Option<u64>, other: Option<u64>) -> bool {
        let near = |reference: u64| stamp_us.is_some_and(|us| us.abs_diff(reference) <= PLAUSIBLE_STEP_US);
        match (self.last_us, other) {
            (None, None) => stamp_us.is_some(),
            (last, other) => last.is_some_and(near) || other.is_some_and(near),
        }
    }
}

fn stamp(data: &[u8], at: usize) -> Option<u64> {
    data.get(at..)?.first_chunk().map(|bytes| u64::from_be_bytes(*bytes))
}

fn frame(data: &[u8], at: usize, len: usize, version: MavlinkVersion, check: Check) -> FrameRef<'_> {
    FrameRef::new(&data[at..at + len], version, check)
}
