use super::curves::verdict_name;
use crate::faults::RotorHealth;
use crate::pipeline::{Fleet, Snapshot, VehicleId, VehicleKind};
use crate::signal::Stamp;
use crate::wire::message_info;
use crate::wire::stats::{LinkStats, Source};
use serde::Serialize;
use std::collections::BTreeMap;

/// Rows of the wind table.
const ROWS: usize = 16;
/// Widest wind bar, characters.
const BAR: usize = 24;

/// Sums of one stretch of time.
#[derive(Debug, Clone, Copy, Default, Serialize)]
struct Stretch {
    n: f64,
    north: f64,
    east: f64,
    half_width: f64,
    bounded: f64,
    force: f64,
}

/// One vehicle's estimates, gathered second by second, so that a log of any length takes little memory.
#[derive(Debug, Default)]
struct Track {
    kind: Option<VehicleKind>,
    first: Option<Stamp>,
    last: Stamp,
    seconds: Vec<Stretch>,
    /// Boot second of `seconds[0]`.
    origin_s: i64,
    steps: u64,
    with_wind: u64,
    verdicts: BTreeMap<&'static str, u64>,
    notices: Vec<(f64, String)>,
}

/// What a replay found, for people and machines.
#[derive(Debug, Default)]
pub struct Summary {
    tracks: BTreeMap<VehicleId, Track>,
}

#[derive(Debug, Serialize)]
pub struct VehicleSummary {
    pub system: u8,
    pub component: u8,
    pub autopilot: String,
    pub mav_type: u8,
    pub first_boot_s: Option<f64>,
    pub last_boot_s: f64,
    pub steps: u64,
    pub streams: Vec<Stream>,
    /// Share of steps with a wind estimate.
    pub wind_share: f64,
    /// Steps by verdict.
    pub verdicts: BTreeMap<&'static str, u64>,
    pub wind: Vec<WindRow>,
    /// In the model's order; empty if no rotor was seen in flight.
    pub rotors: Vec<RotorRow>,
    pub notices: Vec<Notice>,
}

/// One message that observers live on.
#[derive(Debug, Serialize)]
pub struct Stream {
    pub message: &'static str,
    pub rate_hz: f64,
    pub jitter_ms: f64,
}

/// HIGHRES_IMU, RAW_IMU, SCALED_IMU; ATTITUDE_QUATERNION, ATTITUDE; LOCAL_POSITION_NED, ODOMETRY, GLOBAL_POSITION_INT;
/// ACTUATOR_OUTPUT_STATUS, SERVO_OUTPUT_RAW; SCALED_PRESSURE, BATTERY_STATUS.
const STREAMS: [u32; 12] = [105, 27, 26, 31, 30, 32, 331, 33, 375, 36, 29, 147];

#[derive(Debug, Serialize)]
pub struct Notice {
    pub boot_s: f64,
    pub text: String,
}

#[derive(Debug, Serialize)]
pub struct WindRow {
    pub from_boot_s: f64,
    pub to_boot_s: f64,
    pub speed_mps: f64,
    /// The direction the wind comes from, degrees clockwise from north.
    pub from_deg: f64,
    /// Mean half-width of the horizontal components; `None` where nothing is claimed.
    pub half_width_mps: Option<f64>,
    pub force_n: f64,
}

/// What a rotor gave of the thrust that was asked of it, each taken for the only weak one.
#[derive(Debug, Clone, Copy, Serialize)]
pub struct RotorRow {
    /// As the autopilot counts them, from 1.
    pub rotor: usize,
    pub mean_effectiveness: f64,
    pub least_effectiveness: f64,
    pub observed_s: f64,
}

impl Summary {
    pub fn vehicle(&mut self, id: VehicleId, kind: VehicleKind) {
        self.tracks.entry(id).or_default().kind = Some(kind);
    }

    pub fn notice(&mut self, id: VehicleId, text: &str) {
        let track = self.tracks.entry(id).or_default();
        let at = track.last.secs();
        track.notices.push((at, text.to_owned()));
    }

