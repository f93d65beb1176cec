use super::{Row, RowSink};
use crate::record::error::RecordError;
use std::fs::File;
use std::path::Path;

/// Reads a dataflash log. Its parser looks for the next message behind damage, so nothing is known to be missing.
pub(super) fn read(path: &Path, sink: &mut RowSink<'_>) -> Result<bool, RecordError> {
    let file = File::open(path).map_err(|source| RecordError::Open { path: path.to_owned(), source })?;
    for entry in ardupilot_binlog::Reader::new(file) {
        let entry = entry.map_err(|e| RecordError::Damaged(e.to_string()))?;
        if sink(Row::Dataflash(&entry)).is_break() {
            break;
        }
    }
    Ok(true)
}
