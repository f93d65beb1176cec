//! Numbers that say how the daemon is doing, and the lines that show them.

use super::guard::Guard;
use super::links::Outlet;
use super::recorder::RecorderState;
use super::router::Router;
use crate::pipeline::{Snapshot, VehicleId, WindEstimate, WrenchEstimate};
use crate::routing::LinkId;
use crate::signal::Verdict;
use crate::telemetry::timesync::ClockOffset;
use crate::wire::stats::{LinkStats, Source};
use crate::wire::{Event, FrameRef};
use std::collections::{BTreeMap, BTreeSet};
use std::fmt::{self, Write};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, OnceLock, PoisonError};
use std::time::Instant;
use tracing::{debug, info, warn};

/// What a link sent and what it could not take. Only ever counts up.
#[derive(Debug, Default)]
pub(super) struct Traffic {
    frames_out: AtomicU64,
    bytes_out: AtomicU64,
    dropped_out: AtomicU64,
    strangers: AtomicU64,
}

/// The same at one moment.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(super) struct TrafficCounts {
    pub(super) frames: u64,
    pub(super) bytes: u64,
    pub(super) dropped: u64,
    pub(super) strangers: u64,
}

impl Traffic {
    pub(super) fn sent(&self, frames: u64, bytes: usize) {
        self.frames_out.fetch_add(frames, Ordering::Relaxed);
        self.bytes_out.fetch_add(bytes as u64, Ordering::Relaxed);
    }

    pub(super) fn dropped(&self, frames: u64) {
        self.dropped_out.fetch_add(frames, Ordering::Relaxed);
    }

    /// A datagram or connection of somebody who is not served.
    pub(super) fn stranger(&self) {
        self.strangers.fetch_add(1, Ordering::Relaxed);
    }

    pub(super) fn counts(&self) -> TrafficCounts {
        let count = |counter: &AtomicU64| counter.load(Ordering::Relaxed);
        TrafficCounts {
            frames: count(&self.frames_out),
            bytes: count(&self.bytes_out),
            dropped: count(&self.dropped_out),
            strangers: count(&self.strangers),
        }
    }
}

/// What is known about each link and vehicle; every part of the daemon writes its share.
#[derive(Debug)]
pub(super) struct Board {
    links: Vec<LinkBoard>,
    router: Arc<Router>,
    vehicles: Mutex<BTreeMap<VehicleId, VehicleStatus>>,
    observers: Mutex<BTreeMap<(VehicleId, &'static str), ObserverStatus>>,
    pairings: Mutex<BTreeMap<VehicleId, Vec<Decision>>>,
    /// Systems of which it was told that there are two.
    twins_told: Mutex<BTreeSet<u8>>,
    estimator_missed: AtomicU64,
    recorder: OnceLock<Arc<RecorderState>>,
}

#[derive(Debug)]
struct LinkBoard {
    name: String,
    outlet: Outlet,
    received: Mutex<LinkStats>,
    blocked: AtomicU64,
    duplicates: AtomicU64,
    twins: AtomicU64,
}

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

impl Board {
    /// A board for links with these names.
    pub(super) fn new(names: Vec<String>, outlets: Vec<Outlet>, router: Arc<Router>) -> Self {
        let links = names.into_iter().zip(outlets).map(|(name, outlet)| LinkBoard {
            name,
            outlet,
            received: Mutex::default(),
            blocked: AtomicU64::new(0),
            duplicates: AtomicU64::new(0),
            twins: AtomicU64::new(0),
        });
        Self {
            links: links.collect(),
            router,
            vehicles: Mutex::default(),
            observers: Mutex::default(),
            pairings: Mutex::default(),
            twins_told: Mutex::default(),
            estimator_missed: AtomicU64::new(0),
            recorder: OnceLock::new(),
        }
    }

    pub(super) fn recording(&self, state: Arc<RecorderState>) {
        // there is one recorder; a second call would change nothing
        let _ = self.recorder.set(state);
    }

    /// Everything as it is now.
    pub(super) fn status(&self) -> Status {
        Status {
            links: self.links.iter().enumerate().map(|(i, l)| l.status(LinkId(i), &self.router)).collect(),
            vehicles: lock(&self.vehicles).clone(),
            observers: lock(&self.observers).clone(),
            pairings: lock(&self.pairings).clone(),
            estimator_missed: self.estimator_missed.load(Ordering::Relaxed),
            recording: self.recorder.get().map(|recorder| RecordingStatus {
                frames: recorder.written(),
                missed: recorder.missed(),
                stopped: recorder.stopped(),
            }),
        }
    }

    pub(super) fn received(&self, link: LinkId, event: &Event<'_>, now_us: u64) {
        if let Some(link) = self.links.get(link.0) {
            lock(&link.received).event(now_us, event);
        }
    }

