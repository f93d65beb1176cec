use super::*;
use crate::record::McapReader;
use crate::wire::dialect::ardupilotmega::{HEARTBEAT_DATA, MavAutopilot, MavModeFlag, SYSTEM_TIME_DATA};
use crate::wire::tlog::TlogReader;
use crate::wire::{Encoder, Event, FrameBuf};
use std::fs;
use std::io::{self, Cursor, Seek, SeekFrom, Write};
use std::path::Path;
use std::sync::{Arc, Mutex};

const SECOND: u64 = 1_000_000;

fn frame(number: u32) -> FrameBuf {
    Encoder::new(1, 1).encode(&SYSTEM_TIME_DATA { time_unix_usec: 7, time_boot_ms: number })
}

fn heartbeat(armed: bool) -> FrameBuf {
    let mode = if armed { MavModeFlag::MAV_MODE_FLAG_SAFETY_ARMED } else { MavModeFlag::empty() };
    let autopilot = MavAutopilot::MAV_AUTOPILOT_PX4;
    Encoder::new(1, 1).encode(&HEARTBEAT_DATA { base_mode: mode, autopilot, ..Default::default() })
}

fn frames_of_log(path: &Path) -> Vec<(u64, FrameBuf)> {
    let mut reader = TlogReader::open(path).unwrap();
    let mut frames = Vec::new();
    while let Some(record) = reader.next().unwrap() {
        let Event::Frame(frame) = record.event else { panic!("{:?}", record.event) };
        frames.push((record.received_unix_us.unwrap(), frame.into()));
    }
    frames
}

fn frames_of_recording(path: &Path) -> (Vec<(u64, FrameBuf)>, bool) {
    let mut reader = McapReader::open(path).unwrap();
    let mut frames = Vec::new();
    while let Some(record) = reader.next().unwrap() {
        let Event::Frame(frame) = record.event else { panic!("{:?}", record.event) };
        frames.push((record.received_unix_us.unwrap(), frame.into()));
    }
    (frames, reader.is_cut_off())
}

fn names(folder: &Path) -> Vec<String> {
    let entries = fs::read_dir(folder).unwrap();
    let mut names: Vec<_> = entries.map(|e| e.unwrap().file_name().into_string().unwrap()).collect();
    names.sort();
    names
}

#[test]
fn all_files_hold_exactly_what_was_given() {
    let folder = tempfile::tempdir().unwrap();
    let disk = Folder::create(&folder.path().join("new")).unwrap();
    let mut session = Session::begin(disk, Policy { sync: true, ..Policy::default() }, 0).unwrap();
    let expected: Vec<_> = (0..500).map(|k| (1_000 + u64::from(k), frame(k))).collect();
    for (at, frame) in &expected {
        session.frame(Track::Received, "radio", *at, frame.as_ref()).unwrap();
    }
    session.frame(Track::Sent, "", 2_000, frame(99).as_ref()).unwrap();
    session.tick(SECOND).unwrap();
    assert_eq!(session.finish().unwrap(), 501);

    let path = |name: &str| folder.path().join("new").join(name);
    assert_eq!(names(&path("")), ["19700101T000000Z.mcap", "19700101T000000Z.sent.tlog", "19700101T000000Z.tlog"]);
    assert_eq!(frames_of_log(&path("19700101T000000Z.tlog")), expected);
    assert_eq!(frames_of_log(&path("19700101T000000Z.sent.tlog")), [(2_000, frame(99))]);
    let (frames, cut_off) = frames_of_recording(&path("19700101T000000Z.mcap"));
    assert!(!cut_off);
    assert_eq!(frames[..500], expected[..]);
    assert_eq!(frames[500], (2_000, frame(99)));
}

#[test]
fn what_was_flushed_is_read_though_nothing_follows() {
    let folder = tempfile::tempdir().unwrap();
    let disk = Folder::create(folder.path()).unwrap();
    let mut session = Session::begin(disk, Policy::default(), 0).unwrap();
    for k in 0..100 {
        session.frame(Track::Received, "", 10, frame(k).as_ref()).unwrap();
    }
    session.tick(SECOND).unwrap();
    for k in 0..100 {
        session.frame(Track::Received, "", SECOND + 10, frame(k).as_ref()).unwrap();
    }
    // as a killed process leaves it: no destructor runs
    std::mem::forget(session);
    let (frames, cut_off) = frames_of_recording(&folder.path().join("19700101T000000Z.mcap"));
    assert!(cut_off);
    assert_eq!(frames.len(), 100);
    assert_eq!(frames_of_log(&folder.path().join("19700101T000000Z.tlog")).len(), 100);
}

