//! One log into another form.

use super::error::RecordError;
use super::files::FileKind;
use super::foreign;
use super::publisher::{Counts, Encoding};
use super::reader::McapReader;
use super::writer::McapWriter;
use crate::wire::Event;
use crate::wire::tlog::{LogFormat, TlogReader};
use sha2::{Digest, Sha256};
use std::fs::File;
use std::io::{self, Read, Seek, Write};
use std::ops::ControlFlow;
use std::path::Path;

/// What a conversion found.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Converted {
    pub counts: Counts,
    /// First and last receive time, ns since 1970.
    pub span_ns: Option<(u64, u64)>,
    /// Vehicles: system, component, MAV_TYPE, MAV_AUTOPILOT.
    pub vehicles: Vec<(u8, u8, u8, u8)>,
    pub parameters: usize,
    /// The recording ended before its footer.
    pub cut_off: bool,
}

impl Converted {
    fn saw(&mut self, at_ns: Option<u64>) {
        if let Some(at) = at_ns {
            let (first, last) = self.span_ns.unwrap_or((at, at));
            self.span_ns = Some((first.min(at), last.max(at)));
        }
    }
}

/// Converts a telemetry log, with receive times (`.tlog`) or without, into MCAP. `read` hears of every stretch of bytes
/// that was read.
///
/// # Errors
/// The log cannot be read or is none, or the sink cannot be written to.
pub fn log_to_mcap<W: Write + Seek>(
    input: &Path,
    sink: W,
    encoding: Encoding,
    read: &mut dyn FnMut(u64),
) -> Result<(Converted, W), RecordError> {
    let mut source = Hashing::open(input, read)?;
    let first_us = first_received(input)?;
    let mut reader = TlogReader::new(&mut source)?;
    let stamped = reader.format() == LogFormat::Stamped;
    let mut writer = McapWriter::new(sink, encoding)?;
    writer.source(&name_of(input), if stamped { "tlog" } else { "raw" })?;
    writer.begin_at_ns(first_us.unwrap_or(0).saturating_mul(1_000));
    let mut converted = Converted::default();
    while let Some(record) = reader.next()? {
        if let Event::Frame(_) = record.event {
            converted.saw(record.received_unix_us.and_then(|us| us.checked_mul(1_000)));
        }
        writer.record(&record, stamped)?;
    }
    drop(reader);
    converted.counts = writer.counts();
    converted.vehicles =
        writer.inventory().vehicles().map(|((s, c), kind, autopilot)| (s, c, kind, autopilot)).collect();
    converted.parameters = writer.inventory().parameters();
    let summary = [("sha256", source.hash()), ("bytes", source.bytes.to_string())];
    let sink = writer.finish(summary.map(|(k, v)| (k.to_owned(), v)).into())?;
    Ok((converted, sink))
}

/// Converts a log that an autopilot wrote itself into MCAP, each of its messages under its own name.
///
/// # Errors
/// The log cannot be read or is none, or the sink cannot be written to.
pub fn autopilot_log_to_mcap<W: Write + Seek>(
    input: &Path,
    kind: FileKind,
    sink: W,
    read: &mut dyn FnMut(u64),
) -> Result<(Converted, W), RecordError> {
    let offset = foreign::unix_minus_boot_us(input, kind)?;
    let mut writer = McapWriter::new(sink, Encoding::Protobuf)?;
    let format = if kind == FileKind::Ulog { "ulog" } else { "dataflash" };
    writer.source(&name_of(input), format)?;
    let mut converted = Converted::default();
    // what has no time of its own, or comes before there is one, is filed under the time known by then
    let timed = |row: &foreign::Row<'_>| row.boot_us().filter(|&us| us > 0);
    let unix_ns = |boot_us: u64| boot_us.saturating_add(offset.unwrap_or(0)).saturating_mul(1_000);
    foreign::read_rows(input, kind, &mut |row| match timed(&row) {
        Some(us) => {
            writer.begin_at_ns(unix_ns(us));
            ControlFlow::Break(())
        }
        None => ControlFlow::Continue(()),
    })?;
    let mut written = Ok(());
    let complete = foreign::read_rows(input, kind, &mut |row| {
        let at = timed(&row).map_or(writer.last_ns, unix_ns);
        writer.last_ns = at;
        converted.counts.frames += 1;
        converted.saw(Some(at));
        let (name, package) = row.type_name();
        written = writer.derived(&row.topic(), (at, at), &name, package, || row.schema(), |out| row.encode(out));
        if written.is_ok() { ControlFlow::Continue(()) } else { ControlFlow::Break(()) }
    })?;
    written?;
    converted.cut_off = !complete;
    // the parsers read for themselves: what is hashed and told as progress is the file once more
    let mut source = Hashing::open(input, read)?;
    io::copy(&mut source, &mut io::sink()).map_err(RecordError::Read)?;
    let summary = [
        ("sha256", source.hash()),
        ("bytes", source.bytes.to_string()),
        ("messages", converted.counts.frames.to_string()),
        ("date", if offset.is_some() { "from GNSS" } else { "unknown: times count from boot" }.to_owned()),
    ];
    let sink = writer.finish(summary.map(|(k, v)| (k.to_owned(), v)).into())?;
    Ok((converted, sink))
}

