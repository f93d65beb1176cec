use super::Recovered;
use crate::record::error::RecordError;
use crate::wire::Event;
use crate::wire::tlog::{LogFormat, TlogReader, TlogWriter};
use std::io::Write;
use std::path::Path;

/// Copies the frames of a telemetry log, with damaged receive times mended from the frames beside them.
///
/// # Errors
/// The log cannot be read or holds no frame at all, or the sink cannot be written to.
pub fn recover_log<W: Write>(input: &Path, sink: W) -> Result<(Recovered, W), RecordError> {
    let mut reader = TlogReader::open(input)?;
    let stamped = reader.format() == LogFormat::Stamped;
    let mut writer = TlogWriter::new(sink);
    let mut recovered = Recovered::default();
    let mut at = 0;
    while let Some(record) = reader.next()? {
        let begin = at;
        at += (record.stamp.len() + record.event.bytes().len()) as u64;
        match record.event {
            Event::Frame(frame) if stamped => {
                let received = record.received_unix_us.unwrap_or(0);
                if record.stamp != received.to_be_bytes() {
                    let stamp = begin..begin + record.stamp.len() as u64;
                    recovered.lose(stamp, "a receive time, mended from the frame before");
                }
                writer.write(received, frame).map_err(RecordError::Write)?;
                recovered.messages += 1;
            }
            Event::Frame(frame) => {
                writer.write_raw(frame).map_err(RecordError::Write)?;
                recovered.messages += 1;
            }
            Event::Bad(bad) => recovered.lose(begin..at, bad.reason.to_string()),
        }
    }
    writer.flush().map_err(RecordError::Write)?;
    Ok((recovered, writer.into_inner()))
}
