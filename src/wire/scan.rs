//! Where frames begin and end in a run of bytes.

use super::catalog::message_info;
use super::checksum::checksum;
use super::event::{BadFrame, BadReason, Event};
use super::frame::{CHECKSUM, Check, FrameRef, HEADER_V1, HEADER_V2, MAGIC_V1, MAGIC_V2, MAX_FRAME_LEN, SIGNATURE};
use mavlink_core::{MavlinkVersion, consts};
use std::ops::Range;

/// What stands at the beginning of some bytes that begin with a magic byte.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Candidate {
    /// More bytes are needed; `expected` in all, as far as the header tells.
    Incomplete {
        expected: usize,
    },
    Verified {
        len: usize,
        version: MavlinkVersion,
    },
    Unknown {
        len: usize,
        version: MavlinkVersion,
        message_id: u32,
    },
    Bad {
        len: usize,
        reason: BadReason,
    },
}

pub(super) fn is_magic(byte: u8) -> bool {
    byte == MAGIC_V1 || byte == MAGIC_V2
}

/// Judges `bytes`, which begin with a magic byte.
pub(super) fn inspect(bytes: &[u8]) -> Candidate {
    match bytes {
        [MAGIC_V1, payload_len, ..] => {
            let end = HEADER_V1 + usize::from(*payload_len);
            let len = end + CHECKSUM;
            if bytes.len() < len {
                return Candidate::Incomplete { expected: len };
            }
            verify(&bytes[..len], end, u32::from(bytes[5]), MavlinkVersion::V1)
        }
        [MAGIC_V2, payload_len, flags, ..] => {
            let has = |flag| flags & flag != 0;
            // A 32-bit system id is refused below, but its three bytes belong to the frame.
            let header =
                HEADER_V2 + if has(consts::v2::IFLAG_SYSID32) { consts::v2::SYSID32_EXTRA_HEADER_SIZE } else { 0 };
            let end = header + usize::from(*payload_len);
            let len = end + CHECKSUM + if has(consts::v2::IFLAG_SIGNED) { SIGNATURE } else { 0 };
            if flags & !consts::v2::IFLAG_SIGNED != 0 {
                return Candidate::Bad { len, reason: BadReason::UnsupportedFlags { flags: *flags } };
            }
            if bytes.len() < len {
                return Candidate::Incomplete { expected: len };
            }
            let message_id = u32::from_le_bytes([bytes[7], bytes[8], bytes[9], 0]);
            verify(&bytes[..len], end, message_id, MavlinkVersion::V2)
        }
        [MAGIC_V1, ..] => Candidate::Incomplete { expected: HEADER_V1 + CHECKSUM },
        _ => Candidate::Incomplete { expected: HEADER_V2 + CHECKSUM },
    }
}

/// Checks the checksum that follows `end` in a frame of full length.
fn verify(frame: &[u8], end: usize, message_id: u32, version: MavlinkVersion) -> Candidate {
    let len = frame.len();
    let Some(info) = message_info(message_id) else {
        return Candidate::Unknown { len, version, message_id };
    };
    let received = u16::from_le_bytes([frame[end], frame[end + 1]]);
    let computed = checksum(&frame[1..end], info.crc_extra);
    if received == computed {
        Candidate::Verified { len, version }
    } else {
        Candidate::Bad { len, reason: BadReason::Checksum { message_id, received, computed } }
    }
}

/// A stretch of the input and what it is.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Found {
    range: Range<usize>,
    kind: Kind,
}

#[derive(Debug, Clone, PartialEq, Eq)]
enum Kind {
    Frame(MavlinkVersion, Check),
    Bad(BadReason),
}

impl Found {
    pub(super) fn range(&self) -> Range<usize> {
        self.range.clone()
    }

    /// The event over the same bytes that were scanned.
    pub(super) fn event<'a>(&self, data: &'a [u8]) -> Event<'a> {
        let bytes = &data[self.range.clone()];
        match self.kind {
            Kind::Frame(version, check) => Event::Frame(FrameRef::new(bytes, version, check)),
            Kind::Bad(reason) => Event::Bad(BadFrame { bytes, reason }),
        }
    }
}

/// The state of a scan over data that may still grow at its end and be cut at its beginning.
#[derive(Debug, Clone)]
pub(super) struct Scanner {
    /// Bytes before it have been reported.
    start: usize,
    /// Bytes from `start` to here begin no good frame.
    position: usize,
    /// A failed candidate that began at `start`.
    failed: Option<Failed>,
    /// Bytes from `position` to here begin no verified frame, as far as an unknown frame at `position` cares.
    cleared: usize,
    /// The byte at `start` directly follows a good frame, or begins a datagram.
    in_step: bool,
}

#[derive(Debug, Clone, Copy)]
struct Failed {
    reason: BadReason,
    /// Where it would end by its own header. Candidates that fail before belong to the same damage.
    end: usize,
}