    /// The link's filter did not take a frame.
    pub(super) fn blocked(&self, link: LinkId) {
        if let Some(link) = self.links.get(link.0) {
            link.blocked.fetch_add(1, Ordering::Relaxed);
        }
    }

    /// A frame came of a second sender with the ids of one that is heard on another link. Told once for each: a
    /// station's ids are often shared, a vehicle's should not be.
    pub(super) fn twin(&self, link: LinkId, frame: FrameRef<'_>) {
        let Some(link) = self.links.get(link.0) else { return };
        link.twins.fetch_add(1, Ordering::Relaxed);
        const AUTOPILOT: u8 = 1;
        let (system, component) = (frame.system_id(), frame.component_id());
        if component == AUTOPILOT && lock(&self.twins_told).insert(system) {
            let link = &link.name;
            warn!(link, system, "a second vehicle with this system id: it is forwarded, but not estimated");
        }
    }

    /// A frame had come before by another link.
    pub(super) fn duplicate(&self, link: LinkId) {
        if let Some(link) = self.links.get(link.0) {
            link.duplicates.fetch_add(1, Ordering::Relaxed);
        }
    }

    pub(super) fn estimator_missed(&self) {
        self.estimator_missed.fetch_add(1, Ordering::Relaxed);
    }

    pub(super) fn snapshot(&self, snapshot: &Snapshot<'_>) {
        let mut vehicles = lock(&self.vehicles);
        let known = vehicles.entry(snapshot.vehicle);
        let status = known.or_insert(VehicleStatus {
            snapshots: 0,
            verdict: snapshot.verdict,
            wrench: None,
            wind: None,
            clock: None,
        });
        status.snapshots += 1;
        status.verdict = snapshot.verdict;
        status.wrench = snapshot.wrench;
        status.wind = snapshot.wind;
        drop(vehicles);
        let mut observers = lock(&self.observers);
        for report in snapshot.observers.iter() {
            let status = observers.entry((snapshot.vehicle, report.name)).or_default();
            status.steps += 1;
            status.consistent += u64::from(report.estimate.verdict == Verdict::Consistent);
        }
    }

    /// What each link received, in detail.
    pub(super) fn traffic(&self) -> Vec<LinkStats> {
        self.links.iter().map(|link| lock(&link.received).clone()).collect()
    }

    pub(super) fn clock(&self, vehicle: VehicleId, clock: Option<ClockOffset>) {
        if let Some(status) = lock(&self.vehicles).get_mut(&vehicle) {
            status.clock = clock;
        }
    }

    pub(super) fn pairing(&self, vehicle: VehicleId, decisions: Vec<Decision>) {
        lock(&self.pairings).insert(vehicle, decisions);
    }

    pub(super) fn panicked(&self, vehicle: VehicleId) {
        lock(&self.vehicles).remove(&vehicle);
    }
}

impl LinkBoard {
    fn status(&self, id: LinkId, router: &Router) -> LinkStatus {
        let traffic = self.outlet.traffic().map(Traffic::counts).unwrap_or_default();
        let (filtered_out, limited_out) = router.held_back(id);
        let (refused_in, withheld_out) = router.guard(id).map_or((0, 0), Guard::counts);
        let (health, overrun_in) = (self.outlet.health(), self.outlet.overruns());
        let received = lock(&self.received);
        LinkStatus {
            name: self.name.clone(),
            down: health.and_then(|health| health.why_down()),
            reconnects: health.map_or(0, |health| health.times_up().saturating_sub(1)),
            peers: self.outlet.peer_count(),
            frames_in: received.totals().frames,
            bytes_in: received.totals().bytes,
            bad_in: received.bad_frames(),
            lost_in: received.losses().lost,
            overrun_in,
            blocked_in: self.blocked.load(Ordering::Relaxed),
            duplicates_in: self.duplicates.load(Ordering::Relaxed),
            twins_in: self.twins.load(Ordering::Relaxed),
            refused_in,
            frames_out: traffic.frames,
            bytes_out: traffic.bytes,
            dropped_out: traffic.dropped,
            filtered_out,
            limited_out,
            withheld_out,
            strangers: traffic.strangers,
            sources: received
                .sources()
                .map(|(source, stats)| SourceStatus {
                    source,
                    frames: stats.totals().frames,
                    bytes: stats.totals().bytes,
                    lost: stats.losses().lost,
                    rate_hz: stats.cadence().mean_rate_hz(),
                    jitter_s: stats.cadence().jitter_s(),
                })
                .collect(),
        }
    }
}

/// Writes a line for each link and vehicle: what happened since the lines before.
#[derive(Debug)]
pub(super) struct StatusLines {
    last: Status,
    at: Instant,
}

impl StatusLines {
    pub(super) fn new(status: Status) -> Self {
        Self { last: status, at: Instant::now() }
    }

