//! Recordings in MCAP: written from frames and estimates, read back as frames, converted from and to telemetry logs.
//!
//! In: frames with their receive times, bad stretches, snapshots. Out: an MCAP file with one topic for each message of
//! each component ([`topics`]), protobuf schemas complete in themselves with units and enum names, log time = receive
//! time, publish time = the message's own time on the receiver's clock. Whatever a frame holds beyond its fields
//! (a signature, bytes behind a text's end, an unusual length) is kept beside them, so a log that becomes a recording and
//! a log again is the same, byte for byte. No clock and no async runtime; the daemon brings both.
//!
//! Imports `wire`, `signal`, `telemetry` and `pipeline`.

mod convert;
mod error;
mod estimates;
mod files;
pub mod foreign;
mod foxglove;
mod inventory;
mod json;
mod own;
mod proto;
mod publisher;
mod reader;
mod recover;
mod restore;
pub mod session;
mod source;
mod time;
pub mod topics;
mod writer;

pub use convert::{Converted, autopilot_log_to_mcap, log_to_mcap, mcap_to_log};
pub use error::RecordError;
pub use files::{FileKind, NewFile};
pub use inventory::Inventory;
pub use proto::message_schema;
pub use publisher::{Arrival, ChannelSink, Counts, Encoding, NewChannel, OwnedChannel, Publisher};
pub use reader::McapReader;
pub use recover::{Lost, Recovered, recover_log, recover_mcap};
pub use source::{LogFacts, RecordSink, read_log};
pub use writer::McapWriter;
