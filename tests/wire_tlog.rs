//! Telemetry logs: written, read back, and read in spite of damage.

use mavobserver::wire::dialect::ardupilotmega::{ATTITUDE_DATA, HEARTBEAT_DATA, STATUSTEXT_DATA};
use mavobserver::wire::tlog::{LogFormat, TlogError, TlogReader, TlogWriter};
use mavobserver::wire::{BadReason, Check, Encoder, Event, FrameBuf, datagram};
use proptest::prelude::*;
use std::io::{self, Read};

const START_US: u64 = 1_700_000_000_000_000;

/// Frames as a vehicle sends them, 100 ms apart.
fn flight(records: usize) -> Vec<(u64, FrameBuf)> {
    let mut encoder = Encoder::new(1, 1);
    (0..records)
        .map(|i| {
            let frame = match i % 3 {
                0 => encoder.encode(&HEARTBEAT_DATA { custom_mode: i as u32, ..Default::default() }),
                1 => encoder.encode(&ATTITUDE_DATA { time_boot_ms: 100 * i as u32, roll: 0.1, ..Default::default() }),
                _ => encoder.encode(&STATUSTEXT_DATA { text: "all well".into(), ..Default::default() }),
            };
            (START_US + 100_000 * i as u64, frame)
        })
        .collect()
}

fn log(records: &[(u64, FrameBuf)]) -> Vec<u8> {
    let mut writer = TlogWriter::new(Vec::new());
    for (stamp, frame) in records {
        writer.write(*stamp, frame.as_ref()).unwrap();
    }
    writer.flush().unwrap();
    writer.into_inner()
}

#[derive(Debug, Default, PartialEq)]
struct Contents {
    frames: Vec<(Option<u64>, Vec<u8>)>,
    bad: Vec<(Option<u64>, Vec<u8>, BadReason)>,
}

fn read(source: impl Read) -> Contents {
    let mut reader = TlogReader::new(source).unwrap();
    let mut out = Contents::default();
    while let Some(record) = reader.next().unwrap() {
        match record.event {
            Event::Frame(frame) => out.frames.push((record.received_unix_us, frame.bytes().to_vec())),
            Event::Bad(bad) => out.bad.push((record.received_unix_us, bad.bytes.to_vec(), bad.reason)),
        }
    }
    out
}

fn frames(records: &[(u64, FrameBuf)]) -> Vec<(Option<u64>, Vec<u8>)> {
    records.iter().map(|(stamp, frame)| (Some(*stamp), frame.bytes().to_vec())).collect()
}

/// Where each record begins, and where the log ends.
fn bounds(records: &[(u64, FrameBuf)]) -> Vec<usize> {
    let mut at = 0;
    let mut out = vec![0];
    for (_, frame) in records {
        at += 8 + frame.bytes().len();
        out.push(at);
    }
    out
}

#[test]
fn what_is_written_is_read() {
    let records = flight(30);
    assert_eq!(read(&log(&records)[..]), Contents { frames: frames(&records), bad: vec![] });
}

/// A source that gives a few bytes at a time, and now and then asks to try again.
struct Trickle<'a>(&'a [u8], usize);

impl Read for Trickle<'_> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        self.1 += 1;
        if self.1.is_multiple_of(5) {
            return Err(io::ErrorKind::Interrupted.into());
        }
        let len = buffer.len().min(self.0.len()).min(1 + self.1 % 7);
        buffer[..len].copy_from_slice(&self.0[..len]);
        self.0 = &self.0[len..];
        Ok(len)
    }
}

#[test]
fn a_log_may_be_longer_than_the_window_and_come_slowly() {
    let records = flight(8000);
    let bytes = log(&records);
    assert!(bytes.len() > 3 * 65536);
    assert_eq!(read(Trickle(&bytes, 0)).frames, frames(&records));
}

