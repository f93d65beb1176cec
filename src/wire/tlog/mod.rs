//! Telemetry logs: a frame after its receive time, again and again.
//!
//! In: the bytes of a `.tlog` (8-byte big-endian microseconds since 1970, then a frame, as received) or of an `.rlog`
//! (the frames alone); which of the two is found out by looking. Out: [`Record`]s, in order. Damage of any kind
//! (failed checksums, missing or foreign bytes, a cut-off end, a damaged stamp) costs the damaged records only.
//! [`TlogReader`] reads in a window of fixed size, so a log may be larger than memory. [`TlogWriter`] writes the same
//! format.

mod format;
mod reader;
mod stamped;
mod writer;

pub use format::LogFormat;
pub use reader::{Record, TlogReader};
pub use writer::TlogWriter;

use std::io;
use std::path::PathBuf;

/// Why a log cannot be read. Damage inside a log is not an error, see [`super::Event::Bad`].
#[derive(Debug, thiserror::Error)]
pub enum TlogError {
    #[error("cannot open {}: {source}", path.display())]
    Open { path: PathBuf, source: io::Error },
    #[error("cannot read: {0}")]
    Read(#[from] io::Error),
    #[error("the log is empty")]
    Empty,
    #[error("no MAVLink frame in the first {searched} bytes{}", hint(*looks_like))]
    NotATlog { searched: usize, looks_like: Option<&'static str> },
}

fn hint(looks_like: Option<&str>) -> String {
    looks_like.map(|what| format!("; this looks like {what}")).unwrap_or_default()
}
