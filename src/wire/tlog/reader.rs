use super::TlogError;
use super::format::{LogFormat, detect};
use super::stamped::{STAMP, Walk};
use crate::wire::{Event, MAX_FRAME_LEN, Parser};
use std::fs::File;
use std::io::{self, Read};
use std::path::Path;

/// Bytes read at once; also how far the format is searched for.
const WINDOW: usize = 64 * 1024;
/// Enough to see a record and the beginning of the next.
const LOOKAHEAD: usize = 2 * (STAMP + MAX_FRAME_LEN);

/// One entry of a log.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Record<'a> {
    /// When the frame was received, µs since 1970. A bad stretch and a frame whose stamp was damaged carry the time of
    /// the record before. `None` in a log without stamps.
    pub received_unix_us: Option<u64>,
    /// The bytes between the event before and this one: a stamp of eight bytes, or none. A bad stretch that hides where
    /// its stamps were holds them itself, so stamps and events together are the log, byte for byte.
    pub stamp: &'a [u8],
    pub event: Event<'a>,
}

/// Reads a `.tlog` or `.rlog` record by record.
#[derive(Debug)]
pub struct TlogReader<R> {
    source: R,
    state: State,
    ended: bool,
}

#[derive(Debug)]
enum State {
    /// The window holds `start..end` of unread bytes.
    Stamped {
        window: Box<[u8]>,
        start: usize,
        end: usize,
        walk: Walk,
    },
    Raw {
        window: Box<[u8]>,
        parser: Parser,
    },
}

impl TlogReader<File> {
    /// # Errors
    /// The file cannot be opened or read, is empty or is no MAVLink log.
    pub fn open(path: &Path) -> Result<Self, TlogError> {
        let file = File::open(path).map_err(|source| TlogError::Open { path: path.to_owned(), source })?;
        Self::new(file)
    }
}

impl<R: Read> TlogReader<R> {
    /// Reads the beginning and finds out the format. `source` need not be buffered.
    ///
    /// # Errors
    /// The source cannot be read, is empty or holds no MAVLink frame near its beginning.
    pub fn new(mut source: R) -> Result<Self, TlogError> {
        let mut window = vec![0; WINDOW].into_boxed_slice();
        let end = fill(&mut source, &mut window)?;
        let ended = end < window.len();
        let state = match detect(&window[..end], ended)? {
            LogFormat::Stamped => State::Stamped { window, start: 0, end, walk: Walk::default() },
            LogFormat::Raw => {
                let mut parser = Parser::new();
                parser.push(&window[..end]);
                if ended {
                    parser.finish();
                }
                State::Raw { window, parser }
            }
        };
        Ok(Self { source, state, ended })
    }

    pub fn format(&self) -> LogFormat {
        match self.state {
            State::Stamped { .. } => LogFormat::Stamped,
            State::Raw { .. } => LogFormat::Raw,
        }
    }

    /// The next record, or `None` at the end of the log.
    ///
    /// # Errors
    /// The source cannot be read.
    #[allow(clippy::should_implement_trait)] // an iterator's items cannot borrow from it
    pub fn next(&mut self) -> Result<Option<Record<'_>>, TlogError> {
        match &mut self.state {
            State::Stamped { window, start, end, walk } => {
                if *end - *start < LOOKAHEAD && !self.ended {
                    window.copy_within(*start..*end, 0);
                    *end -= std::mem::take(start);
                    *end += fill(&mut self.source, &mut window[*end..])?;
                    self.ended = *end < window.len();
                }
                let data = &window[*start..*end];
                if data.is_empty() {
                    return Ok(None);
                }
                let step = walk.step(data, self.ended);
                *start += step.consumed;
                // what a step takes ends with its event
                let stamp = &data[..step.consumed - step.event.bytes().len()];
                Ok(Some(Record { received_unix_us: step.received_unix_us, stamp, event: step.event }))
            }
            State::Raw { window, parser } => loop {
                if let Some(found) = parser.find() {
                    return Ok(Some(Record { received_unix_us: None, stamp: &[], event: parser.event(&found) }));
                }
                if self.ended {
                    return Ok(None);
                }
                let read = fill(&mut self.source, window)?;
                parser.push(&window[..read]);
                self.ended = read < window.len();
                if self.ended {
                    parser.finish();
                }
            },
        }
    }
}

/// Reads until the buffer is full or the source ends.
fn fill(source: &mut impl Read, buffer: &mut [u8]) -> io::Result<usize> {
    let mut filled = 0;
    while filled < buffer.len() {
        match source.read(&mut buffer[filled..]) {
            Ok(0) => break,
            Ok(read) => filled += read,
            Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
            Err(error) => return Err(error),
        }
    }
    Ok(filled)
}
