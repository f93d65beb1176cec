//! `mavobserver run`: the daemon.

use super::{ConfigArgs, Failure, print};
use crate::config::{Config, LinkUrl, Recording};
use crate::daemon::{Daemon, DaemonError, Settings, Status, Summary, steady_ns};
use crate::observers;
use crate::pipeline::{Fleet, FleetSettings};
use crate::signal::Channel;
use crate::telemetry::requests::Need;
use crate::vehicle;
use nalgebra::Vector3;
use serde_json::{Value, json};
use std::io;
use std::path::PathBuf;
use std::sync::Arc;
use tokio_util::sync::CancellationToken;
use tracing::{info, warn};

/// Used where no model is given.
const ASSUMED_MODEL: &str = "arducopter-sitl";

/// Bridge links, estimate wrench and wind of every vehicle on them, and send the estimates back
///
/// Every frame of a link is forwarded, untouched, to the others; the estimates go to all of them, as component 191 of the
/// vehicle's own system. Live vehicles are asked for the messages that the observers need. Stops at Ctrl-C or SIGTERM,
/// or when all links were logs and have ended.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Examples:
  mavobserver run --link udpin:0.0.0.0:14550 --vehicle my-quad.toml
  mavobserver run --link udpin:0.0.0.0:14540 --link udpout:192.168.1.20:14550 --record logs
  mavobserver run --link tlog:flight.tlog --link udpout:127.0.0.1:14550
  mavobserver run -c flight.toml

Exit codes: 0 stopped as asked, 1 a port or file cannot be opened, 2 wrong usage or config.")]
pub struct RunArgs {
    #[command(flatten)]
    pub config: ConfigArgs,
    /// udpin:HOST:PORT, udpout:HOST:PORT or tlog:FILE[?speed=N|max], beside those of the config; repeatable
    #[arg(long = "link", value_name = "URL")]
    pub links: Vec<LinkUrl>,
    /// Record every received frame, what was sent, and the estimates, as .tlog and .mcap files in this directory
    #[arg(long, value_name = "DIR")]
    pub record: Option<PathBuf>,
    /// Ask the vehicles for nothing
    #[arg(long)]
    pub no_requests: bool,
    /// At the end, print what passed and the last estimates as one JSON object
    #[arg(long)]
    pub json: bool,
}

/// Runs until stopped.
pub fn run(args: RunArgs) -> Result<(), Failure> {
    let (mut config, warnings) = args.config.load()?;
    for warning in &warnings {
        warn!("{warning}");
    }
    args.links.into_iter().for_each(|url| config.add_link(url));
    if config.links.is_empty() {
        return Err(Failure::Usage(
            "no link: give one with --link, such as --link udpin:0.0.0.0:14550, or with [[link]] in a config"
                .to_owned(),
        ));
    }
    if let Some(directory) = args.record {
        let policy = config.record.map(|r| r.policy).unwrap_or_default();
        config.record = Some(Recording { directory, policy });
    }
    config.requests.streams &= !args.no_requests;

    let runtime = tokio::runtime::Builder::new_multi_thread()
        .worker_threads(2)
        .enable_all()
        .build()
        .map_err(|e| Failure::Failed(format!("cannot start the async runtime: {e}")))?;
    let outcome = runtime.block_on(serve(config));
    // a straggler must not keep the process alive
    runtime.shutdown_background();
    let summary = outcome?;
    if args.json {
        print(&format!("{:#}", report(&summary.status)))?;
    }
    if summary.stragglers.is_empty() {
        return Ok(());
    }
    Err(Failure::Failed(format!("stopped without waiting any longer for {}", summary.stragglers.join(", "))))
}

async fn serve(config: Config) -> Result<Summary, Failure> {
    // what is quick to fail comes first: an occupied port is told before a design is computed
    let daemon = Daemon::bind(settings(&config)?).await?;
    let fleet = fleet(&config)?;
    let fleet = build_fleet(fleet)?;
    let stop = CancellationToken::new();
    stop_on_signals(stop.clone()).map_err(|e| Failure::Failed(format!("cannot listen for signals: {e}")))?;
    info!(links = config.links.len(), "running; Ctrl-C stops");
    Ok(daemon.run(fleet, stop).await?)
}

