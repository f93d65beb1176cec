//! Any log as frames.

use super::error::RecordError;
use super::files::FileKind;
use super::foreign;
use super::reader::McapReader;
use crate::wire::Event;
use crate::wire::tlog::{LogFormat, Record, TlogReader};
use std::ops::ControlFlow;
use std::path::Path;

/// What a log turned out to be.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct LogFacts {
    pub kind: FileKind,
    /// It holds receive times.
    pub stamped: bool,
    /// Its end is missing.
    pub cut_off: bool,
}

/// Hears of a log's records, in order, and may end the reading.
pub type RecordSink<'a> = dyn FnMut(&Record<'_>) -> ControlFlow<()> + 'a;

/// Reads a telemetry log, a stream without times, a recording, a ULog or a dataflash log as frames. What it is, its first
/// bytes tell. Memory does not grow with the log.
///
/// # Errors
/// It cannot be read, or is none of these.
pub fn read_log(path: &Path, sink: &mut RecordSink<'_>) -> Result<LogFacts, RecordError> {
    let kind = FileKind::of(path)?;
    let mut facts = LogFacts { kind, stamped: true, cut_off: false };
    match kind {
        FileKind::Telemetry => {
            let mut reader = TlogReader::open(path)?;
            facts.stamped = reader.format() == LogFormat::Stamped;
            while let Some(record) = reader.next()? {
                if sink(&record).is_break() {
                    break;
                }
            }
        }
        FileKind::Mcap => {
            let mut reader = McapReader::open(path)?;
            while let Some(record) = reader.next()? {
                if sink(&record).is_break() {
                    return Ok(facts);
                }
            }
            if !reader.has_link_topics() {
                return Err(RecordError::Unsupported("no MAVLink topic in this recording".to_owned()));
            }
            facts.stamped = reader.is_stamped();
            facts.cut_off = reader.is_cut_off();
        }
        FileKind::Ulog | FileKind::Dataflash => {
            let complete = foreign::read_frames(path, kind, &mut |received_us, frame| {
                let stamp = received_us.to_be_bytes();
                sink(&Record { received_unix_us: Some(received_us), stamp: &stamp, event: Event::Frame(frame) })
            })?;
            facts.cut_off = !complete;
        }
    }
    Ok(facts)
}
