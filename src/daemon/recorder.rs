//! Recording into tlog files, on a thread of its own so that a slow disk delays nobody.
//!
//! `DIR/TIME.tlog` holds every frame received on any link, as received, and nothing else: replaying it gives what the
//! daemon computed, and its losses are those of the links. Our own messages go beside it into `DIR/TIME.sent.tlog`.
//! TIME is the start in UTC.

use super::batches::{self, Receiver, Refused, Sender, Took, Wake};
use super::clock::file_stamp;
use super::{DaemonError, RECORDER_QUEUE};
use crate::wire::tlog::TlogWriter;
use crate::wire::{FrameBuf, FrameRef};
use std::fs::{self, File};
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::{Duration, Instant};
use tracing::{error, info, warn};

/// A killed process loses no more than this.
const FLUSH_EVERY: Duration = Duration::from_millis(500);
/// Time between two looks into the queue, unless it fills faster. Looking now and then instead of being woken for every
/// frame keeps the cost of recording off the links.
const LOOK_EVERY: Duration = Duration::from_millis(50);
const BUFFER: usize = 64 * 1024;

/// Which of the two files.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Track {
    Received,
    Sent,
}

#[derive(Debug)]
struct Entry {
    track: Track,
    unix_us: u64,
    frame: FrameBuf,
}

/// Gives frames to the recorder; clones share it. The recorder ends when the last is dropped.
#[derive(Debug, Clone)]
pub(super) struct RecorderHandle {
    queue: Sender<Entry>,
    state: Arc<RecorderState>,
}

#[derive(Debug, Default)]
pub(super) struct RecorderState {
    written: AtomicU64,
    missed: AtomicU64,
    in_gap: AtomicBool,
    stopped: AtomicBool,
}

impl RecorderState {
    pub(super) fn written(&self) -> u64 {
        self.written.load(Ordering::Relaxed)
    }

    pub(super) fn missed(&self) -> u64 {
        self.missed.load(Ordering::Relaxed)
    }

    pub(super) fn stopped(&self) -> bool {
        self.stopped.load(Ordering::Relaxed)
    }
}

impl RecorderHandle {
    /// Records a frame, or counts it as missed if the disk is behind or the recorder has stopped.
    pub(super) fn record(&self, track: Track, unix_us: u64, frame: FrameRef<'_>) {
        match self.queue.push(Entry { track, unix_us, frame: frame.into() }) {
            Ok(()) => {
                if self.state.in_gap.load(Ordering::Relaxed) && self.state.in_gap.swap(false, Ordering::Relaxed) {
                    warn!(missed = self.state.missed(), "recording goes on after a gap");
                }
            }
            Err(Refused::Full) => {
                self.state.missed.fetch_add(1, Ordering::Relaxed);
                if !self.state.in_gap.swap(true, Ordering::Relaxed) {
                    warn!("the disk is too slow: the recording has a gap");
                }
            }
            // it stopped with an error that was logged
            Err(Refused::Closed) => {
                self.state.missed.fetch_add(1, Ordering::Relaxed);
            }
        }
    }

    pub(super) fn state(&self) -> Arc<RecorderState> {
        Arc::clone(&self.state)
    }
}

/// The writing end: [`Recorder::run`] belongs on a thread.
#[derive(Debug)]
pub(super) struct Recorder<O> {
    queue: Receiver<Entry>,
    state: Arc<RecorderState>,
    files: O,
}

/// Opens the files of a recording.
pub(super) trait OpenTrack {
    type File: Write;

    fn open(&mut self, track: Track) -> io::Result<Self::File>;
}

impl Recorder<Files> {
    /// Prepares a recording into `directory`, which is made if it is not there, and opens its first file.
    pub(super) fn create(directory: &Path, now_us: u64) -> Result<(RecorderHandle, Self), DaemonError> {
        let failed = |source| DaemonError::Record { directory: directory.to_owned(), source };
        fs::create_dir_all(directory).map_err(failed)?;
        Ok(Self::with(Files::create(directory, now_us).map_err(failed)?))
    }
}