#[test]
fn parts_end_by_size_and_by_time() {
    let folder = tempfile::tempdir().unwrap();
    let by_size = Policy { rotate_bytes: Some(2_000), mcap: false, ..Policy::default() };
    let mut session = Session::begin(Folder::create(folder.path()).unwrap(), by_size, 0).unwrap();
    for k in 0..200 {
        session.frame(Track::Received, "", u64::from(k) * SECOND, frame(k).as_ref()).unwrap();
    }
    session.finish().unwrap();
    let parts = names(folder.path());
    assert!(parts.len() > 2, "{parts:?}");
    let all: Vec<_> = parts.iter().flat_map(|name| frames_of_log(&folder.path().join(name))).collect();
    assert_eq!(all.len(), 200, "no frame is lost between parts");

    let folder = tempfile::tempdir().unwrap();
    let by_time = Policy { rotate_us: Some(60 * SECOND), tlog: false, ..Policy::default() };
    let mut session = Session::begin(Folder::create(folder.path()).unwrap(), by_time, 0).unwrap();
    for k in 0..150 {
        session.frame(Track::Received, "", k * SECOND, frame(0).as_ref()).unwrap();
    }
    session.finish().unwrap();
    assert_eq!(names(folder.path()), ["19700101T000000Z.mcap", "19700101T000100Z.mcap", "19700101T000200Z.mcap"]);
}

#[test]
fn only_armed_flights_are_kept_if_asked() {
    let folder = tempfile::tempdir().unwrap();
    let policy = Policy { only_armed: true, mcap: false, ..Policy::default() };
    let mut session = Session::begin(Folder::create(folder.path()).unwrap(), policy, 0).unwrap();
    for second in 0..200_u64 {
        let armed = (20..40).contains(&second) || (100..130).contains(&second);
        session.frame(Track::Received, "", second * SECOND, heartbeat(armed).as_ref()).unwrap();
        session.tick(second * SECOND).unwrap();
    }
    session.finish().unwrap();
    assert_eq!(names(folder.path()), ["19700101T000020Z.tlog", "19700101T000140Z.tlog"]);
    let frames = frames_of_log(&folder.path().join("19700101T000020Z.tlog"));
    assert_eq!((frames[0].0, frames.len()), (20 * SECOND, 21), "from arming to disarming");
}

#[test]
fn the_oldest_recordings_make_room_and_nothing_else_does() {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("notes.tlog"), [0; 9_000]).unwrap();
    let policy = Policy { rotate_bytes: Some(1_000), budget_bytes: Some(5_000), mcap: false, ..Policy::default() };
    let mut session = Session::begin(Folder::create(folder.path()).unwrap(), policy, 0).unwrap();
    for k in 0..1_000 {
        session.frame(Track::Received, "", u64::from(k) * SECOND, frame(k).as_ref()).unwrap();
        session.tick(u64::from(k) * SECOND).unwrap();
    }
    session.finish().unwrap();
    let parts = names(folder.path());
    assert!(parts.contains(&"notes.tlog".to_owned()));
    let size = |name: &String| fs::metadata(folder.path().join(name)).unwrap().len();
    let total: u64 = parts.iter().filter(|n| *n != "notes.tlog").map(size).sum();
    assert!((2_000..=6_100).contains(&total), "{total}");
    let newest = frames_of_log(&folder.path().join(&parts[parts.len() - 2]));
    assert_eq!(newest.last().unwrap().0, 999 * SECOND);
}

/// A disk with room for so many bytes, all files together.
#[derive(Clone, Default)]
struct SmallDisk {
    room: Arc<Mutex<usize>>,
}

struct SmallFile {
    disk: SmallDisk,
    inner: Cursor<Vec<u8>>,
}

impl Disk for SmallDisk {
    type File = SmallFile;

    fn create(&mut self, _: &str) -> io::Result<SmallFile> {
        Ok(SmallFile { disk: self.clone(), inner: Cursor::default() })
    }

    fn sync(&mut self, _: &str) -> io::Result<()> {
        Ok(())
    }

    fn remove(&mut self, _: &str) -> io::Result<()> {
        Ok(())
    }

    fn list(&self) -> io::Result<Vec<(String, u64)>> {
        Ok(Vec::new())
    }
}

impl Write for SmallFile {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let mut room = self.disk.room.lock().unwrap();
        if *room < bytes.len() {
            return Err(io::ErrorKind::StorageFull.into());
        }
        *room -= bytes.len();
        self.inner.write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

impl Seek for SmallFile {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        self.inner.seek(to)
    }
}

/// Wherever the room ends, the recording ends with an error that says so, and never with a panic.
#[test]
fn a_full_disk_is_an_error_wherever_it_fills_up() {
    for room in (0..60_000).step_by(997) {
        let disk = SmallDisk { room: Arc::new(Mutex::new(room)) };
        let mut outcome = Session::begin(disk, Policy::default(), 0).and_then(|mut session| {
            for k in 0..4_000 {
                session.frame(Track::Received, "", u64::from(k) * 1_000, frame(k * 7_919).as_ref())?;
                session.tick(u64::from(k) * 1_000)?;
            }
            session.finish()
        });
        if room < 30_000 {
            let error = outcome.as_mut().expect_err("4000 frames do not fit");
            assert!(error.to_string().contains("cannot write"), "{error}");
        }
    }
}