/// Converts a recording into the telemetry log that its frames came from, byte for byte.
///
/// # Errors
/// The recording cannot be read, is damaged or holds no MAVLink, or the sink cannot be written to.
pub fn mcap_to_log<W: Write>(
    input: &Path,
    mut sink: W,
    read: &mut dyn FnMut(u64),
) -> Result<(Converted, W), RecordError> {
    let mut source = Hashing::open(input, read)?;
    let mut reader = McapReader::new(&mut source);
    let mut converted = Converted::default();
    while let Some(record) = reader.next()? {
        match record.event {
            Event::Frame(_) => {
                converted.counts.frames += 1;
                converted.saw(record.received_unix_us.map(|us| us.saturating_mul(1_000)));
            }
            Event::Bad(bad) => {
                converted.counts.bad += 1;
                converted.counts.bad_bytes += bad.bytes.len() as u64;
            }
        }
        sink.write_all(record.stamp).and_then(|()| sink.write_all(record.event.bytes())).map_err(RecordError::Write)?;
    }
    converted.cut_off = reader.is_cut_off();
    if !reader.has_link_topics() {
        return Err(RecordError::Unsupported("no MAVLink topic in this recording".to_owned()));
    }
    sink.flush().map_err(RecordError::Write)?;
    Ok((converted, sink))
}

/// The first receive time of a log, if it holds any: a bad stretch before it is filed under it.
fn first_received(input: &Path) -> Result<Option<u64>, RecordError> {
    let mut reader = TlogReader::open(input)?;
    if reader.format() == LogFormat::Raw {
        return Ok(None);
    }
    while let Some(record) = reader.next()? {
        if let Some(us) = record.received_unix_us {
            return Ok(Some(us));
        }
    }
    Ok(None)
}

fn name_of(input: &Path) -> String {
    input.file_name().map_or_else(String::new, |n| n.to_string_lossy().into_owned())
}

/// A file whose bytes are counted and hashed as they are read.
pub(super) struct Hashing<'a> {
    file: File,
    hash: Sha256,
    pub bytes: u64,
    read: &'a mut dyn FnMut(u64),
}

impl<'a> Hashing<'a> {
    pub fn open(path: &Path, read: &'a mut dyn FnMut(u64)) -> Result<Self, RecordError> {
        let file = File::open(path).map_err(|source| RecordError::Open { path: path.to_owned(), source })?;
        Ok(Self { file, hash: Sha256::new(), bytes: 0, read })
    }

    /// Of what was read, hexadecimal.
    pub fn hash(&self) -> String {
        self.hash.clone().finalize().iter().map(|b| format!("{b:02x}")).collect()
    }
}

impl Read for Hashing<'_> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let n = self.file.read(buffer)?;
        self.hash.update(&buffer[..n]);
        self.bytes += n as u64;
        (self.read)(n as u64);
        Ok(n)
    }
}