    pub fn snapshot(&mut self, s: &Snapshot<'_>) {
        let t = self.tracks.entry(s.vehicle).or_default();
        let second = s.stamp.secs().floor() as i64;
        if t.first.is_none() {
            t.first = Some(s.stamp);
            t.origin_s = second;
        }
        t.last = s.stamp;
        t.steps += 1;
        *t.verdicts.entry(verdict_name(s.verdict)).or_default() += 1;
        let Some(wind) = s.wind else { return };
        t.with_wind += 1;
        // after a restart boot time begins again: keep adding to the end
        let at = usize::try_from(second - t.origin_s).unwrap_or(0).min(t.seconds.len() + 86_400);
        if at >= t.seconds.len() {
            t.seconds.resize(at + 1, Stretch::default());
        }
        let Some(x) = t.seconds.get_mut(at) else { return };
        x.n += 1.0;
        x.north += wind.velocity_ned_mps.x;
        x.east += wind.velocity_ned_mps.y;
        let hw = 0.5 * (wind.half_width_mps.x + wind.half_width_mps.y);
        if hw.is_finite() {
            x.half_width += hw;
            x.bounded += 1.0;
        }
        x.force += s.wrench.map_or(0.0, |w| w.force_ned_n.norm());
    }

    pub fn vehicles(&self, link: &LinkStats, fleet: &Fleet) -> Vec<VehicleSummary> {
        let of = |(id, t): (&VehicleId, &Track)| t.summary(*id, streams(*id, link), rotors(*id, fleet));
        self.tracks.iter().map(of).collect()
    }
}

fn streams(id: VehicleId, link: &LinkStats) -> Vec<Stream> {
    let Some(source) = link.source(Source { system: id.system, component: id.component }) else { return Vec::new() };
    let of = |message: &u32| {
        let cadence = source.message(*message)?;
        let rate_hz = cadence.mean_rate_hz();
        (rate_hz > 0.0).then(|| Stream {
            message: message_info(*message).map_or("?", |m| m.name),
            rate_hz,
            jitter_ms: cadence.jitter_s() * 1e3,
        })
    };
    STREAMS.iter().filter_map(of).collect()
}

fn rotors(id: VehicleId, fleet: &Fleet) -> Vec<RotorRow> {
    let chain = fleet.vehicles().find(|(known, ..)| *known == id).and_then(|(.., chain)| chain);
    let health = chain.map(|c| c.faults().rotor_health()).unwrap_or_default();
    let row = |(i, h): (usize, RotorHealth)| RotorRow {
        rotor: i + 1,
        mean_effectiveness: h.mean,
        least_effectiveness: h.least,
        observed_s: h.observed_s,
    };
    health.into_iter().enumerate().map(row).collect()
}

impl Track {
    fn summary(&self, id: VehicleId, streams: Vec<Stream>, rotors: Vec<RotorRow>) -> VehicleSummary {
        let kind = self.kind.unwrap_or(VehicleKind { autopilot: 0, mav_type: 0 });
        VehicleSummary {
            system: id.system,
            component: id.component,
            autopilot: match kind.autopilot {
                3 => "ArduPilot".to_owned(),
                12 => "PX4".to_owned(),
                other => format!("autopilot {other}"),
            },
            mav_type: kind.mav_type,
            first_boot_s: self.first.map(Stamp::secs),
            last_boot_s: self.last.secs(),
            steps: self.steps,
            streams,
            wind_share: if self.steps > 0 { self.with_wind as f64 / self.steps as f64 } else { 0.0 },
            verdicts: self.verdicts.clone(),
            wind: self.wind_rows(),
            rotors,
            notices: self.notices.iter().map(|(boot_s, text)| Notice { boot_s: *boot_s, text: text.clone() }).collect(),
        }
    }

