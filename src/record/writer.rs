use super::error::RecordError;
use super::publisher::{Arrival, ChannelSink, Counts, Encoding, NewChannel, Publisher};
use super::topics;
use crate::wire::Event;
use crate::wire::tlog::Record;
use mcap::records::MessageHeader;
use std::collections::BTreeMap;
use std::io::{Seek, Write};
use std::ops::{Deref, DerefMut};

/// Size at which a chunk is closed, uncompressed bytes: a reader that seeks decompresses one.
const CHUNK: u64 = 1 << 20;

/// Writes an MCAP file: what a [`Publisher`] makes of frames and estimates, metadata, attachments, index.
pub struct McapWriter<W: Write + Seek> {
    publisher: Publisher<mcap::Writer<W>>,
}

impl<W: Write + Seek> ChannelSink for McapWriter<W> {
    fn channel(&mut self, new: &NewChannel<'_>) -> Result<u16, RecordError> {
        self.publisher.sink.channel(new)
    }

    fn message(&mut self, header: &MessageHeader, data: &[u8]) -> Result<(), RecordError> {
        self.publisher.sink.message(header, data)
    }
}

impl<W: Write + Seek> ChannelSink for mcap::Writer<W> {
    fn channel(&mut self, new: &NewChannel<'_>) -> Result<u16, RecordError> {
        let schema = self.add_schema(new.schema_name, new.schema_encoding, new.schema).map_err(RecordError::writing)?;
        self.add_channel(schema, new.topic, new.encoding, new.metadata).map_err(RecordError::writing)
    }

    fn message(&mut self, header: &MessageHeader, data: &[u8]) -> Result<(), RecordError> {
        self.write_to_known_channel(header, data).map_err(RecordError::writing)
    }
}

impl<W: Write + Seek> Deref for McapWriter<W> {
    type Target = Publisher<mcap::Writer<W>>;

    fn deref(&self) -> &Self::Target {
        &self.publisher
    }
}

impl<W: Write + Seek> DerefMut for McapWriter<W> {
    fn deref_mut(&mut self) -> &mut Self::Target {
        &mut self.publisher
    }
}

impl<W: Write + Seek> McapWriter<W> {
    /// # Errors
    /// The sink cannot be written to.
    pub fn new(sink: W, encoding: Encoding) -> Result<Self, RecordError> {
        let options = mcap::WriteOptions::new()
            .library(concat!("mavobserver ", env!("CARGO_PKG_VERSION")))
            .chunk_size(Some(CHUNK))
            // a chunk reaches the file whole or not at all, so a cut-off file ends within a record and nowhere else
            .disable_seeking(true)
            // little is lost with floating-point telemetry, and it takes half the time of the usual level
            .compression_level(1)
            // several files are converted at once instead
            .compression_threads(0);
        let sink = options.create(sink).map_err(RecordError::writing)?;
        Ok(Self { publisher: Publisher::new(sink, encoding) })
    }

    /// Records what stands in a log; `stamped` says whether that log holds receive times.
    ///
    /// # Errors
    /// Those of the sink.
    pub fn record(&mut self, record: &Record<'_>, stamped: bool) -> Result<(), RecordError> {
        let arrival = Arrival::of(record, stamped);
        match record.event {
            Event::Frame(frame) => self.frame(0, arrival, frame),
            Event::Bad(bad) => self.bad(arrival, &bad),
        }
    }

    /// Says what a recording is made from: the name of the source, and its format.
    ///
    /// # Errors
    /// Those of the sink.
    pub fn source(&mut self, name: &str, format: &str) -> Result<(), RecordError> {
        let source = [("name", name), ("format", format)].map(|(k, v)| (k.to_owned(), v.to_owned()));
        self.metadata(topics::SOURCE, source.into())
    }

    /// Adds a metadata record.
    ///
    /// # Errors
    /// Those of the sink.
    pub fn metadata(&mut self, name: &str, metadata: BTreeMap<String, String>) -> Result<(), RecordError> {
        let record = mcap::records::Metadata { name: name.to_owned(), metadata };
        self.publisher.sink.write_metadata(&record).map_err(RecordError::writing)
    }

    /// Adds a file.
    ///
    /// # Errors
    /// Those of the sink.
    pub fn attach(&mut self, name: &str, media_type: &str, data: &[u8]) -> Result<(), RecordError> {
        let attachment = mcap::Attachment {
            log_time: self.publisher.last_ns,
            create_time: self.publisher.last_ns,
            name: name.to_owned(),
            media_type: media_type.to_owned(),
            data: data.into(),
        };
        self.publisher.sink.attach(&attachment).map_err(RecordError::writing)
    }

    /// Closes the chunk and flushes the sink: everything up to here can be read even if nothing follows.
    ///
    /// # Errors
    /// Those of the sink.
    pub fn flush(&mut self) -> Result<(), RecordError> {
        self.publisher.sink.flush().map_err(RecordError::writing)
    }

    /// Writes what was found in the messages, then index and footer; returns the sink.
    ///
    /// # Errors
    /// Those of the sink.
    pub fn finish(mut self, mut summary: BTreeMap<String, String>) -> Result<W, RecordError> {
        let Counts { frames, unknown, bad, bad_bytes } = self.counts();
        for (key, n) in [("frames", frames), ("unknown", unknown), ("bad", bad), ("bad_bytes", bad_bytes)] {
            summary.insert(key.to_owned(), n.to_string());
        }
        self.inventory().describe(&mut summary);
        for (name, text) in self.inventory().parameter_files() {
            self.attach(&name, "text/plain", text.as_bytes())?;
        }
        self.metadata(topics::SUMMARY, summary)?;
        self.publisher.sink.finish().map_err(RecordError::writing)?;
        Ok(self.publisher.sink.into_inner())
    }
}
