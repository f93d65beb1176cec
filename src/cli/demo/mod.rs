//! `mavobserver demo`: a simulated vehicle, the daemon and a ground station on real UDP sockets, in one process.
//!
//! ```text
//!  simulator ──UDP──► daemon ──UDP──► ground station: decodes the estimates, holds them against the truth
//! ```
//!
//! The numbers at the end come from MAVLink messages as the ground station decodes them, nowhere else.

mod bridge;
mod flight;
mod ground;
mod page;
mod screen;
mod summary;

use super::{Failure, logging};
use crate::sim::scenario;
use bridge::Bridge;
use flight::Flight;
use ground::Ground;
use screen::Screen;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, Instant};
use summary::Summary;

/// Watch the whole program work: simulator, daemon and ground station over real UDP, in about a minute
///
/// A simulated vehicle flies through changing wind. The daemon asks it for the streams it needs, estimates force, torque
/// and wind with bounds, and sends them as MAVLink; a ground station decodes them and compares with the truth. Writes a
/// picture and a page of the run and a recording of everything that went over the links.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Examples:
  mavobserver demo
  mavobserver demo --out my-demo --json

Exit codes: 0 done, 1 no estimate came through or a file cannot be written, 2 wrong usage.")]
pub struct DemoArgs {
    /// Directory for the picture, the page and the recording
    #[arg(long, value_name = "DIR", default_value = "demo")]
    pub out: PathBuf,
    /// The scenario to fly: one that comes with the program, or a TOML file
    #[arg(long, value_name = "SCENARIO", default_value = "demo")]
    pub scenario: String,
    /// End after so many seconds of flight
    #[arg(long, value_name = "S")]
    pub duration: Option<f64>,
    /// Print the summary as one JSON object, and nothing else
    #[arg(long)]
    pub json: bool,
}

/// How long frames may be on their way after the flight has ended.
const LAST_FRAMES: Duration = Duration::from_millis(300);

pub fn run(args: &DemoArgs) -> Result<(), Failure> {
    // the table says what the daemon's status lines would
    logging::adopt("warn");
    let mut scenario = scenario::resolve(&args.scenario)?;
    scenario.vehicles = 1;
    if let Some(seconds) = args.duration {
        if seconds.is_nan() || seconds <= 0.0 {
            return Err(Failure::Usage(format!("--duration must be above 0, not {seconds}")));
        }
        scenario.duration_s = seconds;
    }
    std::fs::create_dir_all(&args.out)
        .map_err(|e| Failure::Failed(format!("cannot create {}: {e}", args.out.display())))?;

    let mut screen = Screen::new(args.json);
    screen.say("designing the observer; the first time this takes a few seconds");
    let model = Arc::new(scenario.plan(0).model);
    let bridge = Bridge::start(model, &args.out)?;
    screen.say(&format!(
        "vehicle → {} → daemon → {} → ground station; {:.0} s of flight",
        bridge.vehicle_side(),
        bridge.ground_side(),
        scenario.duration_s
    ));
    let mut ground = Ground::open(bridge.ground_side())?;
    let flight = Flight::start(&scenario, bridge.vehicle_side())?;

    let mut ended: Option<Instant> = None;
    loop {
        ground.listen(&flight)?;
        screen.show(&ground, &flight);
        if flight.done() {
            ended = ended.or(Some(Instant::now()));
        }
        if ended.is_some_and(|e| e.elapsed() > LAST_FRAMES) {
            break;
        }
    }
    let sent = flight.finish()?;
    let recorded = bridge.stop()?;
    let (picture, page) = (args.out.join("demo.svg"), args.out.join("demo.html"));
    let files = [picture.clone(), page.clone()].into_iter().chain(recorded).collect();
    let summary = Summary::new(&scenario, &ground, sent, files);
    write(&picture, &ground.figure().titled(&scenario.description).svg()?)?;
    write(&page, &page::of(&summary, &ground).html()?)?;
    screen.clear();
    super::print(&if args.json { summary.json() } else { summary.text() })?;
    match summary.has_estimates() {
        true => Ok(()),
        false => Err(Failure::Failed("no estimate reached the ground station".to_owned())),
    }
}

fn write(path: &Path, text: &str) -> Result<(), Failure> {
    std::fs::write(path, text).map_err(|e| Failure::Failed(format!("cannot write {}: {e}", path.display())))
}