    fn wind_rows(&self) -> Vec<WindRow> {
        let used = |s: &&Stretch| s.n > 0.0;
        let Some(begin) = self.seconds.iter().position(|s| s.n > 0.0) else { return Vec::new() };
        let seconds = &self.seconds[begin..];
        let width = seconds.len().div_ceil(ROWS).max(1);
        let chunks = seconds.chunks(width).enumerate();
        chunks
            .filter_map(|(i, chunk)| {
                let sum = chunk.iter().filter(used).fold(Stretch::default(), |a, b| Stretch {
                    n: a.n + b.n,
                    north: a.north + b.north,
                    east: a.east + b.east,
                    half_width: a.half_width + b.half_width,
                    bounded: a.bounded + b.bounded,
                    force: a.force + b.force,
                });
                let (north, east) = (sum.north / sum.n, sum.east / sum.n);
                let from = self.origin_s as f64 + (begin + i * width) as f64;
                (sum.n > 0.0).then(|| WindRow {
                    from_boot_s: from,
                    to_boot_s: from + chunk.len() as f64,
                    speed_mps: north.hypot(east),
                    from_deg: (-east).atan2(-north).to_degrees().rem_euclid(360.0),
                    half_width_mps: (sum.bounded > 0.0).then(|| sum.half_width / sum.bounded),
                    force_n: sum.force / sum.n,
                })
            })
            .collect()
    }
}

impl VehicleSummary {
    /// The readable form.
    pub fn text(&self, model: &str) -> String {
        use std::fmt::Write;
        let mut s = String::new();
        let _ = writeln!(
            s,
            "vehicle {}/{}: {}, model {model}, {} measurements",
            self.system, self.component, self.autopilot, self.steps
        );
        if !self.streams.is_empty() {
            let rates: Vec<String> =
                self.streams.iter().map(|x| format!("{} {}", x.message, rate(x.rate_hz))).collect();
            let _ = writeln!(s, "  streams   {} Hz", rates.join(", "));
        }
        if self.steps > 0 {
            let share = |n: u64| 100.0 * n as f64 / self.steps as f64;
            let verdicts: Vec<String> =
                self.verdicts.iter().map(|(name, n)| format!("{name} {:.1} %", share(*n))).collect();
            let _ = writeln!(s, "  steps     {}", verdicts.join(", "));
        }
        if !self.rotors.is_empty() {
            let each = |r: &RotorRow| {
                format!(
                    "{} {:.0} % (least {:.0} %)",
                    r.rotor,
                    100.0 * r.mean_effectiveness,
                    100.0 * r.least_effectiveness
                )
            };
            let _ = writeln!(s, "  rotors    {}", self.rotors.iter().map(each).collect::<Vec<_>>().join(", "));
        }
        for n in &self.notices {
            let _ = writeln!(s, "  {:>7.1} s {}", n.boot_s, n.text);
        }
        if self.wind.is_empty() {
            let _ = writeln!(s, "  no wind estimate");
            return s;
        }
        let fastest = self.wind.iter().map(|r| r.speed_mps).fold(1.0, f64::max);
        let _ = writeln!(s, "\n     boot time  wind from       speed    bound  force");
        for r in &self.wind {
            let filled = (r.speed_mps / fastest * BAR as f64).round() as usize;
            let direction = if r.speed_mps < 0.5 {
                "   calm ".to_owned()
            } else {
                format!("{} {:>3.0}° {:<2}", arrow(r.from_deg), r.from_deg, compass(r.from_deg))
            };
            let bound = r.half_width_mps.map_or("     –".to_owned(), |h| format!("± {h:4.2}"));
            let _ = writeln!(
                s,
                "  {:>5.0}–{:<5.0} s  {direction:<10} {:>5.1} m/s {bound} {:>5.1} N  {}",
                r.from_boot_s,
                r.to_boot_s,
                r.speed_mps,
                r.force_n,
                "█".repeat(filled.min(BAR))
            );
        }
        s
    }
}

/// Two significant digits, as far as a stream's rate deserves them.
fn rate(hz: f64) -> String {
    if hz < 9.95 { format!("{hz:.1}") } else { format!("{hz:.0}") }
}

/// An arrow that points where the wind blows to, with north up.
fn arrow(from_deg: f64) -> char {
    const ARROWS: [char; 8] = ['↓', '↙', '←', '↖', '↑', '↗', '→', '↘'];
    ARROWS[octant(from_deg)]
}

fn compass(from_deg: f64) -> &'static str {
    const NAMES: [&str; 8] = ["N", "NE", "E", "SE", "S", "SW", "W", "NW"];
    NAMES[octant(from_deg)]
}

fn octant(deg: f64) -> usize {
    // in range by the remainder; NaN counts as north
    ((deg / 45.0).round() as i64).rem_euclid(8) as usize
}
