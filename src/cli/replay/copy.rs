use super::cannot_write;
use crate::cli::Failure;
use crate::pipeline::Snapshot;
use crate::record::{Encoding, McapWriter, NewFile, RecordError};
use crate::wire::tlog::Record;
use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};

/// A copy of the log with the estimates. For an autopilot's own log it holds what the observers were told of it.
pub(super) struct Copy {
    path: PathBuf,
    file: NewFile,
    writer: McapWriter<BufWriter<File>>,
    began: bool,
    name: String,
}

impl Copy {
    pub fn begin(log: &Path, to: &Path, force: bool) -> Result<Self, Failure> {
        let begun = NewFile::create(to, force).and_then(|file| {
            let writer = McapWriter::new(BufWriter::new(file.file()?), Encoding::Protobuf)?;
            Ok((file, writer))
        });
        let (file, writer) = begun.map_err(|e| Failure::Failed(e.to_string()))?;
        let name = log.file_name().map_or_else(String::new, |n| n.to_string_lossy().into_owned());
        Ok(Self { path: to.to_owned(), file, writer, began: false, name })
    }

    pub fn record(&mut self, record: &Record<'_>) -> Result<(), Failure> {
        // the first record of a log with times has one, unless it is damaged: then a time is made up for the copy
        let stamped = record.received_unix_us.is_some() || !record.stamp.is_empty();
        let mut write = || {
            if !self.began {
                self.began = true;
                self.writer.source(&self.name, if stamped { "tlog" } else { "raw" })?;
            }
            self.writer.record(record, stamped)
        };
        write().map_err(|e| cannot_write(&self.path, &e))
    }

    pub fn snapshot(&mut self, s: &Snapshot<'_>) -> Result<(), Failure> {
        self.writer.snapshot(s).map_err(|e| cannot_write(&self.path, &e))
    }

    pub fn finish(self) -> Result<(), Failure> {
        let Self { path, file, writer, .. } = self;
        let done = writer.finish(Default::default()).and_then(|mut sink| sink.flush().map_err(RecordError::Write));
        done.and_then(|()| file.commit()).map(drop).map_err(|e| cannot_write(&path, &e))
    }
}
