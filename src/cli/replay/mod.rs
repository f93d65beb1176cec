//! `mavobserver replay`: the observers over a log, as fast as the machine goes.

mod copy;
mod curves;
mod estimates;
mod flight;
mod folder;
mod page;
mod summary;

use super::{ConfigArgs, Failure};
use flight::{Outputs, Report};
use std::path::{Path, PathBuf};

const EXAMPLES: &str = "Examples:
  mavobserver replay flight.tlog
  mavobserver replay flight.tlog --vehicle my-quad.toml --estimates flight.csv
  mavobserver replay flight.ulg --vehicle my-quad.toml --report flight.html --mcap flight.mcap
  mavobserver replay logs/ --vehicle my-quad.toml              # one row for each flight
  mavobserver replay flight.tlog --vehicle px4-sih --json | jq .vehicles[0].wind";

/// Run the observers over recorded flights
///
/// Reads telemetry logs, MAVLink streams without time stamps, MCAP recordings, PX4's ULog and ArduPilot's dataflash logs;
/// the latter two at their full rate.
#[derive(Debug, clap::Args)]
#[command(after_help = EXAMPLES)]
pub struct ReplayArgs {
    /// A log (.tlog, .rlog, .mcap, .ulg, .bin), or a folder of them
    pub log: PathBuf,
    #[command(flatten)]
    pub config: ConfigArgs,
    /// Write every estimate to this CSV file
    #[arg(long, value_name = "CSV")]
    pub estimates: Option<PathBuf>,
    /// Write a copy of the log with the estimates as a recording
    #[arg(long, value_name = "MCAP")]
    pub mcap: Option<PathBuf>,
    /// Write a page about the flight that needs nothing but a browser
    #[arg(long, value_name = "HTML")]
    pub report: Option<PathBuf>,
    /// Overwrite an existing file of `--mcap`
    #[arg(long)]
    pub force: bool,
    /// Print the summary as one JSON object
    #[arg(long)]
    pub json: bool,
}

pub fn run(args: &ReplayArgs) -> Result<(), Failure> {
    let (config, warnings) = args.config.load()?;
    for w in &warnings {
        tracing::warn!("{w}");
    }
    if args.log.is_dir() {
        if args.estimates.is_some() || args.mcap.is_some() || args.report.is_some() {
            let advice = "--estimates, --mcap and --report are for one flight, not for a folder";
            return Err(Failure::Usage(advice.to_owned()));
        }
        return folder::run(&args.log, config, args.json);
    }
    let wanted = Outputs {
        estimates: args.estimates.as_deref(),
        mcap: args.mcap.as_deref(),
        force: args.force,
        curves: args.report.is_some(),
    };
    let flight = flight::replay(&args.log, config, &wanted)?;
    if let Some(path) = &args.report {
        let html = page::of(&flight).html().map_err(|e| Failure::Failed(e.to_string()))?;
        std::fs::write(path, html).map_err(|e| cannot_write(path, &e))?;
    }
    super::print(&if args.json { json(&flight.report) } else { text(&flight.report) })
}

fn cannot_write(path: &Path, e: &dyn std::fmt::Display) -> Failure {
    Failure::Failed(format!("cannot write {}: {e}", path.display()))
}

fn json(report: &impl serde::Serialize) -> String {
    serde_json::to_string_pretty(report).unwrap_or_else(|e| format!("{{\"error\": \"{e}\"}}"))
}

fn text(r: &Report) -> String {
    use std::fmt::Write;
    let mut s = String::new();
    let _ = write!(s, "{}: {:.0} s, {} frames", r.log.display(), r.duration_s, r.frames);
    for (n, what) in [(r.bad_frames, "bad"), (r.lost_frames, "lost"), (r.late_frames, "late")] {
        if n > 0 {
            let _ = write!(s, ", {n} {what}");
        }
    }
    let _ = if r.stamped {
        writeln!(s, ", replayed {:.0}× faster than it was flown", r.times_real_time)
    } else {
        writeln!(s, " (no time stamps in this log)")
    };
    if r.cut_off {
        let _ = writeln!(s, "the log ends in the middle; everything before was read");
    }
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
