//! The daemon's configuration: TOML in, a checked config out, or every issue at once with its place.
//!
//! Imports `document`.

mod link_url;

pub use link_url::{LinkUrl, LinkUrlError, Pace};
