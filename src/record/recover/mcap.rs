use super::Recovered;
use super::segments::{Segment, Segments};
use crate::record::error::RecordError;
use crate::record::reader::LONGEST_RECORD;
use mcap::records::{Channel, MessageHeader, Metadata, Record};
use mcap::sans_io::linear_reader::{LinearReadEvent, LinearReader, LinearReaderOptions};
use std::collections::HashMap;
use std::io::{Seek, Write};
use std::path::Path;

/// Opcodes of the records that hold what is worth saving.
const SCHEMA: u8 = 0x03;
const CHANNEL: u8 = 0x04;
const CHUNK: u8 = 0x06;
const ATTACHMENT: u8 = 0x09;
const METADATA: u8 = 0x0C;
const MESSAGE: u8 = 0x05;
const DATA_END: u8 = 0x0F;
const FOOTER: u8 = 0x02;

/// What messages need to be understood, from wherever in the file it stands: the summary at the end repeats it.
#[derive(Default)]
struct Known {
    schemas: HashMap<u16, (String, String, Vec<u8>)>,
    channels: HashMap<u16, Channel>,
}

/// Copies the readable messages, metadata and attachments of an MCAP file into a new one with a new index.
///
/// A chunk with a wrong checksum is lost whole: it cannot be told which of its messages are right. Of a chunk that the
/// file's end cuts off, the messages before the cut are saved.
///
/// # Errors
/// The file cannot be read or holds no message, or the sink cannot be written to.
pub fn recover_mcap<W: Write + Seek>(input: &Path, sink: W) -> Result<(Recovered, W), RecordError> {
    let known = learn(input)?;
    let mut recovered = Recovered::default();
    let options = mcap::WriteOptions::new().compression_threads(0).disable_seeking(true);
    let mut writer = options.create(sink).map_err(RecordError::writing)?;
    let mut ids: HashMap<u16, u16> = HashMap::new();
    let mut nameless = 0;
    let mut ended = false;
    let mut segments = Segments::open(input)?;
    while let Some(segment) = segments.next()? {
        let (at, len, opcode, cut) = match segment {
            Segment::Damaged { at, len } => {
                recovered.lose(at..at + len, "no record can be read here");
                continue;
            }
            Segment::CutChunk { at, len } => (at, len, CHUNK, true),
            Segment::Record { at, len, opcode } => (at, len, opcode, false),
        };
        ended |= opcode == DATA_END;
        // behind the data comes the summary, which is made anew
        if ended || !matches!(opcode, SCHEMA | CHANNEL | CHUNK | MESSAGE | ATTACHMENT | METADATA) {
            continue;
        }
        let bytes = segments.bytes(at, len)?;
        let mut failed = None;
        let end = records(&bytes, !cut, &mut |record| {
            let done = match record {
                Record::Message { header, data } => match channel(&mut writer, &known, &mut ids, header.channel_id) {
                    Ok(Some(channel_id)) => {
                        recovered.messages += 1;
                        writer.write_to_known_channel(&MessageHeader { channel_id, ..header }, &data)
                    }
                    Ok(None) => {
                        nameless += 1;
                        Ok(())
                    }
                    Err(e) => Err(e),
                },
                Record::Metadata(m) => {
                    recovered.extras += 1;
                    writer.write_metadata(&Metadata { name: m.name, metadata: m.metadata })
                }
                Record::Attachment { header, data, .. } => {
                    recovered.extras += 1;
                    writer.attach(&mcap::Attachment {
                        log_time: header.log_time,
                        create_time: header.create_time,
                        name: header.name,
                        media_type: header.media_type,
                        data,
                    })
                }
                _ => Ok(()),
            };
            if let Err(e) = done {
                failed.get_or_insert(e);
            }
        });
        if let Some(e) = failed {
            return Err(RecordError::writing(e));
        }
        match end {
            Ok(()) => {}
            Err(_) if cut => recovered.lose(at..at + len, "a chunk that the file's end cuts off, from the cut on"),
            Err(e) => recovered.lose(at..at + len, format!("{}: {e}", span_of(&bytes))),
        }
    }
    if nameless > 0 {
        tracing::warn!("{nameless} messages had to be left out: nothing says what their channel holds");
    }
    if recovered.messages == 0 {
        return Err(RecordError::Damaged("no message can be read".to_owned()));
    }
    recovered.index_rebuilt = !ended;
    writer.finish().map_err(RecordError::writing)?;
    Ok((recovered, writer.into_inner()))
}

