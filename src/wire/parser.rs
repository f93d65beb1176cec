//! Bytes in, events out, for streams and for datagrams.

use super::event::Event;
use super::frame::MAX_FRAME_LEN;
use super::scan::{Found, Scanner};

/// Cuts a byte stream (serial, TCP) into frames, whatever the chunks it arrives in.
///
/// ```
/// use mavobserver::wire::{Event, Parser};
/// let mut parser = Parser::new();
/// parser.push(b"noise");
/// parser.push(&[0xFE, 9, 0, 1, 1, 0, 0, 0, 0, 0, 2, 3, 81, 4, 3, 28, 127]);
/// while let Some(event) = parser.next() {
///     if let Event::Frame(frame) = event {
///         assert_eq!(frame.message_name(), Some("HEARTBEAT"));
///     }
/// }
/// ```
///
/// # Resynchronising
/// After bytes that are no frame the search goes on at the very next byte, so a damaged length cannot swallow the
/// frames behind it. Candidates that fail inside a failed candidate belong to the same damage: a corrupted frame between
/// two good ones is one [`BadFrame`](super::BadFrame). Bytes that begin no candidate are reported in runs of at most
/// [`MAX_FRAME_LEN`].
///
/// # Unknown messages
/// The checksum of a message that no dialect here defines cannot be computed, so a stray magic byte in damaged data
/// could pass for one. Such a frame is taken as long as its header says, but only if it begins outside any damaged
/// frame, no verified frame begins inside it, and it either directly follows a good frame or is followed by a magic
/// byte or the end of the data. A frame whose checksum is right is therefore never lost to an unknown one.
///
/// # Memory
/// The buffer holds what was pushed and not yet taken out. Taking all events after every push keeps it at one frame
/// more than the largest push, and once it has that size nothing allocates.
#[derive(Debug)]
pub struct Parser {
    buffer: Vec<u8>,
    scanner: Scanner,
    ended: bool,
}

impl Parser {
    pub fn new() -> Self {
        Self { buffer: Vec::with_capacity(16 * MAX_FRAME_LEN), scanner: Scanner::new(false), ended: false }
    }

    /// Appends received bytes.
    pub fn push(&mut self, bytes: &[u8]) {
        self.buffer.drain(..self.scanner.start());
        self.scanner.rebase();
        self.buffer.extend_from_slice(bytes);
        self.ended = false;
    }

    /// Declares the end of the stream: what is left comes out as frames or as bad.
    pub fn finish(&mut self) {
        self.ended = true;
    }

    /// The next event, or `None` until more bytes are pushed.
    #[allow(clippy::should_implement_trait)] // an iterator's items cannot borrow from it
    pub fn next(&mut self) -> Option<Event<'_>> {
        let found = self.find()?;
        Some(self.event(&found))
    }

    /// The next event, for those who cannot borrow yet; [`Self::event`] makes it one before the next push.
    pub(super) fn find(&mut self) -> Option<Found> {
        self.scanner.next(&self.buffer, self.ended)
    }

    pub(super) fn event(&self, found: &Found) -> Event<'_> {
        found.event(&self.buffer)
    }
}

impl Default for Parser {
    fn default() -> Self {
        Self::new()
    }
}

/// The events of one datagram, without copying it. A frame never continues in the next datagram, so what is left at the
/// end is bad.
pub fn datagram(bytes: &[u8]) -> Datagram<'_> {
    Datagram { bytes, scanner: Scanner::new(true) }
}

/// See [`datagram`].
#[derive(Debug, Clone)]
pub struct Datagram<'a> {
    bytes: &'a [u8],
    scanner: Scanner,
}

impl<'a> Iterator for Datagram<'a> {
    type Item = Event<'a>;

    fn next(&mut self) -> Option<Event<'a>> {
        self.scanner.next(self.bytes, true).map(|found| found.event(self.bytes))
    }
}
