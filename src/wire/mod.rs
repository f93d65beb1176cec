//! MAVLink on the wire: frames, dialects, statistics, logs. No sockets, no clock, no async runtime.
//!
//! In: bytes, from a stream ([`Parser`]), from datagrams ([`datagram`]) or from a log ([`tlog`]). Out: [`Event`]s that
//! borrow those bytes: whole untouched frames ([`FrameRef`]) and the stretches that are no frame ([`BadFrame`]).
//! Payloads are read as generated types ([`decode`]) or field by field ([`Fields`]) where a message must survive enum
//! values that this version of the dialect does not know. [`Encoder`] makes frames of messages. [`stats`] counts what
//! a link carries. Every time is an argument, in microseconds.
//!
//! Imports nothing from the rest of the crate.

mod catalog;
mod checksum;
pub mod definitions;
pub mod dialect;
mod encode;
mod event;
mod fields;
mod frame;
mod parser;
mod scan;
pub mod signing;
pub mod stats;
pub mod tlog;

pub use catalog::{MessageInfo, message_info, messages};
pub use encode::{EncodeError, Encoder, FrameHeader};
pub use event::{BadFrame, BadReason, Event};
pub use fields::{Fields, decode};
pub use frame::{Check, FrameBuf, FrameRef, MAX_FRAME_LEN};
pub use mavlink_core::MavlinkVersion;
pub use parser::{Datagram, Parser, datagram};
