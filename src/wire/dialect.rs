//! The message types: ArduPilot's dialect with `common`, MAVLink's `development` messages, and our own.

pub use mavlink::dialects::{ardupilotmega, development};

/// The messages that carry our estimates, generated from `dialects/mavobserver.xml`.
pub use generated::mavobserver;

#[allow(missing_docs, non_camel_case_types, non_snake_case, clippy::all)]
mod generated {
    include!(concat!(env!("OUT_DIR"), "/mod.rs"));
}
