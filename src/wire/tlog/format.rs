//! Which kind of log some bytes are.

use super::TlogError;
use super::stamped::STAMP;
use crate::wire::scan::Scanner;
use crate::wire::{Check, Event};

/// How the frames of a log are stored.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LogFormat {
    /// Each frame follows its receive time (`.tlog`).
    Stamped,
    /// Frames alone (`.rlog`).
    Raw,
}

/// Decides by the distances between verified frames at the beginning of a log: no byte between them, or a stamp.
pub(super) fn detect(head: &[u8], is_whole: bool) -> Result<LogFormat, TlogError> {
    if head.is_empty() {
        return Err(TlogError::Empty);
    }
    let (mut stamped, mut raw, mut frames) = (0u32, 0u32, 0u32);
    let mut scanner = Scanner::new(true);
    let mut end_of_last = 0;
    while let Some(found) = scanner.next(head, is_whole) {
        if let Event::Frame(frame) = found.event(head)
            && frame.check() == Check::Verified
        {
            let range = found.range();
            match range.start - end_of_last {
                0 => raw += 1,
                STAMP => stamped += 1,
                _ => {}
            }
            frames += 1;
            end_of_last = range.end;
        }
    }
    if frames == 0 {
        return Err(TlogError::NotATlog { searched: head.len(), looks_like: recognise(head) });
    }
    Ok(if stamped >= raw { LogFormat::Stamped } else { LogFormat::Raw })
}

/// Other files that people hand over by mistake.
fn recognise(head: &[u8]) -> Option<&'static str> {
    const KNOWN: [(&[u8], &str); 6] = [
        (&[0xA3, 0x95], "an ArduPilot dataflash log (.bin)"),
        (b"ULog", "a PX4 ULog"),
        (b"\x89MCAP", "an MCAP recording"),
        (&[0x1F, 0x8B], "a gzip archive"),
        (b"PK\x03\x04", "a zip archive"),
        (b"FMT, ", "an ArduPilot dataflash log in text form"),
    ];
    if let Some((_, name)) = KNOWN.iter().find(|(magic, _)| head.starts_with(magic)) {
        return Some(name);
    }
    let sample = head.get(..512).unwrap_or(head);
    sample.iter().all(|b| b.is_ascii_graphic() || b.is_ascii_whitespace()).then_some("a text file")
}
