//! A recorded log as a link: its frames arrive as they once did.

use crate::config::Pace;
use crate::daemon::clock::unix_us;
use crate::daemon::inlet::Inlet;
use crate::daemon::{DaemonError, READ_AHEAD};
use crate::wire::tlog::{TlogError, TlogReader};
use crate::wire::{BadFrame, BadReason, Event, FrameBuf};
use std::fs::File;
use std::path::Path;
use std::time::Duration;
use tokio::sync::mpsc;
use tokio::time::{Instant, sleep_until};
use tokio_util::sync::CancellationToken;
use tracing::info;

/// Frames that are due this soon are not waited for: timers are no finer.
const TICK: Duration = Duration::from_millis(1);

/// An opened log.
#[derive(Debug)]
pub(in crate::daemon) struct LogLink {
    name: String,
    reader: TlogReader<File>,
    pace: Pace,
}

/// What the reading thread hands over. A bad stretch travels as its size and reason: its bytes are of no more use.
#[allow(clippy::large_enum_variant)] // nearly every item is a frame; a box for each would only cost
enum Item {
    Frame { at_us: Option<u64>, frame: FrameBuf },
    Bad { at_us: Option<u64>, bytes: Vec<u8>, reason: BadReason },
    Broken(TlogError),
}

impl LogLink {
    pub(super) fn open(name: String, path: &Path, pace: Pace) -> Result<Self, DaemonError> {
        match TlogReader::open(path) {
            Ok(reader) => Ok(Self { name, reader, pace }),
            Err(source) => Err(DaemonError::Log { link: name, source }),
        }
    }

    /// Plays the log to its end, or until `stop`.
    ///
    /// A thread reads ahead, because reading a file blocks; it ends when this future is dropped.
    pub(super) async fn play(self, mut inlet: Inlet, stop: CancellationToken) -> Result<(), TlogError> {
        let Self { name, reader, pace } = self;
        let (sender, mut items) = mpsc::channel(READ_AHEAD);
        std::thread::Builder::new().name("log reader".into()).spawn(move || read_all(reader, &sender))?;
        let mut pacer = Pacer::new(pace);
        let mut last_us = unix_us();
        loop {
            let item = tokio::select! {
                () = stop.cancelled() => return Ok(()),
                item = items.recv() => item,
            };
            let at_us = match &item {
                Some(Item::Frame { at_us, .. } | Item::Bad { at_us, .. }) => *at_us,
                Some(Item::Broken(_)) | None => None,
            };
            if let Some(at_us) = at_us {
                last_us = at_us;
                if let Some(due) = pacer.due(at_us, Instant::now()) {
                    tokio::select! {
                        () = stop.cancelled() => return Ok(()),
                        () = sleep_until(due) => {}
                    }
                }
            }
            match item {
                Some(Item::Frame { frame, .. }) => {
                    inlet.take_played(Event::Frame(frame.as_ref()), last_us).await;
                }
                Some(Item::Bad { bytes, reason, .. }) => {
                    let bad = BadFrame { bytes: &bytes, reason };
                    inlet.take_played(Event::Bad(bad), last_us).await;
                }
                Some(Item::Broken(error)) => return Err(error),
                None => {
                    info!(link = name, "the log has ended");
                    return Ok(());
                }
            }
        }
    }
}

fn read_all(mut reader: TlogReader<File>, items: &mpsc::Sender<Item>) {
    loop {
        let item = match reader.next() {
            Ok(None) => return,
            Ok(Some(record)) => {
                let at_us = record.received_unix_us;
                match record.event {
                    Event::Frame(frame) => Item::Frame { at_us, frame: frame.into() },
                    Event::Bad(bad) => Item::Bad { at_us, bytes: bad.bytes.to_vec(), reason: bad.reason },
                }
            }
            Err(error) => Item::Broken(error),
        };
        let broken = matches!(item, Item::Broken(_));
        if items.blocking_send(item).is_err() || broken {
            return;
        }
    }
}

/// When frames are due.
#[derive(Debug)]
struct Pacer {
    /// Log seconds per second; `None` is as fast as possible.
    speed: Option<f64>,
    /// A moment and its stamp in the log.
    anchor: Option<(Instant, u64)>,
    last_us: u64,
}

impl Pacer {
    fn new(pace: Pace) -> Self {
        let speed = match pace {
            Pace::Times(times) => Some(times),
            Pace::Max => None,
        };
        Self { speed, anchor: None, last_us: 0 }
    }

    /// When a frame with this stamp is due, unless that is now. Where stamps go back, the clock starts anew.
    fn due(&mut self, at_us: u64, now: Instant) -> Option<Instant> {
        let speed = self.speed?;
        if at_us < self.last_us {
            self.anchor = None;
        }
        self.last_us = at_us;
        let (start, first_us) = *self.anchor.get_or_insert((now, at_us));
        let log_s = at_us.saturating_sub(first_us) as f64 * 1e-6;
        // a stamp beyond what a timer holds waits as long as there is
        let wait = Duration::try_from_secs_f64(log_s / speed).unwrap_or(Duration::MAX);
        let due = start.checked_add(wait).unwrap_or_else(|| now + Duration::from_secs(86_400 * 365));
        (due > now + TICK).then_some(due)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_are_due_at_their_distance_over_the_speed() {
        let start = Instant::now();
        let mut pacer = Pacer::new(Pace::Times(4.0));
        assert_eq!(pacer.due(5_000_000, start), None);
        assert_eq!(pacer.due(9_000_000, start), Some(start + Duration::from_secs(1)));
        assert_eq!(pacer.due(9_000_000, start + Duration::from_secs(2)), None, "late frames go at once");
        let later = start + Duration::from_secs(3);
        assert_eq!(pacer.due(1_000_000, later), None, "stamps went back");
        assert_eq!(pacer.due(1_400_000, later), Some(later + Duration::from_millis(100)));
        assert!(pacer.due(u64::MAX, later).is_some(), "absurd stamps do not overflow");
        assert_eq!(Pacer::new(Pace::Max).due(9, start), None);
    }
}
