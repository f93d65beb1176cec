//! `mavobserver sim`: a scenario as MAVLink, over UDP or into files.

mod air;
mod files;
mod lockstep;
mod report;
mod server;

use super::Failure;
use crate::config::LinkUrl;
use crate::sim::feed::MavlinkGeneration;
use crate::sim::scenario::{self, Scenario, ScenarioError};
use crate::sim::{Received, Run, RunOptions};
pub(super) use air::Air;
use files::Files;
use lockstep::Lockstep;
use report::Report;
use std::path::PathBuf;
use std::str::FromStr;
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

/// Fly a scenario and send what its autopilots would send
///
/// The vehicles are simulated from their model files, with sensors, wind and faults as the scenario says. Ground
/// stations may ask for streams and parameters and give commands, as of a real autopilot. The same seed gives the same
/// flight. Without a link it runs as fast as the machine goes.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Examples:
  mavobserver sim --list
  mavobserver sim wind-steps --link udpout:127.0.0.1:14550
  mavobserver sim -c my-scenario.toml --tlog out.tlog --truth out.csv
  mavobserver sim px4-wind --link udpout:127.0.0.1:14550 --speed 5 --vehicles 20
  mavobserver sim hover --link udpout:127.0.0.1:14550 --lockstep

Lock-step: after every slice of simulated time the first vehicle sends a TIMESYNC (tc1 = 0) addressed to the ground
station that has spoken, and simulated time stands still until the station answers it (ts1 repeated, tc1 its own time).
Until a station has spoken time passes at the speed asked for.

Exit codes: 0 flown, 1 a port or file cannot be used, 2 wrong usage or scenario.")]
pub struct SimArgs {
    /// A scenario that comes with the program, or a TOML file
    #[arg(value_name = "SCENARIO", required_unless_present_any = ["config", "list"], conflicts_with = "config")]
    pub scenario: Option<String>,
    /// The scenario's TOML file
    #[arg(short, long, value_name = "FILE")]
    pub config: Option<PathBuf>,
    /// Name the scenarios that come with the program
    #[arg(long)]
    pub list: bool,
    /// Where to send: udpout:HOST:PORT, or udpin:HOST:PORT or tcpin:HOST:PORT to wait for ground stations; repeatable
    #[arg(long = "link", value_name = "URL")]
    pub links: Vec<LinkUrl>,
    /// Record what the ground receives
    #[arg(long, value_name = "TLOG")]
    pub tlog: Option<PathBuf>,
    /// Record the truth, 50 rows a second; with several vehicles one file each, their system id in its name
    #[arg(long, value_name = "CSV")]
    pub truth: Option<PathBuf>,
    /// Times real time, or `max`; 1 with a link and `max` without
    #[arg(long, value_name = "N|max")]
    pub speed: Option<Speed>,
    /// Wait for the ground station after every so many simulated milliseconds; as fast as it answers without --speed
    #[arg(long, value_name = "MS", num_args = 0..=1, default_missing_value = "20", requires = "links",
          value_parser = clap::value_parser!(u32).range(1..=10_000))]
    pub lockstep: Option<u32>,
    /// Other random numbers than the scenario's
    #[arg(long)]
    pub seed: Option<u64>,
    /// How many vehicles fly the scenario side by side
    #[arg(long, value_parser = clap::value_parser!(u8).range(1..=250))]
    pub vehicles: Option<u8>,
    /// End after so many simulated seconds
    #[arg(long, value_name = "S")]
    pub duration: Option<f64>,
    /// MAVLink generation
    #[arg(long, value_name = "1|2", default_value_t = 2, value_parser = clap::value_parser!(u8).range(1..=2))]
    pub mavlink: u8,
    /// Time since the autopilots booted when the flight begins, s
    #[arg(long, value_name = "S", default_value_t = 0.0)]
    pub booted_for: f64,
    /// Refuse requests for message intervals, as old firmware does
    #[arg(long)]
    pub refuse_intervals: bool,
    /// Print the summary as one JSON object
    #[arg(long)]
    pub json: bool,
}

/// How fast simulated time passes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Speed {
    Times(f64),
    Max,
}

impl FromStr for Speed {
    type Err = String;