#[test]
fn a_log_without_stamps_is_recognised() {
    let records = flight(4000);
    let bytes: Vec<u8> = records.iter().flat_map(|(_, frame)| frame.bytes().to_vec()).collect();
    assert!(bytes.len() > 65536);
    let reader = TlogReader::new(&bytes[..]).unwrap();
    assert_eq!(reader.format(), LogFormat::Raw);
    let contents = read(&bytes[..]);
    assert!(contents.bad.is_empty());
    let expected: Vec<_> = records.iter().map(|(_, frame)| (None, frame.bytes().to_vec())).collect();
    assert_eq!(contents.frames, expected);
    // the last frame cut off
    let cut = read(&bytes[..bytes.len() - 3]);
    assert_eq!(cut.frames, expected[..3999]);
    assert!(matches!(cut.bad[..], [(None, _, BadReason::Truncated { .. })]));
}

#[test]
fn a_frame_with_a_wrong_checksum_is_one_bad_record() {
    let records = flight(30);
    let bounds = bounds(&records);
    let mut bytes = log(&records);
    for broken in [0, 7, 8, 29] {
        bytes[bounds[broken] + 8 + 11] ^= 0x40;
    }
    let contents = read(&bytes[..]);
    assert_eq!(contents.frames.len(), 26);
    let stamps: Vec<_> = contents.bad.iter().map(|(stamp, ..)| stamp.unwrap()).collect();
    assert_eq!(stamps, [0, 7, 8, 29].map(|i| records[i].0));
    for (_, bytes, reason) in &contents.bad {
        assert!(matches!(reason, BadReason::Checksum { .. }));
        assert_eq!(bytes[0], 0xFD);
    }
}

#[test]
fn unknown_messages_in_a_log_are_kept() {
    let records = flight(3);
    let mut bytes = log(&records);
    bytes.extend_from_slice(&(START_US + 300_000).to_be_bytes());
    bytes.extend_from_slice(&[0xFD, 2, 0, 0, 3, 1, 1, 0x34, 0x12, 0x77, 5, 6, 0xAB, 0xCD]);
    let mut reader = TlogReader::new(&bytes[..]).unwrap();
    let mut last = None;
    while let Some(record) = reader.next().unwrap() {
        if let Event::Frame(frame) = record.event {
            last = Some((record.received_unix_us, frame.check(), frame.message_id()));
        }
    }
    assert_eq!(last, Some((Some(START_US + 300_000), Check::UnknownMessage, 0x77_1234)));
}

#[test]
fn a_damaged_stamp_is_replaced_by_the_one_before() {
    let records = flight(10);
    let mut bytes = log(&records);
    bytes[bounds(&records)[4]] ^= 0x80;
    let mut expected = frames(&records);
    expected[4].0 = Some(records[3].0);
    assert_eq!(read(&bytes[..]), Contents { frames: expected, bad: vec![] });
}

#[test]
fn the_recorders_clock_may_be_set() {
    // a companion computer without a clock starts in 1970 and finds the time later
    let mut records = flight(10);
    for (stamp, _) in &mut records[..5] {
        *stamp -= START_US;
    }
    assert_eq!(read(&log(&records)[..]).frames, frames(&records));
}

#[test]
fn what_is_no_log_is_said_so() {
    let error = |bytes: &[u8]| TlogReader::new(bytes).unwrap_err().to_string();
    assert_eq!(error(b""), "the log is empty");
    assert_eq!(error(b"time,value\n1,2\n"), "no MAVLink frame in the first 15 bytes; this looks like a text file");
    assert_eq!(error(&[0x80; 70_000]), "no MAVLink frame in the first 65536 bytes");
    assert!(error(b"ULog\x01\x12\x35\x01").ends_with("this looks like a PX4 ULog"));
    assert!(error(&[0xA3, 0x95, 0x80, 0x80]).ends_with("this looks like an ArduPilot dataflash log (.bin)"));
    let missing = TlogReader::open("no such file.tlog".as_ref()).unwrap_err();
    assert!(missing.to_string().starts_with("cannot open no such file.tlog: "));
}

/// A disk that fails after some bytes.
struct Failing<'a>(&'a [u8]);

