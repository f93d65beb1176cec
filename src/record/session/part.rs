//! The files that are being written now.

use super::Track;
use super::disk::Disk;
use super::policy::Policy;
use crate::record::error::RecordError;
use crate::record::publisher::{Arrival, ChannelSink, Encoding, OwnedChannel};
use crate::record::time::file_stamp;
use crate::record::writer::McapWriter;
use crate::wire::FrameRef;
use crate::wire::tlog::TlogWriter;
use mcap::records::MessageHeader;
use std::collections::HashMap;
use std::io::{self, BufWriter, Seek, SeekFrom, Write};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

const BUFFER: usize = 64 << 10;
/// Recordings that begin in one second are told apart by a number up to this.
const MOST_IN_ONE_SECOND: u32 = 99;

type Log<D> = TlogWriter<BufWriter<<D as Disk>::File>>;

pub(super) struct Part<D: Disk> {
    stem: String,
    begun_us: u64,
    with_sent: bool,
    received: Option<Log<D>>,
    sent: Option<Log<D>>,
    mcap: Option<McapWriter<Counted<BufWriter<D::File>>>>,
    /// Channels of announced messages, by topic.
    channels: HashMap<String, u16>,
    log_bytes: u64,
    mcap_bytes: Arc<AtomicU64>,
}

impl<D: Disk> Part<D> {
    pub fn create(disk: &mut D, policy: &Policy, now_us: u64) -> Result<Self, RecordError> {
        let time = file_stamp(now_us);
        let first = if policy.tlog { "tlog" } else { "mcap" };
        let mut part = Self {
            stem: String::new(),
            begun_us: now_us,
            with_sent: policy.tlog,
            received: None,
            sent: None,
            mcap: None,
            channels: HashMap::new(),
            log_bytes: 0,
            mcap_bytes: Arc::default(),
        };
        // two recordings may begin in one second
        for attempt in 1..=MOST_IN_ONE_SECOND {
            part.stem = if attempt == 1 { time.clone() } else { format!("{time}-{attempt}") };
            match disk.create(&format!("{}.{first}", part.stem)) {
                Ok(file) => {
                    let file = if policy.tlog {
                        part.received = Some(TlogWriter::new(BufWriter::with_capacity(BUFFER, file)));
                        policy.mcap.then(|| disk.create(&part.mcap_name())).transpose().map_err(RecordError::Write)?
                    } else {
                        Some(file)
                    };
                    part.mcap = file.map(|f| begin_mcap(f, Arc::clone(&part.mcap_bytes))).transpose()?;
                    return Ok(part);
                }
                Err(error) if error.kind() == io::ErrorKind::AlreadyExists => {}
                Err(error) => return Err(RecordError::Write(error)),
            }
        }
        Err(RecordError::Write(io::ErrorKind::AlreadyExists.into()))
    }

    pub fn stem(&self) -> &str {
        &self.stem
    }

    fn mcap_name(&self) -> String {
        format!("{}.mcap", self.stem)
    }

    pub fn is_full(&self, policy: &Policy, now_us: u64) -> bool {
        let bytes = self.log_bytes + self.mcap_bytes.load(Ordering::Relaxed);
        policy.rotate_bytes.is_some_and(|limit| bytes >= limit)
            || policy.rotate_us.is_some_and(|limit| now_us.saturating_sub(self.begun_us) >= limit)
    }

    pub fn frame(
        &mut self,
        disk: &mut D,
        track: Track,
        link: &str,
        now_us: u64,
        frame: FrameRef<'_>,
    ) -> Result<(), RecordError> {
        let log = match track {
            Track::Received => self.received.as_mut(),
            Track::Sent if self.with_sent && self.sent.is_none() => {
                let file = disk.create(&format!("{}.sent.tlog", self.stem)).map_err(RecordError::Write)?;
                Some(self.sent.insert(TlogWriter::new(BufWriter::with_capacity(BUFFER, file))))
            }
            Track::Sent => self.sent.as_mut(),
        };
        if let Some(log) = log {
            log.write(now_us, frame).map_err(RecordError::Write)?;
            self.log_bytes += 8 + frame.bytes().len() as u64;
        }
        if let Some(mcap) = &mut self.mcap {
            let link = mcap.link(if track == Track::Sent { "sent" } else { link });
            mcap.frame(link, Arrival::at_us(now_us), frame)?;
        }
        Ok(())
    }

    pub fn message(&mut self, channel: &OwnedChannel, header: &MessageHeader, data: &[u8]) -> Result<(), RecordError> {
        let Some(mcap) = &mut self.mcap else { return Ok(()) };
        let channel_id = match self.channels.get(&channel.topic) {
            Some(&id) => id,
            None => {
                let id = mcap.channel(&channel.borrowed())?;
                self.channels.insert(channel.topic.clone(), id);
                id
            }
        };
        mcap.message(&MessageHeader { channel_id, ..*header }, data)
    }

    pub fn gap(&mut self, now_us: u64, missed: u64) -> Result<(), RecordError> {
        match &mut self.mcap {
            Some(mcap) => mcap.gap(now_us, missed, "the disk was too slow"),
            None => Ok(()),
        }
    }

    pub fn flush(&mut self, disk: &mut D, sync: bool) -> Result<(), RecordError> {
        for log in [&mut self.received, &mut self.sent].into_iter().flatten() {
            log.flush().map_err(RecordError::Write)?;
        }
        if let Some(mcap) = &mut self.mcap {
            mcap.flush()?;
        }
        if sync { self.sync(disk) } else { Ok(()) }
    }

    fn sync(&self, disk: &mut D) -> Result<(), RecordError> {
        let names = [
            self.received.is_some().then(|| format!("{}.tlog", self.stem)),
            self.sent.is_some().then(|| format!("{}.sent.tlog", self.stem)),
            self.mcap.is_some().then(|| self.mcap_name()),
        ];
        names.into_iter().flatten().try_for_each(|name| disk.sync(&name)).map_err(RecordError::Write)
    }

    pub fn finish(mut self, disk: &mut D, sync: bool) -> Result<(), RecordError> {
        self.flush(disk, false)?;
        if sync {
            self.sync(disk)?;
        }
        if let Some(mcap) = self.mcap.take() {
            let mut sink = mcap.finish(Default::default())?;
            sink.flush().map_err(RecordError::Write)?;
            if sync {
                disk.sync(&self.mcap_name()).map_err(RecordError::Write)?;
            }
        }
        Ok(())
    }
}

fn begin_mcap<F: Write + Seek>(
    file: F,
    bytes: Arc<AtomicU64>,
) -> Result<McapWriter<Counted<BufWriter<F>>>, RecordError> {
    let sink = Counted { inner: BufWriter::with_capacity(BUFFER, file), bytes };
    let mut mcap = McapWriter::new(sink, Encoding::Protobuf)?;
    mcap.source("live", "tlog")?;
    Ok(mcap)
}

/// Counts what is written; the sink inside the MCAP library cannot be asked.
struct Counted<W> {
    inner: W,
    bytes: Arc<AtomicU64>,
}

impl<W: Write> Write for Counted<W> {
    fn write(&mut self, buffer: &[u8]) -> io::Result<usize> {
        let n = self.inner.write(buffer)?;
        self.bytes.fetch_add(n as u64, Ordering::Relaxed);
        Ok(n)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.inner.flush()
    }
}

impl<W: Seek> Seek for Counted<W> {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        self.inner.seek(to)
    }

    fn stream_position(&mut self) -> io::Result<u64> {
        self.inner.stream_position()
    }
}
