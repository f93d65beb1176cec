//! The recorder's thread, and the queue that leads to it: a slow disk delays nobody. What is written, and into which
//! files, is [`crate::record::session`]'s.

use super::batches::{self, Receiver, Refused, Sender, Took, Wake};
use super::clock::unix_us;
use super::{DaemonError, RECORDER_QUEUE};
use crate::pipeline::Snapshot;
use crate::record::session::{Disk, Folder, Policy, Session, Track};
use crate::record::{ChannelSink, Encoding, NewChannel, OwnedChannel, Publisher, RecordError};
use crate::wire::{FrameBuf, FrameRef};
use mcap::records::MessageHeader;
use std::fmt;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::Duration;
use tracing::{error, info, warn};

/// Time between two looks into the queue, unless it fills faster. Looking now and then instead of being woken for every
/// frame keeps the cost of recording off the links.
const LOOK_EVERY: Duration = Duration::from_millis(50);

// nearly every entry is a frame, and boxing it would allocate for each
#[allow(clippy::large_enum_variant)]
#[derive(Debug)]
enum Entry {
    Frame {
        track: Track,
        link: u16,
        unix_us: u64,
        frame: FrameBuf,
    },
    /// Of an observer.
    Message {
        channel: Arc<OwnedChannel>,
        header: MessageHeader,
        data: Box<[u8]>,
    },
}

/// Gives frames and estimates to the recorder; clones share it. The recorder ends when the last is dropped.
#[derive(Debug, Clone)]
pub(super) struct RecorderHandle {
    queue: Sender<Entry>,
    state: Arc<RecorderState>,
}

#[derive(Debug, Default)]
pub(super) struct RecorderState {
    written: AtomicU64,
    /// Frames.
    missed: AtomicU64,
    /// Messages of observers.
    estimates_missed: AtomicU64,
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
    /// Records a frame of a link, or counts it as missed if the disk is behind or the recorder has stopped.
    pub(super) fn record(&self, track: Track, link: usize, unix_us: u64, frame: FrameRef<'_>) {
        // there are never as many links as a channel's metadata could tell apart
        let link = u16::try_from(link).unwrap_or(u16::MAX);
        self.give(Entry::Frame { track, link, unix_us, frame: frame.into() });
    }

    pub(super) fn state(&self) -> Arc<RecorderState> {
        Arc::clone(&self.state)
    }

    /// Turns snapshots into estimates for this recorder.
    pub(super) fn estimates(&self) -> Estimates {
        Estimates(Publisher::new(Queue { handle: self.clone(), channels: Vec::new() }, Encoding::Protobuf))
    }

    fn give(&self, entry: Entry) {
        let missed = match &entry {
            Entry::Frame { .. } => &self.state.missed,
            Entry::Message { .. } => &self.state.estimates_missed,
        };
        match self.queue.push(entry) {
            Ok(()) => {
                if self.state.in_gap.load(Ordering::Relaxed) && self.state.in_gap.swap(false, Ordering::Relaxed) {
                    warn!(missed = self.state.missed(), "recording goes on after a gap");
                }
            }
            Err(Refused::Full) => {
                missed.fetch_add(1, Ordering::Relaxed);
                if !self.state.in_gap.swap(true, Ordering::Relaxed) {
                    warn!("the disk is too slow: the recording has a gap");
                }
            }
            // it stopped with an error that was logged
            Err(Refused::Closed) => {
                missed.fetch_add(1, Ordering::Relaxed);
            }
        }
    }
}

/// Records what the observers say.
pub(super) struct Estimates(Publisher<Queue>);

impl fmt::Debug for Estimates {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("Estimates")
    }
}

impl Estimates {
    pub(super) fn snapshot(&mut self, snapshot: &Snapshot<'_>) {
        // the queue takes everything or counts it as missed: there is no error to tell
        let _ = self.0.snapshot(snapshot);
    }
}

/// Sends an observer's messages, each with its channel: the recorder opens it in every file anew.
struct Queue {
    handle: RecorderHandle,
    channels: Vec<Arc<OwnedChannel>>,
}

impl ChannelSink for Queue {
    fn channel(&mut self, new: &NewChannel<'_>) -> Result<u16, RecordError> {
        self.channels.push(Arc::new(new.into()));
        // there are as many as observers
        Ok((self.channels.len() - 1) as u16)
    }

    fn message(&mut self, header: &MessageHeader, data: &[u8]) -> Result<(), RecordError> {
        if let Some(channel) = self.channels.get(usize::from(header.channel_id)) {
            let channel = Arc::clone(channel);
            self.handle.give(Entry::Message { channel, header: *header, data: data.into() });
        }
        Ok(())
    }
}

/// The writing end: [`Recorder::run`] belongs on a thread.
pub(super) struct Recorder<D: Disk> {
    queue: Receiver<Entry>,
    state: Arc<RecorderState>,
    session: Session<D>,
    links: Vec<String>,
}

impl<D: Disk> fmt::Debug for Recorder<D> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Recorder").field("state", &self.state).finish_non_exhaustive()
    }
}

impl Recorder<Folder> {
    /// Prepares a recording into `directory`, which is made if it is not there, and begins it.
    pub(super) fn create(
        directory: &Path,
        policy: Policy,
        links: Vec<String>,
    ) -> Result<(RecorderHandle, Self), DaemonError> {
        let failed = |source| DaemonError::Record { directory: directory.to_owned(), source };
        let folder = Folder::create(directory).map_err(|e| failed(RecordError::Write(e)))?;
        let session = Session::begin(folder, policy, unix_us()).map_err(failed)?;
        info!(directory = %directory.display(), "recording");
        Ok(Self::with(session, links))
    }
}