impl Read for Failing<'_> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        match self.0.read(buffer)? {
            0 => Err(io::Error::other("bad sector")),
            n => Ok(n),
        }
    }
}

#[test]
fn a_failing_disk_is_an_error() {
    let bytes = log(&flight(3000));
    let mut reader = TlogReader::new(Failing(&bytes)).unwrap();
    let error = loop {
        match reader.next() {
            Ok(Some(_)) => {}
            Ok(None) => panic!("the error is lost"),
            Err(error) => break error,
        }
    };
    assert!(matches!(error, TlogError::Read(_)));
    assert_eq!(error.to_string(), "cannot read: bad sector");
}

/// One wound.
#[derive(Debug, Clone)]
enum Damage {
    Delete { at: prop::sample::Index, len: usize },
    Insert { at: prop::sample::Index, bytes: Vec<u8> },
    Overwrite { at: prop::sample::Index, bytes: Vec<u8> },
    Truncate { at: prop::sample::Index },
}

fn damage() -> impl Strategy<Value = Damage> {
    let at = any::<prop::sample::Index>;
    let byte = prop_oneof![2 => any::<u8>(), 1 => Just(0xFD), 1 => Just(0xFE)];
    let bytes = prop::collection::vec(byte, 1..400);
    prop_oneof![
        (at(), 1usize..200).prop_map(|(at, len)| Damage::Delete { at, len }),
        (at(), bytes.clone()).prop_map(|(at, bytes)| Damage::Insert { at, bytes }),
        (at(), bytes).prop_map(|(at, bytes)| Damage::Overwrite { at, bytes }),
        at().prop_map(|at| Damage::Truncate { at }),
    ]
}

proptest! {
    /// Every record that the damage does not touch comes out with its own stamp.
    #[test]
    fn damage_costs_the_damaged_records_only(damage in damage()) {
        let records = flight(40);
        let bounds = bounds(&records);
        let mut bytes = log(&records);
        let whole = bytes.len();
        let touched = match damage {
            Damage::Delete { at, len } => {
                let at = at.index(whole);
                let end = (at + len).min(whole);
                bytes.drain(at..end);
                at..end
            }
            Damage::Insert { at, bytes: noise } => {
                let at = at.index(whole);
                bytes.splice(at..at, noise);
                at..at
            }
            Damage::Overwrite { at, bytes: noise } => {
                let at = at.index(whole);
                let end = (at + noise.len()).min(whole);
                bytes[at..end].copy_from_slice(&noise[..end - at]);
                at..end
            }
            Damage::Truncate { at } => {
                let at = at.index(whole);
                bytes.truncate(at);
                at..whole
            }
        };
        let survivors: Vec<_> = (0..records.len())
            .filter(|&i| bounds[i + 1] <= touched.start || bounds[i] >= touched.end)
            .map(|i| (Some(records[i].0), records[i].1.bytes().to_vec()))
            .collect();
        if survivors.is_empty() {
            return Ok(());
        }
        let contents = read(&bytes[..]);
        // One candidate in 65536 in the noise has a right checksum by chance; what it covers is lost, and rightly so.
        let by_chance = |bytes: &[u8]| {
            matches!(datagram(bytes).next(), Some(Event::Frame(frame)) if frame.check() == Check::Verified)
                && records.iter().all(|(_, sent)| sent.bytes() != bytes)
        };
        if contents.frames.iter().any(|(_, bytes)| by_chance(bytes)) {
            return Ok(());
        }
        let mut found = contents.frames.iter();
        for survivor in &survivors {
            prop_assert!(found.any(|f| f == survivor), "lost {survivor:?} to damage at {touched:?}: {contents:?}");
        }
    }

    #[test]
    fn arbitrary_bytes_never_panic(mut bytes in prop::collection::vec(any::<u8>(), 0..3000), stamped in any::<bool>()) {
        if stamped {
            bytes.splice(..0, log(&flight(2)));
        }
        if let Ok(mut reader) = TlogReader::new(&bytes[..]) {
            while reader.next().unwrap().is_some() {}
        }
    }
}
