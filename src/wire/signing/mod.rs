//! MAVLink 2 message signing: frames that prove who made them, and that they are new.
//!
//! A signature is a link id, a time stamp in units of 10 µs since 2015, and the first 48 bits of
//! SHA-256(key ‖ frame from magic to checksum ‖ link id ‖ time stamp). [`Signer`] adds it, [`Verifier`] checks it and
//! refuses what is older than what it has seen of the same sender. Source: MAVLink guide, "Message Signing". No I/O
//! and no clock: times are arguments, keys come from the caller ([`Key::parse`] reads the text of a key file).

mod key;
mod verify;

pub use key::{Key, KeyError};
pub use verify::{Refusal, Unsigned, Verifier};

use super::checksum::checksum;
use super::frame::{CHECKSUM, FrameBuf, FrameRef, HEADER_V2, SIGNATURE};
use mavlink_core::MavlinkVersion;

/// The incompatibility flag that announces a signature.
const SIGNED: u8 = 0x01;
/// UNIX time at which a signature's clock starts (2015-01-01), s.
const EPOCH_UNIX_S: u64 = 1_420_070_400;
const STAMP_MAX: u64 = (1 << 48) - 1;

/// A signature's time: units of 10 µs since 2015, 48 bits.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Default)]
pub struct SignatureTime(u64);

impl SignatureTime {
    /// A minute: a new sender may trail the newest time seen by this much.
    pub const MINUTE: u64 = 6_000_000;

    pub fn from_unix_us(unix_us: u64) -> Self {
        Self::from_ticks(unix_us.saturating_sub(EPOCH_UNIX_S * 1_000_000) / 10)
    }

    /// From units of 10 µs since 2015.
    pub fn from_ticks(ticks: u64) -> Self {
        Self(ticks.min(STAMP_MAX))
    }

    /// Units of 10 µs since 2015.
    pub fn ticks(self) -> u64 {
        self.0
    }

    fn next(self) -> Self {
        Self::from_ticks(self.0 + 1)
    }

    fn bytes(self) -> [u8; 6] {
        let [a, b, c, d, e, f, ..] = self.0.to_le_bytes();
        [a, b, c, d, e, f]
    }

    fn read(bytes: [u8; 6]) -> Self {
        let [a, b, c, d, e, f] = bytes;
        Self(u64::from_le_bytes([a, b, c, d, e, f, 0, 0]))
    }
}

/// The parts of a frame's signature.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Signature {
    pub link_id: u8,
    pub time: SignatureTime,
    digest: [u8; 6],
}

impl Signature {
    /// Of a signed frame.
    pub fn of(frame: FrameRef<'_>) -> Option<Self> {
        let [link_id, t0, t1, t2, t3, t4, t5, d0, d1, d2, d3, d4, d5] = *frame.signature()?.first_chunk()?;
        let time = SignatureTime::read([t0, t1, t2, t3, t4, t5]);
        Some(Self { link_id, time, digest: [d0, d1, d2, d3, d4, d5] })
    }
}

/// Signs what leaves on one link.
#[derive(Debug, Clone)]
pub struct Signer {
    key: Key,
    link_id: u8,
    last: SignatureTime,
}

impl Signer {
    /// `last` is the newest time ever signed with this key, so that a clock that was set back does not make frames look
    /// old: keep it on disk.
    pub fn new(key: Key, link_id: u8, last: SignatureTime) -> Self {
        Self { key, link_id, last }
    }

    /// The newest time signed.
    pub fn last(&self) -> SignatureTime {
        self.last
    }

    /// The frame with a signature, in place of one made with another key. `None` where there can be none (MAVLink 1), and
    /// where none is needed: it was signed with this key already.
    pub fn sign(&mut self, frame: FrameRef<'_>, unix_us: u64) -> Option<FrameBuf> {
        if frame.version() != MavlinkVersion::V2 || self.signed(frame) {
            return None;
        }
        // two frames must not share a time
        self.last = SignatureTime::from_unix_us(unix_us).max(self.last.next());
        let (time, link_id) = (self.last.bytes(), self.link_id);
        let plain = covered(frame);
        Some(FrameBuf::build(MavlinkVersion::V2, |bytes| {
            let end = plain.len() - CHECKSUM;
            bytes[..end].copy_from_slice(&plain[..end]);
            let change = flag_change(end - 1, bytes[2]).to_le_bytes();
            bytes[2] |= SIGNED;
            for ((to, was), change) in bytes[end..end + CHECKSUM].iter_mut().zip(&plain[end..]).zip(change) {
                *to = was ^ change;
            }
            let digest = self.key.digest(&bytes[..end + CHECKSUM], link_id, time);
            let signature = &mut bytes[end + CHECKSUM..end + CHECKSUM + SIGNATURE];
            signature[0] = link_id;
            signature[1..7].copy_from_slice(&time);
            signature[7..].copy_from_slice(&digest);
            end + CHECKSUM + SIGNATURE
        }))
    }

    /// Was it signed with this key?
    fn signed(&self, frame: FrameRef<'_>) -> bool {
        Signature::of(frame).is_some_and(|s| s.digest == self.key.digest(covered(frame), s.link_id, s.time.bytes()))
    }
}

/// What the flag of a signature changes in the checksum of so many bytes, the first of which is the payload's length.
///
/// The checksum is affine in its bytes, so the change is the same whatever they are: messages that no dialect here knows
/// can be signed too.
fn flag_change(length: usize, flags: u8) -> u16 {
    if flags & SIGNED != 0 {
        return 0;
    }
    let (zeros, mut flag) = ([0; 280], [0; 280]);
    flag[1] = SIGNED;
    checksum(&flag[..length], 0) ^ checksum(&zeros[..length], 0)
}

/// The part of a signed frame that its signature covers.
fn covered(frame: FrameRef<'_>) -> &[u8] {
    let end = HEADER_V2 + frame.payload().len() + CHECKSUM;
    frame.bytes().get(..end).unwrap_or_default()
}
