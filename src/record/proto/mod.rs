//! Protobuf: schemas from the dialects' tables, and messages written straight from payload bytes.

mod bytes;
mod descriptor;
mod plan;

pub(super) use bytes::{ProtoFields, PutProto, Value};
pub(super) use descriptor::SchemaBuilder;
pub use descriptor::message_schema;
pub use plan::{KeptFrame, PayloadError, Plan};
