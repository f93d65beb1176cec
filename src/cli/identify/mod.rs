//! `mavobserver identify`: a vehicle model from a recorded flight.

mod log;
mod report;

use super::{Failure, print};
use crate::document::Document;
use crate::vehicle;
use crate::vehicle::identify::text::{Basis, vehicle_file};
use crate::vehicle::identify::{Arm, compare, identify};
use std::path::PathBuf;

const EXAMPLES: &str = "Examples:
  mavobserver identify flight.tlog --mass 1.42 --arm 0.24 -o my-quad.toml
  mavobserver identify flight.tlog --mass 1.42 --arm 0.24 --check another-day.tlog
  mavobserver identify flight.tlog --json | jq .drag

A good flight, with 50 Hz of telemetry: hover for half a minute; straight legs of 20 s at 5 m/s or more, there and back,
in two directions; climb and descend at 2 m/s; roll, pitch and turn briskly. Wind does no harm: it is estimated too.";

/// Identify a vehicle model from a recorded flight
///
/// Thrust, drag, torque, lags, delays and noise come from the flight, each with its uncertainty; where the flight does
/// not show one well, the manoeuvre that would is named. No preset is needed. Telemetry shows everything relative to
/// mass: weigh the vehicle, and measure from its centre to a motor.
#[derive(Debug, clap::Args)]
#[command(after_help = EXAMPLES)]
pub struct IdentifyArgs {
    /// A telemetry log (.tlog) of a flight
    log: PathBuf,
    /// Write the model to this vehicle file
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,
    /// Mass of the vehicle as flown, kg
    #[arg(long, value_name = "KG", value_parser = positive)]
    mass: Option<f64>,
    /// From the centre to the outermost motor, m
    #[arg(long, value_name = "M", value_parser = positive)]
    arm: Option<f64>,
    /// Name of the vehicle in the file
    #[arg(long, value_name = "TEXT")]
    name: Option<String>,
    /// The vehicle's MAVLink system id [default: the first multirotor]
    #[arg(long, value_name = "ID")]
    system: Option<u8>,
    /// Hold the result against another flight of the same vehicle
    #[arg(long, value_name = "LOG")]
    check: Option<PathBuf>,
    /// Print one JSON object
    #[arg(long)]
    json: bool,
}

fn positive(text: &str) -> Result<f64, String> {
    text.trim().parse().ok().filter(|x: &f64| x.is_finite() && *x > 0.0).ok_or("expected a positive number".to_owned())
}

pub fn run(args: &IdentifyArgs) -> Result<(), Failure> {
    let failed = |path: &PathBuf, e: &dyn std::fmt::Display| Failure::Failed(format!("{}: {e}", path.display()));
    let recorded = log::read(&args.log, args.system)?;
    tracing::info!("system {}: {}", recorded.system, recorded.airframe.geometry_origin);
    let identified = identify(&recorded.flight, &recorded.airframe).map_err(|e| failed(&args.log, &e))?;
    let Some(arm) = Arm::find(&identified, args.arm) else {
        let why = "the telemetry is too slow to show rotation: give the length of an arm with --arm";
        return Err(failed(&args.log, &why));
    };
    let source = args.log.file_name().map_or_else(String::new, |n| n.to_string_lossy().into_owned());
    let stem = args.log.file_stem().map_or_else(|| "vehicle".to_owned(), |n| n.to_string_lossy().into_owned());
    let name = args.name.clone().unwrap_or_else(|| format!("identified from {stem}"));
    let basis = Basis { name: &name, source: &source, mass_kg: args.mass, arm };
    let text = vehicle_file(&identified, &basis);
    // the file must be one that every other command takes
    let model = vehicle::parse(&Document::new("identified vehicle", text.as_str()))
        .map_err(|issues| failed(&args.log, &format!("the flight gives no valid vehicle: {issues}")))?;
    if let Some(path) = &args.output {
        std::fs::write(path, &text).map_err(|e| Failure::Failed(format!("cannot write {}: {e}", path.display())))?;
    }
    let comparison = match &args.check {
        Some(path) => {
            let other = log::read(path, args.system)?;
            let there = identify(&other.flight, &recorded.airframe).map_err(|e| failed(path, &e))?;
            Some(compare(&identified, &there))
        }
        None => None,
    };
    let report = report::Report { args, recorded: &recorded, identified: &identified, basis: &basis, model: &model };
    print(&if args.json { report.json(comparison.as_deref()) } else { report.text(comparison.as_deref()) })
}