impl<D: Disk> Recorder<D> {
    fn with(session: Session<D>, links: Vec<String>) -> (RecorderHandle, Self) {
        let (sender, queue) = batches::channel(RECORDER_QUEUE, Wake::Filled);
        let state = Arc::new(RecorderState::default());
        (RecorderHandle { queue: sender, state: Arc::clone(&state) }, Self { queue, state, session, links })
    }

    /// Writes until every handle is dropped or the disk fails.
    pub(super) fn run(mut self) {
        let outcome = self.write_all().and_then(|()| self.session.finish());
        match outcome {
            Ok(_) => info!(frames = self.state.written(), missed = self.state.missed(), "recording finished"),
            Err(error) => {
                self.state.stopped.store(true, Ordering::Relaxed);
                error!(frames = self.state.written(), "recording stopped: {error}; everything else goes on");
            }
        }
    }

    fn write_all(&mut self) -> Result<(), RecordError> {
        let (mut gaps_told, mut batch) = (0, Vec::new());
        loop {
            let took = self.queue.take(&mut batch, LOOK_EVERY);
            for entry in batch.drain(..) {
                self.write(entry)?;
            }
            let missed = self.state.missed() + self.state.estimates_missed.load(Ordering::Relaxed);
            if missed > gaps_told && !self.state.in_gap.load(Ordering::Relaxed) {
                self.session.gap(unix_us(), missed - gaps_told)?;
                gaps_told = missed;
            }
            self.session.tick(unix_us())?;
            self.state.written.store(self.session.written(), Ordering::Relaxed);
            if took == Took::Closed {
                return Ok(());
            }
        }
    }

    fn write(&mut self, entry: Entry) -> Result<(), RecordError> {
        match entry {
            Entry::Frame { track, link, unix_us, frame } => {
                let link = self.links.get(usize::from(link)).map_or("", String::as_str);
                self.session.frame(track, link, unix_us, frame.as_ref())
            }
            Entry::Message { channel, header, data } => self.session.message(unix_us(), &channel, &header, &data),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::wire::Encoder;
    use crate::wire::dialect::ardupilotmega::SYSTEM_TIME_DATA;
    use std::io::{self, Seek, SeekFrom, Write};
    use std::time::Instant;

    fn frame(number: u32) -> FrameBuf {
        Encoder::new(1, 1).encode(&SYSTEM_TIME_DATA { time_unix_usec: 7, time_boot_ms: number })
    }

    #[test]
    fn what_was_given_is_on_disk_within_a_second() {
        let directory = tempfile::tempdir().expect("a directory");
        let (handle, recorder) =
            Recorder::create(directory.path(), Policy::default(), vec!["radio".to_owned()]).expect("starts");
        let thread = std::thread::spawn(|| recorder.run());
        handle.record(Track::Received, 0, unix_us(), frame(5).as_ref());
        std::thread::sleep(Duration::from_secs(1));
        let logs: Vec<_> = std::fs::read_dir(directory.path()).expect("is there").flatten().map(|e| e.path()).collect();
        let log = logs.iter().find(|p| p.extension().is_some_and(|e| e == "tlog")).expect("a log");
        let mut reader = crate::wire::tlog::TlogReader::open(log).expect("readable while it is written");
        assert!(reader.next().expect("readable").is_some());
        drop(handle);
        thread.join().expect("no panic");
    }

    #[test]
    fn a_place_that_cannot_be_written_is_an_error_at_the_start() {
        let file = tempfile::NamedTempFile::new().expect("a file");
        let error = Recorder::create(&file.path().join("below"), Policy::default(), Vec::new()).err();
        assert!(matches!(error, Some(DaemonError::Record { .. })), "{error:?}");
    }

    /// A disk that is full from the start.
    struct Full;

    impl Disk for Full {
        type File = Self;

        fn create(&mut self, _: &str) -> io::Result<Self> {
            Ok(Self)
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

    impl Write for Full {
        fn write(&mut self, _: &[u8]) -> io::Result<usize> {
            Err(io::ErrorKind::StorageFull.into())
        }

        fn flush(&mut self) -> io::Result<()> {
            Ok(())
        }
    }

    impl Seek for Full {
        fn seek(&mut self, _: SeekFrom) -> io::Result<u64> {
            Ok(0)
        }
    }

    #[test]
    fn a_full_disk_stops_the_recording_and_nothing_else() {
        let session =
            Session::begin(Full, Policy { mcap: false, ..Policy::default() }, 0).expect("nothing written yet");
        let (handle, recorder) = Recorder::with(session, Vec::new());
        let thread = std::thread::spawn(|| recorder.run());
        let before = Instant::now();
        while !handle.state().stopped() && before.elapsed() < Duration::from_secs(20) {
            handle.record(Track::Received, 0, 1, frame(1).as_ref());
        }
        thread.join().expect("no panic");
        assert!(handle.state().stopped());
        let missed = handle.state().missed();
        handle.record(Track::Received, 0, 2, frame(2).as_ref());
        assert_eq!(handle.state().missed(), missed + 1, "still counted, and no panic");
    }
}
