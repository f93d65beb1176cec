//! What is left of a damaged file, as a file that reads without complaint, and an account of what was lost.

mod log;
mod mcap;
mod segments;

pub use log::recover_log;
pub use mcap::recover_mcap;

use std::ops::Range;

/// What a recovery saved and what it did not.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Recovered {
    /// Frames of a telemetry log, or messages of a recording.
    pub messages: u64,
    /// Metadata records and attached files of a recording.
    pub extras: u64,
    pub lost: Vec<Lost>,
    /// The index at the end had to be made anew.
    pub index_rebuilt: bool,
}

/// A stretch of the damaged file that is not in the new one.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Lost {
    /// Byte positions in the damaged file.
    pub bytes: Range<u64>,
    pub what: String,
}

impl Recovered {
    pub fn lost_bytes(&self) -> u64 {
        self.lost.iter().map(|l| l.bytes.end - l.bytes.start).sum()
    }

    /// Notes a loss; one that directly follows another is told with it.
    fn lose(&mut self, bytes: Range<u64>, what: impl Into<String>) {
        if bytes.is_empty() {
            return;
        }
        match self.lost.last_mut() {
            Some(last) if last.bytes.end == bytes.start => last.bytes.end = bytes.end,
            _ => self.lost.push(Lost { bytes, what: what.into() }),
        }
    }
}

#[cfg(test)]
mod tests;