/// What the daemon is to do by this config.
pub(super) fn settings(config: &Config) -> Result<Settings, Failure> {
    let mut settings = Settings::new(config.links.clone());
    settings.record.clone_from(&config.record);
    if config.requests.streams {
        let mut needs = Vec::new();
        for observer in &config.observers {
            let registration = observers::find(&observer.name).map_err(|e| Failure::Usage(e.to_string()))?;
            needs.extend(registration.needs.iter().map(|&channel| {
                let usual = Need::at_default_rate(channel);
                let fast = usual.rate_hz == Need::FAST_HZ;
                if fast { Need { rate_hz: config.requests.rate_hz, ..usual } } else { usual }
            }));
        }
        // thrust depends on voltage and air density; without them the model's reference values serve
        needs.extend([Channel::Battery, Channel::Pressure].map(|c| Need::at_default_rate(c).optional()));
        settings.requests = Some(needs);
    }
    Ok(settings)
}

/// Designs the observers for every vehicle model, says which were left out, and times their steps.
pub(super) fn build_fleet(settings: FleetSettings) -> Result<Fleet, Failure> {
    let fleet = Fleet::new(settings).map_err(|e| Failure::Failed(e.to_string()))?.timed(steady_ns);
    for reason in fleet.left_out() {
        info!("{reason}");
    }
    Ok(fleet)
}

fn fleet(config: &Config) -> Result<FleetSettings, Failure> {
    if let Some(fleet) = config.fleet() {
        return Ok(fleet);
    }
    warn!("no vehicle model: assuming {ASSUMED_MODEL}, which is right for that simulator alone; see --vehicle");
    let model = vehicle::resolve(ASSUMED_MODEL)?;
    Ok(FleetSettings {
        vehicle: Arc::new(model),
        by_system: config.vehicles.by_system.clone(),
        observers: config.observers.clone(),
    })
}

/// Cancels `stop` at the first SIGINT (Ctrl-C) or SIGTERM.
fn stop_on_signals(stop: CancellationToken) -> io::Result<()> {
    #[cfg(unix)]
    let mut terminate = tokio::signal::unix::signal(tokio::signal::unix::SignalKind::terminate())?;
    #[cfg(unix)]
    let mut interrupt = tokio::signal::unix::signal(tokio::signal::unix::SignalKind::interrupt())?;
    tokio::spawn(async move {
        #[cfg(unix)]
        tokio::select! {
            _ = terminate.recv() => info!("SIGTERM: stopping"),
            _ = interrupt.recv() => info!("interrupted: stopping"),
        }
        #[cfg(not(unix))]
        if tokio::signal::ctrl_c().await.is_err() {
            return;
        }
        stop.cancel();
    });
    Ok(())
}

fn report(status: &Status) -> Value {
    // JSON knows no infinity: a half-width that claims nothing is null there
    let vector = |v: &Vector3<f64>| json!([v.x, v.y, v.z]);
    let links = status.links.iter().map(|l| {
        let sources = l.sources.iter().map(|s| {
            json!({
                "system": s.source.system, "component": s.source.component, "frames": s.frames, "bytes": s.bytes,
                "lost": s.lost, "rate_hz": s.rate_hz, "jitter_s": s.jitter_s,
            })
        });
        json!({
            "name": l.name, "peers": l.peers, "frames_in": l.frames_in, "bytes_in": l.bytes_in, "bad_in": l.bad_in,
            "lost_in": l.lost_in, "frames_out": l.frames_out, "bytes_out": l.bytes_out,
            "dropped_out": l.dropped_out, "strangers": l.strangers, "sources": sources.collect::<Vec<_>>(),
        })
    });
    let vehicles = status.vehicles.iter().map(|(id, v)| {
        json!({
            "system": id.system, "component": id.component, "snapshots": v.snapshots,
            "verdict": format!("{:?}", v.verdict),
            "wrench": v.wrench.map(|w| json!({
                "force_ned_n": vector(&w.force_ned_n), "force_half_width_n": vector(&w.force_half_width_n),
                "torque_frd_nm": vector(&w.torque_frd_nm), "torque_half_width_nm": vector(&w.torque_half_width_nm),
            })),
            "wind": v.wind.map(|w| json!({
                "velocity_ned_mps": vector(&w.velocity_ned_mps), "half_width_mps": vector(&w.half_width_mps),
            })),
            "clock_ours_minus_theirs_ns": v.clock.map(|c| c.ours_minus_theirs_ns),
        })
    });
    json!({
        "links": links.collect::<Vec<_>>(),
        "vehicles": vehicles.collect::<Vec<_>>(),
        "estimator_missed": status.estimator_missed,
        "recording": status.recording.map(|r| json!({
            "frames": r.frames, "missed": r.missed, "stopped": r.stopped,
        })),
    })
}

impl From<DaemonError> for Failure {
    fn from(e: DaemonError) -> Self {
        Self::Failed(e.to_string())
    }
}
