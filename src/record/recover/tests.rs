use super::*;
use crate::record::{Arrival, Encoding, McapReader, McapWriter};
use crate::wire::dialect::ardupilotmega::ATTITUDE_DATA;
use crate::wire::{Encoder, Event, FrameBuf};
use proptest::prelude::*;
use std::collections::HashSet;
use std::fs;
use std::io::Cursor;
use std::path::{Path, PathBuf};

const PER_CHUNK: u32 = 24;

fn frame(number: u32) -> FrameBuf {
    let roll = (number as f32 * 0.37).sin();
    let mut encoder = Encoder::new(1, 1);
    encoder.sequence = number as u8;
    encoder.encode(&ATTITUDE_DATA { time_boot_ms: 20 * number + 1, roll, pitch: roll * roll, ..Default::default() })
}

/// A recording of three chunks, where each of them ends, and its frames.
fn recording() -> (Vec<u8>, Vec<FrameBuf>) {
    let frames: Vec<_> = (0..3 * PER_CHUNK).map(frame).collect();
    let mut writer = McapWriter::new(Cursor::new(Vec::new()), Encoding::Protobuf).unwrap();
    writer.source("test", "tlog").unwrap();
    for (i, frame) in frames.iter().enumerate() {
        writer.frame(0, Arrival::at_us(1_000 + 20_000 * i as u64), frame.as_ref()).unwrap();
        if i as u32 % PER_CHUNK == PER_CHUNK - 1 {
            writer.flush().unwrap();
        }
    }
    (writer.finish(Default::default()).unwrap().into_inner(), frames)
}

/// Where chunks begin: opcode 6 and the name of the compression at its place.
fn chunks(bytes: &[u8]) -> Vec<usize> {
    (0..bytes.len() - 45).filter(|&i| bytes[i] == 6 && &bytes[i + 9 + 28..i + 9 + 36] == b"\x04\0\0\0zstd").collect()
}

struct Place(tempfile::TempDir);

impl Place {
    fn new() -> Self {
        Self(tempfile::tempdir().unwrap())
    }

    fn file(&self, bytes: &[u8]) -> PathBuf {
        let path = self.0.path().join("damaged.mcap");
        fs::write(&path, bytes).unwrap();
        path
    }

    fn recover(&self, bytes: &[u8]) -> Option<(Recovered, Vec<FrameBuf>)> {
        let (recovered, sink) = recover_mcap(&self.file(bytes), Cursor::new(Vec::new())).ok()?;
        let mended = self.0.path().join("mended.mcap");
        fs::write(&mended, sink.into_inner()).unwrap();
        let frames = frames_of(&mended).expect("what was recovered reads without complaint");
        Some((recovered, frames))
    }
}

fn frames_of(path: &Path) -> Option<Vec<FrameBuf>> {
    let mut reader = McapReader::open(path).ok()?;
    let mut frames = Vec::new();
    while let Some(record) = reader.next().ok()? {
        if let Event::Frame(frame) = record.event {
            frames.push(frame.into());
        }
    }
    Some(frames)
}

#[test]
fn cut_at_any_byte_of_the_last_chunk() {
    let (bytes, frames) = recording();
    let starts = chunks(&bytes);
    assert_eq!(starts.len(), 3);
    let place = Place::new();
    let whole = 2 * PER_CHUNK as usize;
    let end = starts[2] + 9 + u64::from_le_bytes(bytes[starts[2] + 1..][..8].try_into().unwrap()) as usize;
    let mut most = whole;
    for cut in starts[2]..=end {
        // the reader: what was flushed before, without an error
        let read = frames_of(&place.file(&bytes[..cut])).expect("a cut is no error");
        assert_eq!(read, frames[..if cut == end { frames.len() } else { whole }], "cut at {cut}");
        // the recovery: that, and more of the last chunk the later the cut is
        let (recovered, saved) = place.recover(&bytes[..cut]).unwrap();
        assert!(saved.len() >= most && saved[..] == frames[..saved.len()], "cut at {cut}: {}", saved.len());
        // what was derived from the frames for panels counts too
        assert!(recovered.messages as usize >= saved.len());
        assert!(recovered.index_rebuilt);
        most = saved.len();
    }
    assert_eq!(most, frames.len());
}

#[test]
fn an_undamaged_recording_loses_nothing() {
    let (bytes, frames) = recording();
    let (recovered, saved) = Place::new().recover(&bytes).unwrap();
    assert_eq!((recovered.lost.as_slice(), recovered.index_rebuilt), (&[][..], false));
    assert_eq!(saved, frames);
}