/// Reads the schemas and channels of every readable chunk, and of the summary unless its checksum says that it is
/// damaged: a changed schema would make other frames of what is saved.
fn learn(input: &Path) -> Result<Known, RecordError> {
    let mut known = Known::default();
    let summary_is_sound = summary_is_sound(input)?;
    let mut ended = false;
    let mut segments = Segments::open(input)?;
    while let Some(segment) = segments.next()? {
        let (at, len, cut, checked) = match segment {
            Segment::Record { at, len, opcode: CHUNK } => (at, len, false, true),
            Segment::Record { opcode: DATA_END, .. } => {
                ended = true;
                continue;
            }
            Segment::Record { .. } if ended && !summary_is_sound => continue,
            Segment::Record { at, len, opcode: SCHEMA | CHANNEL } => (at, len, false, false),
            Segment::CutChunk { at, len } => (at, len, true, false),
            _ => continue,
        };
        let bytes = segments.bytes(at, len)?;
        // what cannot be read is told in the second walk
        let _ = records(&bytes, !cut, &mut |record| match record {
            Record::Schema { header, data } => {
                learned(&mut known.schemas, header.id, (header.name, header.encoding, data.into_owned()), checked);
            }
            Record::Channel(channel) => learned(&mut known.channels, channel.id, channel, checked),
            _ => {}
        });
    }
    Ok(known)
}

/// Whether the records behind the data have the checksum that the footer tells. They are found by walking to them: with
/// bytes missing or too many in the data, the footer's own positions are wrong.
fn summary_is_sound(input: &Path) -> Result<bool, RecordError> {
    let mut segments = Segments::open(input)?;
    let mut begin = None;
    while let Some(segment) = segments.next()? {
        match (segment, begin) {
            (Segment::Record { at, len, opcode: DATA_END }, _) => begin = Some(at + len),
            (Segment::Record { at, len, opcode: FOOTER }, Some(begin)) => {
                let bytes = segments.bytes(begin, at + len - begin)?;
                let Some((covered, told)) = bytes.split_last_chunk::<4>() else { return Ok(false) };
                let told = u32::from_le_bytes(*told);
                // a writer that reckons no checksum writes zero
                return Ok(told == 0 || told == crc32fast::hash(covered));
            }
            _ => {}
        }
    }
    Ok(false)
}

/// What a chunk's checksum vouches for is believed before what stands elsewhere.
fn learned<T>(known: &mut HashMap<u16, T>, id: u16, new: T, checked: bool) {
    if checked {
        known.insert(id, new);
    } else {
        known.entry(id).or_insert(new);
    }
}

/// The channel in the new file, opened when it is first needed; `None` if nothing says what it holds.
fn channel<W: Write + Seek>(
    writer: &mut mcap::Writer<W>,
    known: &Known,
    ids: &mut HashMap<u16, u16>,
    id: u16,
) -> mcap::McapResult<Option<u16>> {
    if let Some(&new) = ids.get(&id) {
        return Ok(Some(new));
    }
    let Some(channel) = known.channels.get(&id) else { return Ok(None) };
    let schema = match (channel.schema_id, known.schemas.get(&channel.schema_id)) {
        (0, _) => 0,
        (_, Some((name, encoding, data))) => writer.add_schema(name, encoding, data)?,
        (_, None) => return Ok(None),
    };
    let new = writer.add_channel(schema, &channel.topic, &channel.message_encoding, &channel.metadata)?;
    ids.insert(id, new);
    Ok(Some(new))
}

/// Hears of the records in one record's bytes: itself, or those of a chunk. With `check`, nothing comes out of a chunk
/// whose checksum is wrong.
fn records(bytes: &[u8], check: bool, sink: &mut dyn FnMut(Record<'_>)) -> mcap::McapResult<()> {
    let options = LinearReaderOptions::default()
        .with_skip_start_magic(true)
        .with_skip_end_magic(true)
        .with_prevalidate_chunk_crcs(check)
        .with_record_length_limit(LONGEST_RECORD);
    let mut reader = LinearReader::new_with_options(options);
    let mut rest = bytes;
    while let Some(event) = reader.next_event() {
        match event? {
            LinearReadEvent::ReadRequest(n) => {
                let (now, later) = rest.split_at(n.min(rest.len()));
                reader.insert(now.len()).copy_from_slice(now);
                reader.notify_read(now.len());
                rest = later;
            }
            LinearReadEvent::Record { opcode, data } => sink(mcap::parse_record(opcode, data)?),
        }
    }
    Ok(())
}

/// The time that a damaged chunk's header tells.
fn span_of(chunk: &[u8]) -> String {
    let time = |at: usize| chunk.get(at..).and_then(|b| b.first_chunk()).map(|b| u64::from_le_bytes(*b) as f64 * 1e-9);
    match (time(9), time(17)) {
        (Some(from), Some(to)) if from <= to => format!("the messages of {:.1} s from {from:.1} s on", to - from),
        _ => "a record".to_owned(),
    }
}
