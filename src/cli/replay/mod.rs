//! `mavobserver replay`: the observers over a log, as fast as the machine goes.

mod estimates;
mod summary;

use super::{ConfigArgs, Failure};
use crate::pipeline::Event;
use crate::vehicle;
use crate::wire::stats::LinkStats;
use crate::wire::tlog::{LogFormat, TlogError, TlogReader};
use crate::wire::{self, FrameRef};
use estimates::EstimatesCsv;
use serde::Serialize;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;
use summary::{Summary, VehicleSummary};

const EXAMPLES: &str = "Examples:
  mavobserver replay flight.tlog
  mavobserver replay flight.tlog --vehicle my-quad.toml --estimates flight.csv
  mavobserver replay flight.tlog --vehicle px4-sih --json | jq .vehicles[0].wind";

/// Run the observers over a recorded flight
#[derive(Debug, clap::Args)]
#[command(after_help = EXAMPLES)]
pub struct ReplayArgs {
    /// A telemetry log (.tlog)
    pub log: PathBuf,
    #[command(flatten)]
    pub config: ConfigArgs,
    /// Write every estimate to this CSV file
    #[arg(long, value_name = "CSV")]
    pub estimates: Option<PathBuf>,
    /// Print the summary as one JSON object
    #[arg(long)]
    pub json: bool,
}

#[derive(Debug, Serialize)]
struct Report {
    log: PathBuf,
    model: String,
    model_assumed: bool,
    duration_s: f64,
    frames: u64,
    bad_frames: u64,
    /// Frames that the sequence numbers miss, late and doubled ones not counted.
    lost_frames: u64,
    late_frames: u64,
    /// The same by the common reckoning, which takes every late frame for a loss of up to 255.
    naive_lost_frames: u64,
    times_real_time: f64,
    vehicles: Vec<VehicleSummary>,
}

pub fn run(args: &ReplayArgs) -> Result<(), Failure> {
    let failed = |e: &dyn std::fmt::Display| Failure::Failed(format!("{}: {e}", args.log.display()));
    let (mut config, warnings) = args.config.load()?;
    for w in &warnings {
        tracing::warn!("{w}");
    }
    let model_assumed = config.vehicles.default.is_none();
    if model_assumed {
        let preset = assumed_model(&args.log).map_err(|e| failed(&e))?;
        config.vehicles.default = Some(Arc::new(vehicle::resolve(preset)?));
    }
    let name = config.vehicles.default.as_ref().map_or_else(String::new, |v| v.name.clone());
    let settings = config.fleet().ok_or_else(|| Failure::Usage("no vehicle model; give --vehicle".to_owned()))?;
    tracing::info!("designing the observers for {name}");
    let mut fleet = super::run::build_fleet(settings)?;
    let mut reader = TlogReader::open(&args.log).map_err(|e| failed(&e))?;
    let mut csv = match &args.estimates {
        Some(path) => Some(EstimatesCsv::create(path).map_err(|e| cannot_write(path, &e))?),
        None => None,
    };

    let started = Instant::now();
    let mut summary = Summary::default();
    let mut link = LinkStats::new();
    let mut span: Option<(u64, u64)> = None;
    let mut written = Ok(());
    while let Some(record) = reader.next().map_err(|e| failed(&e))? {
        let at = record.received_unix_us.unwrap_or(0);
        link.event(at, &record.event);
        let wire::Event::Frame(frame) = record.event else { continue };
        if record.received_unix_us.is_some() {
            span = Some(span.map_or((at, at), |(a, b)| (a.min(at), b.max(at))));
        }
        fleet.frame(frame, at, &mut |event| match event {
            Event::NewVehicle { vehicle, kind } => summary.vehicle(vehicle, kind),
            Event::Notice { vehicle, text, .. } => summary.notice(vehicle, text),
            Event::Snapshot(s, _) => {
                summary.snapshot(s);
                if let (Some(csv), Ok(())) = (csv.as_mut(), &written) {
                    written = csv.row(s);
                }
            }
        });
        if let (Some(path), Err(e)) = (&args.estimates, &written) {
            return Err(cannot_write(path, e));
        }
    }
    if let (Some(csv), Some(path)) = (csv, &args.estimates) {
        csv.finish().map_err(|e| cannot_write(path, &e))?;
    }

    let duration_s = span.map_or(0.0, |(a, b)| (b - a) as f64 * 1e-6);
    let report = Report {
        log: args.log.clone(),
        model: name,
        model_assumed,
        duration_s,
        frames: link.totals().frames,
        bad_frames: link.bad_frames(),
        lost_frames: link.losses().lost,
        late_frames: link.losses().late,
        naive_lost_frames: link.losses().naive_lost,
        times_real_time: duration_s / started.elapsed().as_secs_f64().max(1e-9),
        vehicles: summary.vehicles(&link),
    };
    super::print(&if args.json { json(&report) } else { text(&report, reader.format()) })
}

fn cannot_write(path: &Path, e: &std::io::Error) -> Failure {
    Failure::Failed(format!("cannot write {}: {e}", path.display()))
}

fn json(report: &Report) -> String {
    serde_json::to_string_pretty(report).unwrap_or_else(|e| format!("{{\"error\": \"{e}\"}}"))
}

/// MAV_AUTOPILOT_PX4.
const PX4: u8 = 12;
const ARDUCOPTER: &str = "arducopter-sitl";

/// The simulator's model of the autopilot whose heartbeat comes first.
fn assumed_model(log: &Path) -> Result<&'static str, TlogError> {
    let mut reader = TlogReader::open(log)?;
    while let Some(record) = reader.next()? {
        if let wire::Event::Frame(f) = record.event
            && let Some(autopilot) = autopilot(f)
        {
            return Ok(if autopilot == PX4 { "px4-sih" } else { ARDUCOPTER });
        }
    }
    Ok(ARDUCOPTER)
}

/// MAV_AUTOPILOT of a flight controller's heartbeat.
fn autopilot(f: FrameRef<'_>) -> Option<u8> {
    (f.message_id() == 0).then(|| f.fields().u8(5)).filter(|a| *a != 8)
}

fn text(r: &Report, format: LogFormat) -> String {
    use std::fmt::Write;
    let mut s = String::new();
    let _ = write!(s, "{}: {:.0} s, {} frames", r.log.display(), r.duration_s, r.frames);
    for (n, what) in [(r.bad_frames, "bad"), (r.lost_frames, "lost"), (r.late_frames, "late")] {
        if n > 0 {
            let _ = write!(s, ", {n} {what}");
        }
    }
    let _ = match format {
        LogFormat::Stamped => writeln!(s, ", replayed {:.0}× faster than it was flown", r.times_real_time),
        LogFormat::Raw => writeln!(s, " (no time stamps in this log)"),
    };
    if r.model_assumed {
        let _ = writeln!(s, "model {} assumed; give --vehicle for any other vehicle than the simulator's", r.model);
    }
    if r.vehicles.is_empty() {
        let _ = writeln!(s, "\nno vehicle: no autopilot's heartbeat in this log, so there is nothing to estimate");
    }
    for v in &r.vehicles {
        let _ = write!(s, "\n{}", v.text(&r.model));
    }
    s
}
