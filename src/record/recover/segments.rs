//! Where the records of a damaged MCAP file begin and end.

use crate::record::error::RecordError;
use crate::record::reader::LONGEST_RECORD;
use std::fs::File;
use std::io::{self, Read, Seek, SeekFrom};
use std::path::Path;

const MAGIC: [u8; 8] = [0x89, b'M', b'C', b'A', b'P', b'0', b'\r', b'\n'];
/// Opcode and length.
const HEADER: u64 = 9;
const CHUNK: u8 = 0x06;
const LAST_OPCODE: u8 = 0x0F;
/// Longer records are taken for damaged lengths.
const LONGEST: u64 = LONGEST_RECORD as u64;
/// Bytes of a chunk before its records: two times, size, checksum, name of the compression, and the records' length.
const CHUNK_HEAD: usize = 8 + 8 + 8 + 4 + 4 + 4 + 8;
const WINDOW: usize = 1 << 20;

/// A stretch of the file.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) enum Segment {
    /// A record by its own length; what it holds is not checked.
    Record { at: u64, opcode: u8, len: u64 },
    /// A chunk that the file's end cuts off.
    CutChunk { at: u64, len: u64 },
    /// No record begins here.
    Damaged { at: u64, len: u64 },
}

/// Walks over a file. After damage it goes on at the next chunk, which can be told from chance by its own lengths.
pub(super) struct Segments {
    file: File,
    size: u64,
    at: u64,
}

impl Segments {
    pub fn open(path: &Path) -> Result<Self, RecordError> {
        let file = File::open(path).map_err(|source| RecordError::Open { path: path.to_owned(), source })?;
        let size = file.metadata().map_err(RecordError::Read)?.len();
        Ok(Self { file, size, at: 0 })
    }

    /// The bytes of a stretch.
    pub fn bytes(&mut self, at: u64, len: u64) -> Result<Vec<u8>, RecordError> {
        let mut bytes = Vec::new();
        let read = self.file.seek(SeekFrom::Start(at)).and_then(|_| (&self.file).take(len).read_to_end(&mut bytes));
        read.map_err(RecordError::Read)?;
        Ok(bytes)
    }

    pub fn next(&mut self) -> Result<Option<Segment>, RecordError> {
        if self.at == 0 {
            self.at = MAGIC.len() as u64;
            if self.bytes(0, self.at)? != MAGIC {
                // the records may still be there
                self.at = self.at.min(self.size);
                return Ok(Some(Segment::Damaged { at: 0, len: self.at }));
            }
        }
        let at = self.at;
        let left = self.size.saturating_sub(at);
        if left == 0 || (left == MAGIC.len() as u64 && self.bytes(at, left)? == MAGIC) {
            return Ok(None);
        }
        let head = self.bytes(at, HEADER)?;
        if let Some((opcode, body)) = header(&head) {
            let len = HEADER + body;
            if (1..=LAST_OPCODE).contains(&opcode) && body <= LONGEST && len <= left {
                let head = self.bytes(at + HEADER, CHUNK_HEAD as u64)?;
                if opcode != CHUNK || is_chunk(&head, body) {
                    self.at = at + len;
                    return Ok(Some(Segment::Record { at, opcode, len }));
                }
            } else if opcode == CHUNK && len > left {
                let head = self.bytes(at + HEADER, CHUNK_HEAD as u64)?;
                if is_chunk(&head, body) {
                    self.at = self.size;
                    return Ok(Some(Segment::CutChunk { at, len: left }));
                }
            }
        }
        self.at = self.find_chunk(at + 1)?;
        Ok(Some(Segment::Damaged { at, len: self.at - at }))
    }

    /// The next chunk from here, or the end of the file.
    fn find_chunk(&mut self, from: u64) -> Result<u64, RecordError> {
        const HEAD: usize = HEADER as usize + CHUNK_HEAD;
        let mut window = vec![0; WINDOW + HEAD];
        let mut begin = from;
        while begin < self.size {
            self.file.seek(SeekFrom::Start(begin)).map_err(RecordError::Read)?;
            let filled = fill(&mut self.file, &mut window).map_err(RecordError::Read)?;
            let data = &window[..filled];
            for i in (0..filled.min(WINDOW)).filter(|&i| data[i] == CHUNK) {
                let candidate = header(&data[i..]).map(|(_, body)| body);
                let head = data.get(i + HEADER as usize..).unwrap_or_default();
                if candidate.is_some_and(|body| body <= LONGEST && is_chunk(head, body)) {
                    return Ok(begin + i as u64);
                }
            }
            begin += WINDOW as u64;
        }
        Ok(self.size)
    }
}

fn header(bytes: &[u8]) -> Option<(u8, u64)> {
    let (&opcode, rest) = bytes.split_first()?;
    Some((opcode, u64::from_le_bytes(*rest.first_chunk()?)))
}

/// Whether a chunk's inner lengths fit its own length and its compression is one that is known.
fn is_chunk(head: &[u8], body: u64) -> bool {
    let name_len = |at: usize| Some(u32::from_le_bytes(*head.get(at..)?.first_chunk()?) as usize);
    let Some(len) = name_len(28) else { return false };
    let name = head.get(32..32 + len.min(8)).unwrap_or_default();
    if len > 4 || !matches!(name, b"" | b"zstd" | b"lz4") {
        return false;
    }
    let records = head.get(32 + len..).and_then(|rest| rest.first_chunk()).map(|b| u64::from_le_bytes(*b));
    records.is_some_and(|records| records.checked_add(32 + len as u64 + 8) == Some(body))
}

fn fill(file: &mut File, buffer: &mut [u8]) -> io::Result<usize> {
    let mut filled = 0;
    while filled < buffer.len() {
        match file.read(&mut buffer[filled..])? {
            0 => break,
            n => filled += n,
        }
    }
    Ok(filled)
}