impl<O: OpenTrack> Recorder<O> {
    fn with(files: O) -> (RecorderHandle, Self) {
        let (sender, queue) = batches::channel(RECORDER_QUEUE, Wake::Filled);
        let state = Arc::new(RecorderState::default());
        (RecorderHandle { queue: sender, state: Arc::clone(&state) }, Self { queue, state, files })
    }

    /// Writes until every handle is dropped or the disk fails.
    pub(super) fn run(mut self) {
        match self.write_all() {
            Ok(()) => info!(frames = self.state.written(), missed = self.state.missed(), "recording finished"),
            Err(error) => {
                self.state.stopped.store(true, Ordering::Relaxed);
                error!(frames = self.state.written(), "recording stopped: {error}; everything else goes on");
            }
        }
    }

    fn write_all(&mut self) -> io::Result<()> {
        let (mut received, mut sent) = (None, None);
        let (mut flushed, mut batch) = (Instant::now(), Vec::new());
        loop {
            let took = self.queue.take(&mut batch, LOOK_EVERY);
            for Entry { track, unix_us, frame } in batch.drain(..) {
                let slot = if track == Track::Received { &mut received } else { &mut sent };
                let writer = match slot {
                    Some(writer) => writer,
                    None => {
                        let file = self.files.open(track)?;
                        slot.insert(TlogWriter::new(BufWriter::with_capacity(BUFFER, file)))
                    }
                };
                writer.write(unix_us, frame.as_ref())?;
                self.state.written.fetch_add(1, Ordering::Relaxed);
            }
            if took == Took::Closed {
                break;
            }
            if flushed.elapsed() >= FLUSH_EVERY {
                received.iter_mut().chain(&mut sent).try_for_each(TlogWriter::flush)?;
                flushed = Instant::now();
            }
        }
        received.iter_mut().chain(&mut sent).try_for_each(TlogWriter::flush)
    }
}

/// The files of one recording. The first exists from the start, so that a directory which cannot be written to is an
/// error at the start; the second is made when there is something to write.
#[derive(Debug)]
pub(super) struct Files {
    received: Option<File>,
    sent: PathBuf,
}

impl Files {
    fn create(directory: &Path, now_us: u64) -> io::Result<Self> {
        let stamp = file_stamp(now_us);
        // two daemons may start in one second
        for attempt in 1..=99 {
            let name = if attempt == 1 { stamp.clone() } else { format!("{stamp}-{attempt}") };
            let path = directory.join(format!("{name}.tlog"));
            match File::create_new(&path) {
                Ok(file) => {
                    info!(file = %path.display(), "recording");
                    return Ok(Self { received: Some(file), sent: directory.join(format!("{name}.sent.tlog")) });
                }
                Err(error) if error.kind() == io::ErrorKind::AlreadyExists => {}
                Err(error) => return Err(error),
            }
        }
        Err(io::Error::from(io::ErrorKind::AlreadyExists))
    }
}

impl OpenTrack for Files {
    type File = File;

