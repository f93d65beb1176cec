//! One vehicle's flight out of a telemetry log.

use crate::cli::Failure;
use crate::pipeline::VehicleKind;
use crate::telemetry::{Decoded, Decoder, Encoding};
use crate::vehicle::OutputSource;
use crate::vehicle::airframe::{self, Airframe, Autopilot};
use crate::vehicle::identify::Flight;
use crate::wire::Event;
use crate::wire::tlog::TlogReader;
use std::collections::BTreeMap;
use std::path::Path;

/// A vehicle's flight with what its autopilot says of it.
pub struct Recorded {
    pub system: u8,
    pub flight: Flight,
    pub airframe: Airframe,
    /// Spread of the telemetry's delay: how much later than the least half and 95 % of the stamped messages come, s.
    pub lateness_s: Option<[f64; 2]>,
}

/// Reads the flight of a system, or of the first multirotor in the log.
pub fn read(path: &Path, system: Option<u8>) -> Result<Recorded, Failure> {
    let failed = |e: &dyn std::fmt::Display| Failure::Failed(format!("{}: {e}", path.display()));
    let mut reader = TlogReader::open(path).map_err(|e| failed(&e))?;
    let mut vehicle: Option<(u8, u8, u8)> = None;
    let mut others = Vec::new();
    let mut decoder = Decoder::new(OutputSource::Auto);
    let mut flight = Flight::default();
    let mut reboots = 0;
    let mut capabilities = None;
    let mut parameters: Vec<(String, f32, u8)> = Vec::new();
    let mut lateness = Vec::new();
    while let Some(record) = reader.next().map_err(|e| failed(&e))? {
        let Event::Frame(frame) = record.event else { continue };
        let (id, component) = (frame.system_id(), frame.component_id());
        if frame.message_id() == 0 && vehicle.is_none() && system.is_none_or(|s| s == id) {
            let kind = VehicleKind { autopilot: frame.fields().u8(5), mav_type: frame.fields().u8(4) };
            match (kind.is_multirotor(), Autopilot::from_mav(kind.autopilot)) {
                (true, Some(_)) => vehicle = Some((id, component, kind.autopilot)),
                (_, Some(_)) => others.push(format!("system {id} is no multirotor (type {})", kind.mav_type)),
                _ => {}
            }
        }
        if vehicle.is_none_or(|(s, c, _)| (s, c) != (id, component)) {
            continue;
        }
        match frame.message_id() {
            22 => {
                let f = frame.fields();
                if let Some(name) = f.text(8, 16) {
                    parameters.push((name.to_owned(), f.f32(0), f.u8(24)));
                }
            }
            148 => capabilities = Some(frame.fields().u64(0)),
            // SERVO_OUTPUT_RAW and friends wrap or lack stamps; attitude's boot time is the plainest
            30 => lateness
                .extend(record.received_unix_us.map(|at| at as f64 * 1e-6 - f64::from(frame.fields().u32(0)) * 1e-3)),
            _ => {}
        }
        decoder.frame(frame, record.received_unix_us.unwrap_or(0), &mut |d| match d {
            Decoded::Sample(s) => flight.push(&s),
            Decoded::Reboot => {
                flight = Flight::default();
                reboots += 1;
            }
            _ => {}
        });
    }
    let Some((system, _, autopilot)) = vehicle else {
        others.sort();
        others.dedup();
        let said = if others.is_empty() { "no heartbeat of ArduPilot or PX4".to_owned() } else { others.join("; ") };
        return Err(failed(&format!("{said}: only multirotors are identified")));
    };
    if reboots > 0 {
        tracing::warn!("the vehicle restarted {reboots} times in this log; only what comes after the last is used");
    }
    let encoding = Encoding::of(autopilot, capabilities);
    let known: BTreeMap<String, f64> =
        parameters.into_iter().filter_map(|(name, field, kind)| Some((name, encoding.decode(field, kind)?))).collect();
    let autopilot = Autopilot::from_mav(autopilot).ok_or_else(|| failed(&"an autopilot that is not known"))?;
    let airframe = airframe::from_parameters(autopilot, &|name| known.get(name).copied()).map_err(|e| failed(&e))?;
    Ok(Recorded { system, flight, airframe, lateness_s: spread(lateness) })
}

fn spread(mut lateness: Vec<f64>) -> Option<[f64; 2]> {
    lateness.sort_by(f64::total_cmp);
    let at = |q: f64| lateness.get((lateness.len() as f64 * q) as usize).copied();
    let least = *lateness.first()?;
    Some([at(0.5)? - least, at(0.95)? - least])
}
