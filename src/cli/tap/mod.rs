//! `mavobserver tap`: what arrives.

mod gaps;
mod screen;
mod table;

use super::run::async_runtime;
use super::{Failure, print};
use crate::config::{Link, LinkUrl};
use crate::daemon::{Control, Daemon, Settings};
use crate::outputs::OutputSettings;
use crate::pipeline::Fleet;
use crate::routing::Rules;
use screen::Screen;
use std::time::Duration;
use table::Table;
use tokio::time::{Instant, MissedTickBehavior, interval_at, sleep_until};
use tokio_util::sync::CancellationToken;

/// Show what arrives on links: systems, messages, rates, jitter, losses, and what the observers would miss
///
/// A table that redraws itself, until Ctrl-C or for `--duration`. Nothing is sent, forwarded or recorded, so a vehicle
/// that waits for someone to speak stays silent. Losses are counted by sequence numbers: frames that come late or twice
/// are not lost.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Examples:
  mavobserver tap udpin:0.0.0.0:14550
  mavobserver tap serial:/dev/ttyACM0:57600
  mavobserver tap tcpout:127.0.0.1:5760 --duration 10 --json
  mavobserver tap tlog:flight.tlog?speed=max

Exit codes: 0 shown, 1 a port or file cannot be opened, or nothing arrived, 2 wrong usage.")]
pub struct TapArgs {
    /// Links, as `mavobserver run --link` takes them
    #[arg(required = true, value_name = "URL")]
    pub urls: Vec<LinkUrl>,
    /// End after so many seconds
    #[arg(long, value_name = "SECONDS", value_parser = seconds)]
    pub duration: Option<f64>,
    /// Seconds between two looks
    #[arg(long, value_name = "SECONDS", default_value = "1", value_parser = seconds)]
    pub every: f64,
    /// Print one JSON object a line for every look
    #[arg(long)]
    pub json: bool,
}

fn seconds(text: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(seconds) if (0.01..=1e7).contains(&seconds) => Ok(seconds),
        _ => Err("must be a number of seconds, 0.01 or more".to_owned()),
    }
}

/// Shows until stopped.
pub fn run(args: &TapArgs) -> Result<(), Failure> {
    let runtime = async_runtime(1)?;
    let frames = runtime.block_on(watch(args));
    runtime.shutdown_background();
    match frames? {
        0 => Err(Failure::Failed("nothing arrived".to_owned())),
        _ => Ok(()),
    }
}

/// Gives how many frames came.
async fn watch(args: &TapArgs) -> Result<u64, Failure> {
    // in one group nothing goes from one link to another
    let rules = Rules { group: Some("tap".to_owned()), ..Rules::default() };
    let link = |url: &LinkUrl| Link { rules: rules.clone(), ..Link::new(url.clone(), OutputSettings::default()) };
    let mut settings = Settings::new(args.urls.iter().map(link).collect());
    settings.duplicates = Duration::ZERO;
    settings.status_every = Duration::from_secs(86_400);
    let daemon = Daemon::bind(settings).await?;
    let control = daemon.control();
    let stop = CancellationToken::new();
    let mut running = tokio::spawn(daemon.run(None::<Fleet>, stop.clone()));

    let begin = Instant::now();
    let end = args.duration.map(|s| begin + Duration::from_secs_f64(s));
    let every = Duration::from_secs_f64(args.every);
    let mut looks = interval_at(begin + every, every);
    looks.set_missed_tick_behavior(MissedTickBehavior::Delay);
    let mut table = Table::new(begin.into_std());
    let mut screen = Screen::new(args.json);
    let mut interrupted = std::pin::pin!(tokio::signal::ctrl_c());
    loop {
        tokio::select! {
            // only logs end, and a daemon that fails
            _ = &mut running => break,
            () = sleep_until(end.unwrap_or(begin)), if end.is_some() => break,
            listened = &mut interrupted => {
                listened.map_err(|e| Failure::Failed(format!("cannot listen for signals: {e}")))?;
                break;
            }
            _ = looks.tick() => {
                table.look(&control);
                show(args, &table, &mut screen)?;
            }
        }
    }
    stop.cancel();
    table.look(&control);
    screen.end();
    if args.json {
        print(&table.json().to_string())?;
    } else {
        print(&table.text())?;
    }
    Ok(frames(&control))
}

fn show(args: &TapArgs, table: &Table, screen: &mut Screen) -> Result<(), Failure> {
    if args.json {
        return print(&table.json().to_string());
    }
    screen.show(&table.text());
    Ok(())
}

fn frames(control: &Control) -> u64 {
    control.traffic().iter().map(|link| link.totals().frames).sum()
}