    fn open(&mut self, track: Track) -> io::Result<File> {
        match (track, self.received.take()) {
            (Track::Received, Some(file)) => Ok(file),
            (Track::Received, None) => Err(io::Error::other("the file was opened before")),
            (Track::Sent, received) => {
                self.received = received;
                File::create_new(&self.sent)
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::wire::dialect::ardupilotmega::SYSTEM_TIME_DATA;
    use crate::wire::tlog::TlogReader;
    use crate::wire::{Encoder, Event};
    use std::sync::Mutex;

    fn frame(number: u32) -> FrameBuf {
        Encoder::new(1, 1).encode(&SYSTEM_TIME_DATA { time_unix_usec: 7, time_boot_ms: number })
    }

    fn read(path: &Path) -> Vec<(u64, FrameBuf)> {
        let mut reader = TlogReader::open(path).expect("a log");
        let mut frames = Vec::new();
        while let Some(record) = reader.next().expect("readable") {
            let Event::Frame(frame) = record.event else { panic!("{:?}", record.event) };
            frames.push((record.received_unix_us.expect("stamped"), frame.into()));
        }
        frames
    }

    fn logs_in(directory: &Path) -> Vec<PathBuf> {
        let mut logs: Vec<_> =
            fs::read_dir(directory).expect("is there").map(|e| e.expect("readable").path()).collect();
        logs.sort();
        logs
    }

    #[test]
    fn both_tracks_are_logs_of_exactly_what_was_given() {
        let directory = tempfile::tempdir().expect("a directory");
        let (handle, recorder) = Recorder::create(&directory.path().join("new"), 0).expect("starts");
        let thread = std::thread::spawn(|| recorder.run());
        for k in 0..500 {
            handle.record(Track::Received, 1_000 + u64::from(k), frame(k).as_ref());
        }
        handle.record(Track::Sent, 9, frame(99).as_ref());
        drop(handle);
        thread.join().expect("no panic");

        let logs = logs_in(&directory.path().join("new"));
        let names: Vec<_> = logs.iter().filter_map(|p| p.file_name()?.to_str()).collect();
        assert_eq!(names, ["19700101T000000Z.sent.tlog", "19700101T000000Z.tlog"]);
        let expected: Vec<_> = (0..500).map(|k| (1_000 + u64::from(k), frame(k))).collect();
        assert_eq!(read(&logs[1]), expected);
        assert_eq!(read(&logs[0]), [(9, frame(99))]);
    }

    #[test]
    fn a_second_recording_in_the_same_second_has_its_own_name() {
        let directory = tempfile::tempdir().expect("a directory");
        let _first = Recorder::create(directory.path(), 0).expect("starts");
        let _second = Recorder::create(directory.path(), 0).expect("starts");
        assert_eq!(logs_in(directory.path()).len(), 2);
    }

    #[test]
    fn what_was_given_is_on_disk_within_a_second() {
        let directory = tempfile::tempdir().expect("a directory");
        let (handle, recorder) = Recorder::create(directory.path(), 0).expect("starts");
        let thread = std::thread::spawn(|| recorder.run());
        handle.record(Track::Received, 5, frame(5).as_ref());
        std::thread::sleep(Duration::from_secs(1));
        assert_eq!(read(&logs_in(directory.path())[0]), [(5, frame(5))], "while the recorder is still running");
        drop(handle);
        thread.join().expect("no panic");
    }

    #[test]
    fn a_place_that_cannot_be_written_is_an_error_at_the_start() {
        let file = tempfile::NamedTempFile::new().expect("a file");
        let error = Recorder::create(&file.path().join("below"), 0).expect_err("a file is no directory");
        assert!(matches!(error, DaemonError::Record { .. }), "{error}");
    }

    /// A disk with room for so many bytes.
    #[derive(Clone)]
    struct SmallDisk {
        room: Arc<Mutex<usize>>,
    }

    impl OpenTrack for SmallDisk {
        type File = Self;

        fn open(&mut self, _: Track) -> io::Result<Self> {
            Ok(self.clone())
        }
    }

    impl Write for SmallDisk {
        fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
            let mut room = self.room.lock().expect("not poisoned");
            if *room < bytes.len() {
                return Err(io::Error::from(io::ErrorKind::StorageFull));
            }
            *room -= bytes.len();
            Ok(bytes.len())
        }

        fn flush(&mut self) -> io::Result<()> {
            Ok(())
        }
    }

    #[test]
    fn a_full_disk_stops_the_recording_and_nothing_else() {
        let (handle, recorder) = Recorder::with(SmallDisk { room: Arc::new(Mutex::new(2 * BUFFER)) });
        let thread = std::thread::spawn(|| recorder.run());
        let before = Instant::now();
        while !handle.state().stopped() && before.elapsed() < Duration::from_secs(20) {
            handle.record(Track::Received, 1, frame(1).as_ref());
        }
        thread.join().expect("no panic");
        assert!(handle.state().stopped());
        let missed = handle.state().missed();
        handle.record(Track::Received, 2, frame(2).as_ref());
        assert_eq!(handle.state().missed(), missed + 1, "still counted, and no panic");
    }
}
