use super::cannot_write;
use super::copy::Copy;
use super::curves::Curves;
use super::estimates::EstimatesCsv;
use super::summary::{Summary, VehicleSummary};
use crate::cli::{Failure, run};
use crate::config::Config;
use crate::pipeline::{Event, VehicleId};
use crate::record::{LogFacts, RecordError, read_log};
use crate::vehicle::{self, Vehicle};
use crate::wire::stats::LinkStats;
use crate::wire::{self, FrameRef};
use serde::Serialize;
use std::collections::BTreeMap;
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

/// What is written beside the summary.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Outputs<'a> {
    pub estimates: Option<&'a Path>,
    pub mcap: Option<&'a Path>,
    pub force: bool,
    pub curves: bool,
}

/// Everything a replay found.
pub(super) struct Flight {
    pub report: Report,
    pub model: Option<Arc<Vehicle>>,
    pub link: LinkStats,
    pub curves: BTreeMap<VehicleId, Curves>,
}

#[derive(Debug, Serialize)]
pub(super) struct Report {
    pub log: PathBuf,
    pub model: String,
    pub model_assumed: bool,
    pub stamped: bool,
    pub cut_off: bool,
    /// When the first stamped frame was received, s since 1970.
    pub began_unix_s: Option<f64>,
    pub duration_s: f64,
    pub frames: u64,
    pub bad_frames: u64,
    /// Frames that the sequence numbers miss, late and doubled ones not counted.
    pub lost_frames: u64,
    pub late_frames: u64,
    /// The same by the common reckoning, which takes every late frame for a loss of up to 255.
    pub naive_lost_frames: u64,
    pub times_real_time: f64,
    pub vehicles: Vec<VehicleSummary>,
}

/// Runs the observers over one log.
pub(super) fn replay(log: &Path, mut config: Config, wanted: &Outputs<'_>) -> Result<Flight, Failure> {
    let failed = |e: &RecordError| Failure::Failed(format!("{}: {e}", log.display()));
    let model_assumed = config.vehicles.default.is_none();
    if model_assumed {
        let preset = assumed_model(log).map_err(|e| failed(&e))?;
        config.vehicles.default = Some(Arc::new(vehicle::resolve(preset)?));
    }
    let model = config.vehicles.default.clone();
    let name = model.as_ref().map_or_else(String::new, |v| v.name.clone());
    let settings = config.fleet().ok_or_else(|| Failure::Usage("no vehicle model; give --vehicle".to_owned()))?;
    tracing::info!("designing the observers for {name}");
    let mut fleet = run::build_fleet(settings)?;
    let mut csv = wanted.estimates.map(EstimatesCsv::create).transpose();
    let mut csv = match (&mut csv, wanted.estimates) {
        (Ok(csv), _) => csv.take(),
        (Err(e), path) => return Err(cannot_write(path.unwrap_or(log), e)),
    };
    let mut copy = wanted.mcap.map(|to| Copy::begin(log, to, wanted.force)).transpose()?;

    let started = Instant::now();
    let mut summary = Summary::default();
    let mut link = LinkStats::new();
    let mut curves: BTreeMap<VehicleId, Curves> = BTreeMap::new();
    let mut span: Option<(u64, u64)> = None;
    let mut written = Ok(());
    let facts = read_log(log, &mut |record| {
        let at = record.received_unix_us.unwrap_or(0);
        link.event(at, &record.event);
        if let Some(copy) = &mut copy {
            written = copy.record(record);
        }
        let wire::Event::Frame(frame) = record.event else { return flow(&written) };
        if record.received_unix_us.is_some() {
            span = Some(span.map_or((at, at), |(a, b)| (a.min(at), b.max(at))));
        }
        fleet.frame(frame, at, &mut |event| match event {
            Event::NewVehicle { vehicle, kind } => summary.vehicle(vehicle, kind),
            Event::Notice { vehicle, text, .. } => summary.notice(vehicle, text),
            Event::Snapshot(s, _) => {
                summary.snapshot(s);
                if wanted.curves {
                    curves.entry(s.vehicle).or_default().snapshot(s);
                }
                if written.is_ok()
                    && let Some(csv) = &mut csv
                {
                    written = csv.row(s).map_err(|e| cannot_write(wanted.estimates.unwrap_or(log), &e));
                }
                if written.is_ok()
                    && let Some(copy) = &mut copy
                {
                    written = copy.snapshot(s);
                }
            }
        });
        flow(&written)
    });
    written?;
    let LogFacts { stamped, cut_off, .. } = facts.map_err(|e| failed(&e))?;
    if let (Some(csv), Some(path)) = (csv, wanted.estimates) {
        csv.finish().map_err(|e| cannot_write(path, &e))?;
    }
    if let Some(copy) = copy {
        copy.finish()?;
    }

    let duration_s = span.map_or(0.0, |(a, b)| (b - a) as f64 * 1e-6);
    let report = Report {
        log: log.to_owned(),
        model: name,
        model_assumed,
        stamped,
        cut_off,
        began_unix_s: span.map(|(began, _)| began as f64 * 1e-6),
        duration_s,
        frames: link.totals().frames,
        bad_frames: link.bad_frames(),
        lost_frames: link.losses().lost,
        late_frames: link.losses().late,
        naive_lost_frames: link.losses().naive_lost,
        times_real_time: duration_s / started.elapsed().as_secs_f64().max(1e-9),
        vehicles: summary.vehicles(&link, &fleet),
    };
    Ok(Flight { report, model, link, curves })
}

fn flow<E>(written: &Result<(), E>) -> ControlFlow<()> {
    if written.is_ok() { ControlFlow::Continue(()) } else { ControlFlow::Break(()) }
}

/// MAV_AUTOPILOT_PX4.
const PX4: u8 = 12;
const ARDUCOPTER: &str = "arducopter-sitl";

/// The simulator's model of the autopilot whose heartbeat comes first.
fn assumed_model(log: &Path) -> Result<&'static str, RecordError> {
    let mut found = None;
    read_log(log, &mut |record| {
        if let wire::Event::Frame(f) = record.event {
            found = autopilot(f);
        }
        if found.is_some() { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
    })?;
    Ok(if found == Some(PX4) { "px4-sih" } else { ARDUCOPTER })
}

/// MAV_AUTOPILOT of a flight controller's heartbeat.
fn autopilot(f: FrameRef<'_>) -> Option<u8> {
    (f.message_id() == 0).then(|| f.fields().u8(5)).filter(|a| *a != 8)
}
