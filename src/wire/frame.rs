//! One whole frame, as it came: borrowed ([`FrameRef`]) or kept ([`FrameBuf`]).

use super::catalog::message_info;
use super::fields::Fields;
use mavlink_core::{MavlinkVersion, consts};
use std::fmt;

/// First byte of a MAVLink 1 frame.
pub(super) const MAGIC_V1: u8 = mavlink_core::MAV_STX;
/// First byte of a MAVLink 2 frame.
pub(super) const MAGIC_V2: u8 = mavlink_core::MAV_STX_V2;
/// Bytes before the payload, magic included.
pub(super) const HEADER_V1: usize = consts::STX_SIZE + consts::v1::HEADER_SIZE;
/// Bytes before the payload, magic included.
pub(super) const HEADER_V2: usize = consts::STX_SIZE + consts::v2::MIN_HEADER_SIZE;
pub(super) const CHECKSUM: usize = consts::CHECKSUM_SIZE;
pub(super) const SIGNATURE: usize = consts::v2::SIGNATURE_SIZE;

/// Length of the longest frame: MAVLink 2, full payload, signed.
pub const MAX_FRAME_LEN: usize = HEADER_V2 + consts::MAX_PAYLOAD_LEN + CHECKSUM + SIGNATURE;

/// How much is known about a frame's integrity.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Check {
    /// The checksum is right.
    Verified,
    /// No dialect here defines the message, so its checksum cannot be computed: the frame was cut out by the length
    /// in its header.
    UnknownMessage,
}

/// A whole frame that borrows the bytes it came in.
#[derive(Clone, Copy, PartialEq, Eq)]
pub struct FrameRef<'a> {
    // Invariant, established by `scan::inspect`: `bytes` begins with the magic of `version` and is exactly as long as
    // its header says, so every offset below lies within it.
    bytes: &'a [u8],
    version: MavlinkVersion,
    check: Check,
}

impl<'a> FrameRef<'a> {
    /// `bytes` must be one whole frame of this version.
    pub(super) fn new(bytes: &'a [u8], version: MavlinkVersion, check: Check) -> Self {
        debug_assert!(bytes.len() > HEADER_V1 && bytes.len() <= MAX_FRAME_LEN);
        Self { bytes, version, check }
    }

    /// The frame as it was received, from magic to checksum or signature.
    pub fn bytes(self) -> &'a [u8] {
        self.bytes
    }

    pub fn version(self) -> MavlinkVersion {
        self.version
    }

    pub fn check(self) -> Check {
        self.check
    }

    pub fn sequence(self) -> u8 {
        self.header_byte(2, 4)
    }

    pub fn system_id(self) -> u8 {
        self.header_byte(3, 5)
    }

    pub fn component_id(self) -> u8 {
        self.header_byte(4, 6)
    }

    pub fn message_id(self) -> u32 {
        match self.version {
            MavlinkVersion::V1 => u32::from(self.bytes[5]),
            MavlinkVersion::V2 => u32::from_le_bytes([self.bytes[7], self.bytes[8], self.bytes[9], 0]),
        }
    }

    /// The payload as sent: MAVLink 2 cuts trailing zeros, see [`Fields`].
    pub fn payload(self) -> &'a [u8] {
        let start = self.header_len();
        &self.bytes[start..start + usize::from(self.bytes[1])]
    }

    /// The payload with the zeros that MAVLink 2 cut.
    pub fn fields(self) -> Fields<'a> {
        Fields::new(self.payload())
    }

    /// The checksum as sent.
    pub fn checksum(self) -> u16 {
        let at = self.header_len() + usize::from(self.bytes[1]);
        u16::from_le_bytes([self.bytes[at], self.bytes[at + 1]])
    }

    /// Link id, timestamp and signature of a signed frame, 13 bytes.
    pub fn signature(self) -> Option<&'a [u8]> {
        let unsigned = self.header_len() + usize::from(self.bytes[1]) + CHECKSUM;
        self.bytes.get(unsigned..).filter(|rest| !rest.is_empty())
    }

    /// System and component that the message is addressed to; zero means every one. `None` if the message names no
    /// target or is unknown.
    pub fn target(self) -> Option<(u8, u8)> {
        let info = message_info(self.message_id())?;
        let fields = self.fields();
        let system = fields.u8(info.target_system?.into());
        let component = info.target_component.map_or(0, |offset| fields.u8(offset.into()));
        Some((system, component))
    }

    /// Name of the message, if a dialect here defines it.
    pub fn message_name(self) -> Option<&'static str> {
        message_info(self.message_id()).map(|info| info.name)
    }

    fn header_byte(self, v1: usize, v2: usize) -> u8 {
        match self.version {
            MavlinkVersion::V1 => self.bytes[v1],
            MavlinkVersion::V2 => self.bytes[v2],
        }
    }

    fn header_len(self) -> usize {
        match self.version {
            MavlinkVersion::V1 => HEADER_V1,
            MavlinkVersion::V2 => HEADER_V2,
        }
    }
}

impl fmt::Debug for FrameRef<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Frame")
            .field("version", &self.version)
            .field("system", &self.system_id())
            .field("component", &self.component_id())
            .field("sequence", &self.sequence())
            .field("message", &self.message_name().unwrap_or("unknown"))
            .field("message_id", &self.message_id())
            .field("check", &self.check)
            .field("payload", &self.payload())
            .finish()
    }
}

/// A whole frame that owns its bytes without allocating.
#[derive(Clone)]
pub struct FrameBuf {
    // The first `len` bytes satisfy the invariant of `FrameRef`.
    bytes: [u8; MAX_FRAME_LEN],
    len: u16,
    version: MavlinkVersion,
    check: Check,
}

impl FrameBuf {
    /// Builds a frame in place: `write` fills the buffer with one whole frame and returns its length.
    pub(super) fn build(version: MavlinkVersion, write: impl FnOnce(&mut [u8; MAX_FRAME_LEN]) -> usize) -> Self {
        let mut bytes = [0; MAX_FRAME_LEN];
        let len = write(&mut bytes);
        debug_assert!(len <= MAX_FRAME_LEN);
        Self { bytes, len: len as u16, version, check: Check::Verified }
    }

    /// A view of it. (`AsRef` cannot express one: it is a value that borrows, not a reference.)
    pub fn as_ref(&self) -> FrameRef<'_> {
        FrameRef::new(self.bytes(), self.version, self.check)
    }

    pub fn bytes(&self) -> &[u8] {
        &self.bytes[..usize::from(self.len)]
    }
}

impl From<FrameRef<'_>> for FrameBuf {
    fn from(frame: FrameRef<'_>) -> Self {
        let mut bytes = [0; MAX_FRAME_LEN];
        bytes[..frame.bytes.len()].copy_from_slice(frame.bytes);
        Self { bytes, len: frame.bytes.len() as u16, version: frame.version, check: frame.check }
    }
}

impl PartialEq for FrameBuf {
    fn eq(&self, other: &Self) -> bool {
        self.as_ref() == other.as_ref()
    }
}

impl Eq for FrameBuf {}

impl fmt::Debug for FrameBuf {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.as_ref().fmt(f)
    }
}