/// Whether an unknown message may be believed.
enum Belief {
    Accept,
    Reject,
    NeedsMore,
}

impl Scanner {
    pub(super) fn new(in_step: bool) -> Self {
        Self { start: 0, position: 0, failed: None, cleared: 0, in_step }
    }

    /// Index of the first byte that is not yet reported; the bytes before it may be dropped.
    pub(super) fn start(&self) -> usize {
        self.start
    }

    /// Adapts to the loss of all bytes before [`Self::start`].
    pub(super) fn rebase(&mut self) {
        let cut = std::mem::take(&mut self.start);
        self.position -= cut; // never before start
        self.cleared = self.cleared.saturating_sub(cut);
        if let Some(failed) = &mut self.failed {
            failed.end -= cut; // begins at start
        }
    }

    /// The next stretch, or `None` until more data arrives. `ended` says that none will.
    pub(super) fn next(&mut self, data: &[u8], ended: bool) -> Option<Found> {
        loop {
            if let Some(failed) = self.failed
                && self.position >= failed.end
            {
                return Some(self.bad(failed.end, failed.reason));
            }
            let rest = &data[self.position..];
            let Some(skip) = rest.iter().position(|&b| is_magic(b)) else {
                self.position = data.len();
                if let Some(failed) = self.failed {
                    if self.position >= failed.end {
                        continue;
                    }
                    return ended.then(|| self.bad(data.len(), failed.reason)).filter(|found| !found.range.is_empty());
                }
                return self.garbage(ended);
            };
            self.position += skip;
            match self.failed {
                Some(failed) if self.position >= failed.end => continue,
                None if self.start < self.position => return self.garbage(true),
                _ => {}
            }
            match inspect(&data[self.position..]) {
                Candidate::Verified { len, version } => return Some(self.frame(len, version, Check::Verified)),
                Candidate::Incomplete { .. } if !ended => return None,
                Candidate::Incomplete { expected } => self.fail(BadReason::Truncated { expected }, data.len()),
                Candidate::Bad { len, reason } => self.fail(reason, self.position + len),
                Candidate::Unknown { len, version, message_id } => match self.believe(data, len, ended) {
                    Belief::Accept => return Some(self.frame(len, version, Check::UnknownMessage)),
                    Belief::Reject => self.fail(BadReason::UnconfirmedUnknown { message_id }, self.position + len),
                    Belief::NeedsMore => return None,
                },
            }
        }
    }

    /// The frame at `position`, or first the bad bytes before it.
    fn frame(&mut self, len: usize, version: MavlinkVersion, check: Check) -> Found {
        if let Some(failed) = self.failed {
            return self.bad(self.position, failed.reason);
        }
        // without a failure, garbage was reported before the candidate was looked at: start == position
        let range = self.start..self.start + len;
        self.start = range.end;
        self.position = range.end;
        self.in_step = true;
        Found { range, kind: Kind::Frame(version, check) }
    }

    /// Gives up the bytes up to `end`.
    fn bad(&mut self, end: usize, reason: BadReason) -> Found {
        let range = self.start..end;
        self.start = end;
        self.position = self.position.max(end);
        self.failed = None;
        self.in_step = false;
        Found { range, kind: Kind::Bad(reason) }
    }

    /// Gives up the bytes before `position`, in pieces of the longest frame's length so that an endless run of them
    /// neither waits nor depends on how it was chunked.
    fn garbage(&mut self, complete: bool) -> Option<Found> {
        let run = self.position - self.start;
        if run >= MAX_FRAME_LEN || (complete && run > 0) {
            let end = self.start + run.min(MAX_FRAME_LEN);
            return Some(self.bad(end, BadReason::Garbage));
        }
        None
    }

    /// Notes that no frame begins at `position`, and retries from the next byte.
    fn fail(&mut self, reason: BadReason, end: usize) {
        self.failed.get_or_insert(Failed { reason, end });
        self.position += 1;
    }

    /// Whether the unknown message of this length at `position` is one. See [`Parser`](super::Parser) for the rule.
    fn believe(&mut self, data: &[u8], len: usize, ended: bool) -> Belief {
        if self.failed.is_some() {
            return Belief::Reject;
        }
        let end = self.position + len;
        let mut at = self.cleared.max(self.position + 1).min(end);
        while let Some(skip) = data[at..end].iter().position(|&b| is_magic(b)) {
            at += skip;
            match inspect(&data[at..]) {
                Candidate::Verified { .. } => return Belief::Reject,
                Candidate::Incomplete { .. } if !ended => {
                    self.cleared = at;
                    return Belief::NeedsMore;
                }
                _ => at += 1,
            }
        }
        self.cleared = end;
        match data.get(end) {
            _ if self.in_step => Belief::Accept,
            Some(&byte) if is_magic(byte) => Belief::Accept,
            None if ended => Belief::Accept,
            None => Belief::NeedsMore,
            Some(_) => Belief::Reject,
        }
    }
}
