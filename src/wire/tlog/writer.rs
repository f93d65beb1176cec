use crate::wire::FrameRef;
use std::io::{self, Write};

/// Writes a `.tlog`.
#[derive(Debug)]
pub struct TlogWriter<W> {
    sink: W,
}

impl<W: Write> TlogWriter<W> {
    /// `sink` should be buffered: every frame is two small writes.
    pub fn new(sink: W) -> Self {
        Self { sink }
    }

    /// Appends one frame with its receive time, microseconds since 1970.
    ///
    /// # Errors
    /// Those of the sink.
    pub fn write(&mut self, received_unix_us: u64, frame: FrameRef<'_>) -> io::Result<()> {
        self.sink.write_all(&received_unix_us.to_be_bytes())?;
        self.sink.write_all(frame.bytes())
    }

    /// Appends one frame without a time: an `.rlog` holds nothing else.
    ///
    /// # Errors
    /// Those of the sink.
    pub fn write_raw(&mut self, frame: FrameRef<'_>) -> io::Result<()> {
        self.sink.write_all(frame.bytes())
    }

    /// # Errors
    /// Those of the sink.
    pub fn flush(&mut self) -> io::Result<()> {
        self.sink.flush()
    }

    pub fn into_inner(self) -> W {
        self.sink
    }
}
