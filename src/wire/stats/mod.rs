//! What a link carries: frames, bytes, damage, losses, rates and jitter, in all and per sender and message.
//!
//! In: every [`Event`] of one link with the time it was received, µs on any steady clock. Out: counters to read at any
//! time. Memory is bounded: a link remembers [`MAX_SOURCES`] senders and a sender [`MAX_MESSAGES`] message ids; what
//! comes beyond is counted in the totals alone.

mod cadence;
mod sequence;

pub use cadence::Cadence;
pub use sequence::{Losses, Sequence};

use super::{BadFrame, Check, Event, FrameRef};
use std::collections::BTreeMap;
use std::fmt;

/// Senders that a link tells apart.
pub const MAX_SOURCES: usize = 256;
/// Message ids of one sender that are told apart.
pub const MAX_MESSAGES: usize = 512;

/// A sender of frames.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Source {
    pub system: u8,
    pub component: u8,
}

impl fmt::Display for Source {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}/{}", self.system, self.component)
    }
}

/// Plain counts.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Totals {
    /// Whole frames, unknown messages included.
    pub frames: u64,
    /// Bytes of those frames.
    pub bytes: u64,
    /// Frames among them whose message no dialect here defines.
    pub unknown: u64,
}

impl Totals {
    fn add(&mut self, frame: FrameRef<'_>) {
        self.frames += 1;
        self.bytes += frame.bytes().len() as u64;
        self.unknown += u64::from(frame.check() == Check::UnknownMessage);
    }
}

/// One link.
#[derive(Debug, Clone, Default)]
pub struct LinkStats {
    totals: Totals,
    bad_frames: u64,
    bad_bytes: u64,
    cadence: Cadence,
    sources: BTreeMap<Source, SourceStats>,
}

impl LinkStats {
    pub fn new() -> Self {
        Self::default()
    }

    /// Counts whatever came.
    pub fn event(&mut self, now_us: u64, event: &Event<'_>) {
        match event {
            Event::Frame(frame) => self.frame(now_us, *frame),
            Event::Bad(bad) => self.bad(bad),
        }
    }

    pub fn frame(&mut self, now_us: u64, frame: FrameRef<'_>) {
        self.totals.add(frame);
        self.cadence.tick(now_us);
        let source = Source { system: frame.system_id(), component: frame.component_id() };
        if let Some(stats) = self.sources.get_mut(&source) {
            stats.frame(now_us, frame);
        } else if self.sources.len() < MAX_SOURCES {
            self.sources.entry(source).or_default().frame(now_us, frame);
        }
    }

    pub fn bad(&mut self, bad: &BadFrame<'_>) {
        self.bad_frames += 1;
        self.bad_bytes += bad.bytes.len() as u64;
    }

    pub fn totals(&self) -> Totals {
        self.totals
    }

    /// Stretches of bytes that were no frame. Nobody knows who sent them.
    pub fn bad_frames(&self) -> u64 {
        self.bad_frames
    }

    pub fn bad_bytes(&self) -> u64 {
        self.bad_bytes
    }

    /// Rhythm of all frames.
    pub fn cadence(&self) -> &Cadence {
        &self.cadence
    }

    /// The senders, ordered.
    pub fn sources(&self) -> impl Iterator<Item = (Source, &SourceStats)> {
        self.sources.iter().map(|(&source, stats)| (source, stats))
    }

    pub fn source(&self, source: Source) -> Option<&SourceStats> {
        self.sources.get(&source)
    }

    /// The losses of all senders together.
    pub fn losses(&self) -> Losses {
        self.sources.values().map(|s| s.losses()).fold(Losses::default(), Losses::plus)
    }
}

/// What a sender says it is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Heartbeat {
    /// MAV_TYPE.
    pub mav_type: u8,
    /// MAV_AUTOPILOT.
    pub autopilot: u8,
}

const HEARTBEAT: u32 = 0;

