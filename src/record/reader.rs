use super::error::RecordError;
use super::restore::Restore;
use super::topics;
use crate::wire::tlog::Record;
use mcap::records::{self};
use mcap::sans_io::linear_reader::{LinearReadEvent, LinearReader, LinearReaderOptions};
use std::collections::BTreeMap;
use std::fs::File;
use std::io::Read;
use std::path::Path;

/// No chunk or record of a recording is larger; a damaged length must not take the memory.
pub(super) const LONGEST_RECORD: usize = 64 << 20;
/// Bytes read at once.
const WINDOW: usize = 64 << 10;

/// Reads the frames of a recording in the order in which they were written, as if it were a telemetry log.
///
/// A recording that was cut off, by a killed process or a lost supply, ends without an error where it was last flushed.
/// Chunks are checked before anything of them comes out. Memory holds one chunk.
pub struct McapReader<R> {
    source: R,
    reader: LinearReader,
    restore: Restore,
    metadata: BTreeMap<String, BTreeMap<String, String>>,
    cut_off: bool,
    ended: bool,
}

impl McapReader<File> {
    /// # Errors
    /// The file cannot be opened.
    pub fn open(path: &Path) -> Result<Self, RecordError> {
        let file = File::open(path).map_err(|source| RecordError::Open { path: path.to_owned(), source })?;
        Ok(Self::new(file))
    }
}

impl<R: Read> McapReader<R> {
    /// `source` need not be buffered.
    pub fn new(source: R) -> Self {
        let options = LinearReaderOptions::default()
            .with_skip_end_magic(true)
            .with_prevalidate_chunk_crcs(true)
            .with_record_length_limit(LONGEST_RECORD);
        Self {
            source,
            reader: LinearReader::new_with_options(options),
            restore: Restore::new(),
            metadata: BTreeMap::new(),
            cut_off: false,
            ended: false,
        }
    }

    /// A metadata record, if it has been read by now.
    pub fn metadata(&self, name: &str) -> Option<&BTreeMap<String, String>> {
        self.metadata.get(name)
    }

    /// Whether the log that this was made from held receive times; known once the first frame is read.
    pub fn is_stamped(&self) -> bool {
        self.restore.stamped
    }

    /// Whether the recording ended before its footer.
    pub fn is_cut_off(&self) -> bool {
        self.cut_off
    }

    /// Whether a topic was seen that came over a link.
    pub fn has_link_topics(&self) -> bool {
        self.restore.has_link_topics()
    }

    /// The next frame or bad stretch.
    ///
    /// # Errors
    /// The source cannot be read, or the recording is damaged.
    #[allow(clippy::should_implement_trait)] // an iterator's items cannot borrow from it
    pub fn next(&mut self) -> Result<Option<Record<'_>>, RecordError> {
        while !self.ended {
            let (opcode, data) = match self.reader.next_event() {
                None => break,
                Some(Err(mcap::McapError::UnexpectedEof)) => break,
                Some(Err(error)) => return Err(RecordError::reading(error)),
                Some(Ok(LinearReadEvent::ReadRequest(n))) => {
                    let into = self.reader.insert(n.max(WINDOW));
                    let read = self.source.read(into).map_err(RecordError::Read)?;
                    self.reader.notify_read(read);
                    continue;
                }
                Some(Ok(LinearReadEvent::Record { opcode, data })) => (opcode, data),
            };
            match mcap::parse_record(opcode, data).map_err(RecordError::reading)? {
                records::Record::Channel(channel) => self.restore.channel(&channel)?,
                records::Record::Metadata(m) => {
                    if m.name == topics::SOURCE {
                        self.restore.stamped = m.metadata.get("format").is_none_or(|f| f != "raw");
                    }
                    self.metadata.insert(m.name, m.metadata);
                }
                records::Record::Message { header, data } if self.restore.message(&header, &data)? => {
                    return Ok(Some(self.restore.record()));
                }
                records::Record::DataEnd(_) => {
                    self.ended = true;
                    return Ok(None);
                }
                _ => {}
            }
        }
        self.cut_off |= !self.ended;
        self.ended = true;
        Ok(None)
    }
}
