//! `mavobserver run`: the daemon.

pub(super) mod pairing;
mod report;
mod service;

use super::check::{self, CheckArgs};
use super::{ConfigArgs, Failure, print};
use crate::config::{Config, LinkUrl, Recording};
use crate::daemon::{Daemon, DaemonError, Settings, Summary, steady_ns};
use crate::observers;
use crate::pipeline::{Fleet, FleetSettings};
use crate::signal::Channel;
use crate::telemetry::requests::Need;
use crate::vehicle;
use report::report;
use std::path::PathBuf;
use std::sync::Arc;
use tokio_util::sync::CancellationToken;
use tracing::{info, warn};

/// Used where no model is given.
const ASSUMED_MODEL: &str = "arducopter-sitl";

/// Bridge links, estimate wrench and wind of every vehicle on them, and send the estimates back
///
/// Every frame of a link is forwarded, untouched, to where its addressee lives, or to everyone if it has none; the
/// estimates go to all links, as component 191 of the vehicle's own system. Live vehicles are asked for the messages that
/// the observers need. What is unplugged or not there yet is tried again. SIGHUP reads filters, rate limits and groups
/// of the config again without touching a link. Stops at Ctrl-C or SIGTERM, or when all links were logs and have ended.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Examples:
  mavobserver run --link udpin:0.0.0.0:14550 --vehicle my-quad.toml
  mavobserver run --link udpin:0.0.0.0:14540 --link udpout:192.168.1.20:14550 --record logs
  mavobserver run --link serial:/dev/ttyACM0:57600 --link tcpin:0.0.0.0:5760 --no-observers
  mavobserver run --link tlog:flight.tlog --link udpout:127.0.0.1:14550
  mavobserver run -c flight.toml
  mavobserver run -c flight.toml --check

Exit codes: 0 stopped as asked, 1 a port or file cannot be opened, 2 wrong usage or config.")]
pub struct RunArgs {
    #[command(flatten)]
    pub config: ConfigArgs,
    /// Link beside those of the config, repeatable: udpin, udpout, udpbcast, tcpin or tcpout:HOST:PORT,
    /// serial:DEVICE:BAUD[?flow=rtscts], tlog:FILE[?speed=N|max]
    #[arg(long = "link", value_name = "URL")]
    pub links: Vec<LinkUrl>,
    /// Record every received frame, what was sent, and the estimates, as .tlog and .mcap files in this directory
    #[arg(long, value_name = "DIR")]
    pub record: Option<PathBuf>,
    /// Ask the vehicles for nothing
    #[arg(long)]
    pub no_requests: bool,
    /// Estimate nothing: a bridge that records if told so
    #[arg(long)]
    pub no_observers: bool,
    /// Say what would run, and what is wrong or missing, without running it
    #[arg(long)]
    pub check: bool,
    /// At the end, print what passed and the last estimates as one JSON object
    #[arg(long)]
    pub json: bool,
}

/// Runs until stopped.
pub fn run(args: RunArgs) -> Result<(), Failure> {
    if args.check {
        return check::run(CheckArgs { config: args.config, links: args.links, live: None, json: args.json });
    }
    let config = load(&args)?;
    if config.links.is_empty() {
        return Err(Failure::Usage(
            "no link: give one with --link, such as --link udpin:0.0.0.0:14550, or with [[link]] in a config"
                .to_owned(),
        ));
    }
    let runtime = async_runtime(2)?;
    let outcome = runtime.block_on(serve(&args, config));
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

/// The runtime of links.
pub(super) fn async_runtime(workers: usize) -> Result<tokio::runtime::Runtime, Failure> {
    tokio::runtime::Builder::new_multi_thread()
        .worker_threads(workers)
        .enable_all()
        .build()
        .map_err(|e| Failure::Failed(format!("cannot start the async runtime: {e}")))
}

/// The config with all that the command line adds.
fn load(args: &RunArgs) -> Result<Config, Failure> {
    let (mut config, warnings) = args.config.load()?;
    for warning in &warnings {
        warn!("{warning}");
    }
    args.links.iter().for_each(|url| config.add_link(url.clone()));
    if let Some(directory) = args.record.clone() {
        let policy = config.record.map(|r| r.policy).unwrap_or_default();
        config.record = Some(Recording { directory, policy });
    }
    config.requests.streams &= !args.no_requests;
    if args.no_observers {
        config.observers.clear();
    }
    Ok(config)
}

async fn serve(args: &RunArgs, config: Config) -> Result<Summary, Failure> {
    // what is quick to fail comes first: an occupied port is told before a design is computed
    let daemon = Daemon::bind(settings(&config)?).await?;
    let fleet = if config.observers.is_empty() { None } else { Some(build_fleet(fleet(&config)?)?) };
    let stop = CancellationToken::new();
    let names = config.links.iter().map(|link| link.name.clone()).collect();
    let reload = service::Reload { control: daemon.control(), names, read: || load(args) };
    info!(links = config.links.len(), "running; Ctrl-C stops");
    service::until_stopped(daemon.run(fleet, stop.clone()), stop, reload).await
}

/// What the daemon is to do by this config.
pub(super) fn settings(config: &Config) -> Result<Settings, Failure> {
    let mut settings = Settings::new(config.links.clone());
    settings.record.clone_from(&config.record);
    settings.parameters.clone_from(&config.parameters);
    settings.duplicates = config.duplicates;
    settings.models = config.vehicles.clone();
    settings.metrics = config.metrics;
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
        faults: config.faults,
    })
}

impl From<DaemonError> for Failure {
    fn from(e: DaemonError) -> Self {
        Self::Failed(e.to_string())
    }
}
