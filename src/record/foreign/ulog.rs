use super::{Row, RowSink};
use crate::record::error::RecordError;
use px4_ulog::stream_parser::file_reader::{Message, SimpleCallbackResult, read_file_with_simple_callback};
use std::path::Path;

/// Reads a ULog; `false` if its end is missing.
pub(super) fn read(path: &Path, sink: &mut RowSink<'_>) -> Result<bool, RecordError> {
    let name = path.to_str().ok_or_else(|| RecordError::Unsupported("the path is not UTF-8".to_owned()))?;
    let mut told = |message: &Message<'_>| match message {
        Message::Data(data) if sink(Row::Ulog(data)).is_break() => SimpleCallbackResult::Stop,
        _ => SimpleCallbackResult::KeepReading,
    };
    let completeness = read_file_with_simple_callback(name, &mut told).map_err(RecordError::Read)?;
    Ok(!completeness.is_incomplete())
}
