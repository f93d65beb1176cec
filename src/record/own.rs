//! Schemas of what is no MAVLink message: bad bytes, unknown messages, gaps.

use super::proto::{PutProto, SchemaBuilder};
use crate::wire::{BadFrame, BadReason, FrameRef};
use prost_types::field_descriptor_proto::Type;

/// Package of our own schemas.
pub(super) const PACKAGE: &str = "mavobserver";

pub(super) const BAD: &str = "BadBytes";
pub(super) const UNKNOWN: &str = "UnknownMessage";
pub(super) const GAP: &str = "Gap";

/// Field numbers that reading back relies on.
pub(super) const BYTES: u32 = 2;
pub(super) const STAMP: u32 = 3;
const REASON: u32 = 1;
const MESSAGE_ID: u32 = 4;

pub(super) fn bad_schema() -> Vec<u8> {
    SchemaBuilder::new(BAD)
        .field(REASON, "reason", Type::String)
        .field(BYTES, "bytes", Type::Bytes)
        .field(STAMP, "raw_stamp", Type::Bytes)
        .comment("what stood in place of the receive time, if that is not the log time")
        .field(MESSAGE_ID, "message_id", Type::Uint32)
        .encode(PACKAGE)
}

/// `stamp` as in [`super::proto::Plan::encode`].
pub(super) fn put_bad(bad: &BadFrame<'_>, stamp: Option<&[u8]>, out: &mut Vec<u8>) {
    out.put_bytes(REASON, bad.reason.to_string().as_bytes());
    out.put_bytes(BYTES, bad.bytes);
    if let Some(stamp) = stamp {
        out.put_bytes(STAMP, stamp);
    }
    if let BadReason::Checksum { message_id, .. } | BadReason::UnconfirmedUnknown { message_id } = bad.reason {
        out.put_u64(MESSAGE_ID, message_id.into());
    }
}

pub(super) fn unknown_schema() -> Vec<u8> {
    SchemaBuilder::new(UNKNOWN)
        .field(MESSAGE_ID, "message_id", Type::Uint32)
        .field(BYTES, "frame", Type::Bytes)
        .comment("as received; no dialect here defines the message, so its checksum was not verified")
        .field(STAMP, "raw_stamp", Type::Bytes)
        .encode(PACKAGE)
}

pub(super) fn put_unknown(frame: FrameRef<'_>, stamp: Option<&[u8]>, out: &mut Vec<u8>) {
    out.put_u64(MESSAGE_ID, frame.message_id().into());
    out.put_bytes(BYTES, frame.bytes());
    if let Some(stamp) = stamp {
        out.put_bytes(STAMP, stamp);
    }
}

pub(super) fn gap_schema() -> Vec<u8> {
    SchemaBuilder::new(GAP).field(1, "missed_frames", Type::Uint64).field(2, "reason", Type::String).encode(PACKAGE)
}

pub(super) fn put_gap(missed: u64, reason: &str, out: &mut Vec<u8>) {
    out.put_u64(1, missed);
    out.put_bytes(2, reason.as_bytes());
}