    pub(super) fn log(&mut self, now: Status) {
        for (link, source) in now.links.iter().flat_map(|l| l.sources.iter().map(move |s| (l, s))) {
            debug!("link {}: {source}", link.name);
        }
        for line in self.lines(now, Instant::now()) {
            info!("{line}");
        }
    }

    fn lines(&mut self, now: Status, at: Instant) -> Vec<String> {
        let seconds = at.duration_since(self.at).as_secs_f64().max(1e-3);
        let mut lines = Vec::new();
        for (link, last) in now.links.iter().zip(&self.last.links) {
            lines.push(link.line(last, seconds));
        }
        for (id, vehicle) in &now.vehicles {
            let before = self.last.vehicles.get(id).map_or(0, |v| v.snapshots);
            let hz = vehicle.snapshots.saturating_sub(before) as f64 / seconds;
            lines.push(format!("vehicle {id}: {vehicle}, {hz:.0} estimates/s"));
        }
        let missed = now.estimator_missed - self.last.estimator_missed;
        if missed > 0 {
            lines.push(format!("the estimator was too slow for {missed} frames"));
        }
        if let Some(recording) = now.recording {
            let end = if recording.stopped { ", stopped by an error" } else { "" };
            lines.push(format!("recording: {} frames, {} missed{end}", recording.frames, recording.missed));
        }
        (self.last, self.at) = (now, at);
        lines
    }
}

impl LinkStatus {
    fn line(&self, last: &Self, seconds: f64) -> String {
        let per_second = |now: u64, before: u64| now.saturating_sub(before) as f64 / seconds;
        let mut line = format!("link {}: ", self.name);
        // writing into a String cannot fail
        if let Some(why) = &self.down {
            let _ = write!(line, "down ({why}), ");
        }
        let _ = write!(line, "in {:.0} frames/s", per_second(self.frames_in, last.frames_in));
        if self.bad_in > last.bad_in {
            let _ = write!(line, " and {} bad", self.bad_in - last.bad_in);
        }
        if self.lost_in > last.lost_in {
            let _ = write!(line, ", {} lost", self.lost_in - last.lost_in);
        }
        if self.refused_in > last.refused_in {
            let _ = write!(line, ", {} refused by their signatures", self.refused_in - last.refused_in);
        }
        if self.overrun_in > last.overrun_in {
            let _ = write!(line, ", {} not taken in time", self.overrun_in - last.overrun_in);
        }
        let _ = write!(line, ", out {:.0} frames/s", per_second(self.frames_out, last.frames_out));
        let _ = write!(line, " to {} peer{}", self.peers, if self.peers == 1 { "" } else { "s" });
        if self.dropped_out > last.dropped_out {
            let _ = write!(line, ", {} dropped", self.dropped_out - last.dropped_out);
        }
        if self.strangers > last.strangers {
            let _ = write!(line, ", {} datagrams of strangers", self.strangers - last.strangers);
        }
        line
    }
}

impl fmt::Display for SourceStatus {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { source, frames, bytes, lost, rate_hz, jitter_s } = self;
        let jitter_ms = jitter_s * 1e3;
        write!(f, "{source} sent {frames} frames, {bytes} bytes, {lost} lost, {rate_hz:.1} Hz \u{b1} {jitter_ms:.1} ms")
    }
}

impl fmt::Display for VehicleStatus {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(verdict_name(self.verdict))?;
        if let Some(wind) = &self.wind {
            let velocity = wind.velocity_ned_mps;
            let from = (-velocity.y).atan2(-velocity.x).to_degrees().rem_euclid(360.0);
            let width = wind.half_width_mps.xy().max();
            write!(f, ", wind {:.1} \u{b1} {width:.1} m/s from {from:.0}\u{b0}", velocity.xy().norm())?;
        }
        if let Some(wrench) = &self.wrench {
            let width = wrench.force_half_width_n.max();
            write!(f, ", force {:.1} \u{b1} {width:.1} N", wrench.force_ned_n.norm())?;
        }
        Ok(())
    }
}

/// A verdict as a person reads it.
pub(super) fn verdict_name(verdict: Verdict) -> &'static str {
    match verdict {
        Verdict::Consistent => "consistent",
        Verdict::Settling => "settling",
        Verdict::AssumptionViolated => "assumption violated",
        Verdict::Starved => "starved",
        Verdict::Grounded => "on the ground",
    }
}

/// A panic elsewhere leaves counters that are still true.
fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}
