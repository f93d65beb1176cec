use super::{Decision, LinkStatus, ObserverStatus, RecordingStatus, SourceStatus, Status, Traffic, VehicleStatus};
use crate::daemon::guard::Guard;
use crate::daemon::links::Outlet;
use crate::daemon::lock::lock;
use crate::daemon::recorder::RecorderState;
use crate::daemon::router::Router;
use crate::pipeline::{Snapshot, VehicleId};
use crate::routing::LinkId;
use crate::signal::Verdict;
use crate::telemetry::timesync::ClockOffset;
use crate::wire::stats::LinkStats;
use crate::wire::{Event, FrameRef};
use std::collections::{BTreeMap, BTreeSet};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, OnceLock};
use tracing::warn;

/// What is known about each link and vehicle; every part of the daemon writes its share.
#[derive(Debug)]
pub(in crate::daemon) struct Board {
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

impl Board {
    /// A board for links with these names.
    pub(in crate::daemon) fn new(names: Vec<String>, outlets: Vec<Outlet>, router: Arc<Router>) -> Self {
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

    pub(in crate::daemon) fn recording(&self, state: Arc<RecorderState>) {
        // there is one recorder; a second call would change nothing
        let _ = self.recorder.set(state);
    }

    /// Everything as it is now.
    pub(in crate::daemon) fn status(&self) -> Status {
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

    pub(in crate::daemon) fn received(&self, link: LinkId, event: &Event<'_>, now_us: u64) {
        if let Some(link) = self.links.get(link.0) {
            lock(&link.received).event(now_us, event);
        }
    }

    /// The link's filter did not take a frame.
    pub(in crate::daemon) fn blocked(&self, link: LinkId) {
        if let Some(link) = self.links.get(link.0) {
            link.blocked.fetch_add(1, Ordering::Relaxed);
        }
    }

    /// A frame came of a second sender with the ids of one that is heard on another link. Told once for each: a
    /// station's ids are often shared, a vehicle's should not be.
    pub(in crate::daemon) fn twin(&self, link: LinkId, frame: FrameRef<'_>) {
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
    pub(in crate::daemon) fn duplicate(&self, link: LinkId) {
        if let Some(link) = self.links.get(link.0) {
            link.duplicates.fetch_add(1, Ordering::Relaxed);
        }
    }

    pub(in crate::daemon) fn estimator_missed(&self) {
        self.estimator_missed.fetch_add(1, Ordering::Relaxed);
    }

    pub(in crate::daemon) fn snapshot(&self, snapshot: &Snapshot<'_>) {
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
    pub(in crate::daemon) fn traffic(&self) -> Vec<LinkStats> {
        self.links.iter().map(|link| lock(&link.received).clone()).collect()
    }

    pub(in crate::daemon) fn clock(&self, vehicle: VehicleId, clock: Option<ClockOffset>) {
        if let Some(status) = lock(&self.vehicles).get_mut(&vehicle) {
            status.clock = clock;
        }
    }

    pub(in crate::daemon) fn pairing(&self, vehicle: VehicleId, decisions: Vec<Decision>) {
        lock(&self.pairings).insert(vehicle, decisions);
    }

    pub(in crate::daemon) fn panicked(&self, vehicle: VehicleId) {
        lock(&self.vehicles).remove(&vehicle);
        lock(&self.pairings).remove(&vehicle);
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