    fn from_str(s: &str) -> Result<Self, String> {
        match s.parse::<f64>() {
            _ if s == "max" => Ok(Self::Max),
            Ok(x) if x > 0.0 && x.is_finite() => Ok(Self::Times(x)),
            _ => Err("a number above 0, or `max`".to_owned()),
        }
    }
}

impl From<ScenarioError> for Failure {
    fn from(e: ScenarioError) -> Self {
        Self::Usage(e.to_string())
    }
}

/// Flies the scenario to its end.
pub fn run(args: &SimArgs) -> Result<(), Failure> {
    if args.list {
        return list();
    }
    let scenario = load(args)?;
    let mut air = Air::open(&args.links)?;
    let speed = args.speed.unwrap_or(if args.links.is_empty() { Speed::Max } else { Speed::Times(1.0) });
    let now = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
    let options = RunOptions {
        generation: if args.mavlink == 1 { MavlinkGeneration::V1 } else { MavlinkGeneration::V2 },
        // a flight into files is the same every time, stamps included
        unix_start_us: if args.links.is_empty() { RunOptions::default().unix_start_us } else { now.as_micros() as u64 },
        boot_offset_s: args.booted_for,
        refuse_intervals: args.refuse_intervals,
    };
    let mut flight = Run::new(&scenario, &options).map_err(|e| Failure::Usage(e.to_string()))?;
    let files = Files::create(args.tlog.as_deref(), args.truth.as_deref(), &flight)?;
    let mut log = Log { report: Report::new(&scenario), files, trouble: Ok(()) };
    let mut lockstep = args.lockstep.map(|ms| Lockstep::new(f64::from(ms) * 1e-3));

    let bar = report::progress(&flight, args.json);
    let started = Instant::now();
    while !flight.done() {
        air.listen(|frame| flight.receive(frame));
        flight.advance(&mut |received| {
            air.send(received.bytes);
            log.frame(&received);
        });
        log.moment(&flight)?;
        let held = match &mut lockstep {
            Some(lockstep) => lockstep.hold(&mut flight, &mut air, &mut |received| log.frame(&received))?,
            None => false,
        };
        match speed {
            // the station sets the pace, unless one was asked for
            _ if held && args.speed.is_none() => {}
            Speed::Max => {}
            Speed::Times(x) => {
                let due = Duration::from_secs_f64(flight.now_s() / x);
                std::thread::sleep(due.saturating_sub(started.elapsed()));
            }
        }
        bar.set_position(flight.now_s() as u64);
    }
    bar.finish_and_clear();
    log.files.finish()?;
    let waited = lockstep.map(|l| l.waited());
    let text = log.report.finish(&flight, started.elapsed(), args.json, air.dropped(), waited);
    super::print(&text)
}

/// What is kept of a flight: figures and files.
struct Log {
    report: Report,
    files: Files,
    /// The first file that could not be written.
    trouble: Result<(), Failure>,
}

impl Log {
    fn frame(&mut self, received: &Received<'_>) {
        self.report.received(received);
        if self.trouble.is_ok() {
            self.trouble = self.files.frame(received);
        }
    }

    fn moment(&mut self, flight: &Run) -> Result<(), Failure> {
        std::mem::replace(&mut self.trouble, Ok(()))?;
        self.files.truth(flight)?;
        self.report.observe(flight);
        Ok(())
    }
}

fn load(args: &SimArgs) -> Result<Scenario, Failure> {
    let mut scenario = match (&args.scenario, &args.config) {
        (_, Some(path)) => scenario::from_file(path)?,
        (Some(name), None) => scenario::resolve(name)?,
        (None, None) => return Err(Failure::Usage("no scenario".to_owned())),
    };
    scenario.vehicles = args.vehicles.unwrap_or(scenario.vehicles);
    if let Some(seconds) = args.duration {
        if seconds.is_nan() || seconds <= 0.0 {
            return Err(Failure::Usage(format!("--duration must be above 0, not {seconds}")));
        }
        scenario.duration_s = seconds;
    }
    Ok(match args.seed {
        Some(seed) => scenario.with_seed(seed),
        None => scenario,
    })
}

fn list() -> Result<(), Failure> {
    let mut lines = Vec::new();
    for name in scenario::names() {
        let s = scenario::resolve(name)?;
        lines.push(format!("{name:20} {:4.0} s  {}", s.duration_s, s.description));
    }
    super::print(&lines.join("\n"))
}