#[test]
fn a_chunk_with_a_flipped_bit_is_lost_and_told_with_its_place() {
    let (mut bytes, frames) = recording();
    let starts = chunks(&bytes);
    bytes[starts[1] + 100] ^= 0x10;
    let place = Place::new();
    assert!(frames_of(&place.file(&bytes)).is_none(), "the reader does not pass it over in silence");
    let (recovered, saved) = place.recover(&bytes).unwrap();
    let n = PER_CHUNK as usize;
    assert_eq!(saved, [&frames[..n], &frames[2 * n..]].concat());
    assert_eq!(recovered.lost.len(), 1, "{:?}", recovered.lost);
    assert_eq!(recovered.lost[0].bytes.start, starts[1] as u64);
}

#[test]
fn a_chunk_that_claims_an_absurd_size_takes_no_memory() {
    let (mut bytes, frames) = recording();
    let size = chunks(&bytes)[1] + 9 + 16;
    bytes[size + 6] ^= 0x80;
    let (_, saved) = Place::new().recover(&bytes).unwrap();
    let n = PER_CHUNK as usize;
    assert_eq!(saved, [&frames[..n], &frames[2 * n..]].concat());
}

#[test]
fn a_summary_with_a_wrong_checksum_teaches_nothing() {
    let (mut bytes, frames) = recording();
    let starts = chunks(&bytes);
    let place = Place::new();
    // the first chunk holds the definitions; without it they are taken from the summary
    bytes[starts[0] + 100] ^= 0x10;
    let (_, saved) = place.recover(&bytes).unwrap();
    assert_eq!(saved, frames[PER_CHUNK as usize..]);
    // "pitch" in the summary's schema: the field would be decoded under another name
    let end = chunks(&bytes)[2] + 9;
    let field = end + bytes[end..].windows(5).rposition(|w| w == b"pitch").unwrap();
    bytes[field] ^= 1;
    assert!(place.recover(&bytes).is_none(), "frames come out of a damaged schema");
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]

    /// Whatever is flipped, cut out or put in: no panic, and nothing that was not there before.
    #[test]
    fn any_damage(
        flips in prop::collection::vec((any::<prop::sample::Index>(), 0_u8..8), 0..6),
        put in prop::option::of((any::<prop::sample::Index>(), prop::collection::vec(any::<u8>(), 1..200))),
        cut in prop::option::of((any::<prop::sample::Index>(), 1_usize..300)),
    ) {
        let (mut bytes, frames) = recording();
        for (at, bit) in flips {
            let at = at.index(bytes.len());
            bytes[at] ^= 1 << bit;
        }
        if let Some((at, garbage)) = put {
            let at = at.index(bytes.len());
            bytes.splice(at..at, garbage);
        }
        if let Some((at, len)) = cut {
            let at = at.index(bytes.len());
            bytes.drain(at..(at + len).min(bytes.len()));
        }
        let place = Place::new();
        let known: HashSet<Vec<u8>> = frames.iter().map(|f| f.bytes().to_vec()).collect();
        let _ = frames_of(&place.file(&bytes));
        if let Some((_, saved)) = place.recover(&bytes) {
            prop_assert!(saved.iter().all(|f| known.contains(f.bytes())));
        }
    }

    #[test]
    fn garbage_between_chunks_costs_nothing_but_itself(garbage in prop::collection::vec(any::<u8>(), 1..400)) {
        let (mut bytes, frames) = recording();
        let at = chunks(&bytes)[1];
        bytes.splice(at..at, garbage.iter().copied());
        let (recovered, saved) = Place::new().recover(&bytes).unwrap();
        prop_assert_eq!(saved, frames);
        prop_assert!(recovered.lost_bytes() <= garbage.len() as u64);
    }
}

#[test]
fn a_damaged_telemetry_log_is_mended() {
    let place = Place::new();
    let (mut log, mut begins) = (Vec::new(), Vec::new());
    for i in 0..50 {
        begins.push(log.len());
        log.extend_from_slice(&(1_700_000_000_000_000_u64 + 20_000 * i).to_be_bytes());
        log.extend_from_slice(frame(i as u32).bytes());
    }
    log[begins[10] + 20] ^= 1;
    log.splice(begins[30]..begins[30], *b"interleaved");
    let (recovered, mended) = recover_log(&place.file(&log), Vec::new()).unwrap();
    assert_eq!(recovered.messages, 49);
    let starts: Vec<_> = recovered.lost.iter().map(|l| l.bytes.start).collect();
    assert_eq!(starts, [begins[10] as u64, begins[30] as u64], "{:?}", recovered.lost);
    let (again, same) = recover_log(&place.file(&mended), Vec::new()).unwrap();
    assert_eq!((again.lost.as_slice(), same), (&[][..], mended));
}
