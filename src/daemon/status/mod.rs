//! Numbers that say how the daemon is doing. What counts them is in `board` and `traffic`, what shows them in `lines`.

mod board;
mod lines;
mod traffic;

pub(super) use board::Board;
pub(super) use lines::{StatusLines, verdict_name};
pub(super) use traffic::Traffic;

use crate::pipeline::{VehicleId, WindEstimate, WrenchEstimate};
use crate::signal::Verdict;
use crate::telemetry::timesync::ClockOffset;
use crate::wire::stats::Source;
use std::collections::BTreeMap;

/// One link so far.
#[derive(Debug, Clone, PartialEq)]
pub struct LinkStatus {
    pub name: String,
    /// Why the link is down at present.
    pub down: Option<String>,
    /// How often it came up again after the first time.
    pub reconnects: u64,
    pub peers: usize,
    pub frames_in: u64,
    pub bytes_in: u64,
    /// Stretches of bytes that are no frame.
    pub bad_in: u64,
    /// Frames that never came, by the senders' sequence numbers.
    pub lost_in: u64,
    /// Datagrams that the kernel dropped because we were too slow, by its own count. Their frames are in `lost_in` as
    /// far as the numbers show: a gap of 256 frames or more shows shorter.
    pub overrun_in: u64,
    /// Frames that the link's filter did not take.
    pub blocked_in: u64,
    /// Frames that had come before by another link.
    pub duplicates_in: u64,
    /// Frames of a second sender with the ids of one that is heard on another link.
    pub twins_in: u64,
    /// Frames whose signature is missing or wrong.
    pub refused_in: u64,
    pub frames_out: u64,
    pub bytes_out: u64,
    /// Frames that the socket did not take, that a full queue had no room for, or that were on their way when a
    /// connection broke.
    pub dropped_out: u64,
    /// Frames that the link's filter and its rate limits held back.
    pub filtered_out: u64,
    pub limited_out: u64,
    /// Frames that cannot be signed, on a link where all are.
    pub withheld_out: u64,
    /// Datagrams and connections of senders that are not served.
    pub strangers: u64,
    pub sources: Vec<SourceStatus>,
}

/// One sender of frames on a link so far.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SourceStatus {
    pub source: Source,
    pub frames: u64,
    pub bytes: u64,
    pub lost: u64,
    /// Frames per second, from the first to the last.
    pub rate_hz: f64,
    /// Deviation of the time between frames lately, s.
    pub jitter_s: f64,
}

/// One vehicle, as last estimated.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct VehicleStatus {
    pub snapshots: u64,
    pub verdict: Verdict,
    pub wrench: Option<WrenchEstimate>,
    pub wind: Option<WindEstimate>,
    pub clock: Option<ClockOffset>,
}

/// One observer of one vehicle so far.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct ObserverStatus {
    pub steps: u64,
    /// Steps whose data agreed with what the observer assumes.
    pub consistent: u64,
}

/// One thing that was found out about a vehicle or decided for it while pairing.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Decision {
    pub subject: String,
    pub text: String,
    /// Nothing has to be done about it.
    pub good: bool,
}

/// Everything at one moment.
#[derive(Debug, Clone, PartialEq)]
pub struct Status {
    pub links: Vec<LinkStatus>,
    pub vehicles: BTreeMap<VehicleId, VehicleStatus>,
    /// By vehicle and registry name.
    pub observers: BTreeMap<(VehicleId, &'static str), ObserverStatus>,
    /// What each live vehicle was asked for and what came of it.
    pub pairings: BTreeMap<VehicleId, Vec<Decision>>,
    /// Frames that came while the estimator's queue was full.
    pub estimator_missed: u64,
    pub recording: Option<RecordingStatus>,
}

/// The recording so far.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct RecordingStatus {
    pub frames: u64,
    /// Frames that the disk was too slow for, or that came after it failed.
    pub missed: u64,
    /// The disk failed.
    pub stopped: bool,
}