/// One sender.
#[derive(Debug, Clone, Default)]
pub struct SourceStats {
    heartbeat: Option<Heartbeat>,
    totals: Totals,
    sequence: Sequence,
    cadence: Cadence,
    /// Ordered by message id.
    messages: Vec<(u32, Cadence)>,
}

impl SourceStats {
    fn frame(&mut self, now_us: u64, frame: FrameRef<'_>) {
        self.totals.add(frame);
        self.sequence.frame(frame);
        self.cadence.tick(now_us);
        let id = frame.message_id();
        if id == HEARTBEAT {
            let fields = frame.fields();
            self.heartbeat = Some(Heartbeat { mav_type: fields.u8(4), autopilot: fields.u8(5) });
        }
        match self.messages.binary_search_by_key(&id, |&(id, _)| id) {
            Ok(at) => self.messages[at].1.tick(now_us),
            Err(at) if self.messages.len() < MAX_MESSAGES => {
                let mut cadence = Cadence::default();
                cadence.tick(now_us);
                self.messages.insert(at, (id, cadence));
            }
            Err(_) => {}
        }
    }

    pub fn totals(&self) -> Totals {
        self.totals
    }

    /// What its last HEARTBEAT says.
    pub fn heartbeat(&self) -> Option<Heartbeat> {
        self.heartbeat
    }

    pub fn losses(&self) -> Losses {
        self.sequence.losses()
    }

    /// Rhythm of all its frames.
    pub fn cadence(&self) -> &Cadence {
        &self.cadence
    }

    /// Rhythm of each message, ordered by id.
    pub fn messages(&self) -> impl Iterator<Item = (u32, &Cadence)> {
        self.messages.iter().map(|(id, cadence)| (*id, cadence))
    }

    pub fn message(&self, id: u32) -> Option<&Cadence> {
        let at = self.messages.binary_search_by_key(&id, |&(id, _)| id).ok()?;
        self.messages.get(at).map(|(_, cadence)| cadence)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::wire::dialect::ardupilotmega::HEARTBEAT_DATA;
    use crate::wire::{Encoder, Parser};

    #[test]
    fn a_link_counts_frames_damage_and_senders() {
        let (mut vehicle, mut station) = (Encoder::new(1, 1), Encoder::new(255, 190));
        let mut stats = LinkStats::new();
        let mut parser = Parser::new();
        for i in 0..10u64 {
            if i == 4 {
                vehicle.sequence += 2;
                parser.push(b"noise");
            }
            parser.push(vehicle.encode(&HEARTBEAT_DATA::default()).bytes());
            if i % 2 == 0 {
                parser.push(station.encode(&HEARTBEAT_DATA::default()).bytes());
            }
            while let Some(event) = parser.next() {
                stats.event(i * 100_000, &event);
            }
        }
        assert_eq!(stats.totals(), Totals { frames: 15, bytes: 15 * 21, unknown: 0 });
        assert_eq!((stats.bad_frames(), stats.bad_bytes()), (1, 5));
        let one = stats.source(Source { system: 1, component: 1 }).unwrap();
        assert_eq!(one.totals().frames, 10);
        assert_eq!(one.losses().lost, 2);
        assert!((one.message(0).unwrap().rate_hz(900_000) - 10.0).abs() < 1e-9);
        assert_eq!(stats.sources().count(), 2);
        assert_eq!(stats.losses().lost, 2);
    }

    #[test]
    fn memory_stays_bounded() {
        let mut stats = LinkStats::new();
        for i in 0..2000u32 {
            let mut encoder = Encoder::new((i / 200) as u8, (i % 200) as u8);
            stats.frame(0, encoder.encode(&HEARTBEAT_DATA::default()).as_ref());
        }
        assert_eq!(stats.sources().count(), MAX_SOURCES);
        assert_eq!(stats.totals().frames, 2000);
    }
}
