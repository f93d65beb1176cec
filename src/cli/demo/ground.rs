use super::flight::Flight;
use crate::cli::Failure;
use crate::evaluate::Errors;
use crate::report::{Colour, Figure, Panel};
use crate::signal::Stamp;
use crate::wire::dialect::ardupilotmega::{HEARTBEAT_DATA, MavAutopilot, MavState, MavType};
use crate::wire::dialect::mavobserver::{MavobserverVerdict, WIND_ESTIMATE_DATA, WRENCH_ESTIMATE_DATA};
use crate::wire::{Encoder, Event, FrameRef, Parser, decode, message_info};
use nalgebra::Vector3;
use std::collections::BTreeMap;
use std::io::ErrorKind;
use std::net::{SocketAddr, UdpSocket};
use std::time::{Duration, Instant};

/// Our messages carry this component.
const COMPONENT: u8 = crate::outputs::OutputSettings::COMPONENT;
const HEARTBEAT_EVERY: Duration = Duration::from_secs(1);
/// How long one call waits for a datagram.
const PATIENCE: Duration = Duration::from_millis(20);

/// Broken assumptions closer together than this are one stretch, s.
const JOINED_S: f64 = 0.5;
/// About the time between two estimates: so long one of them stands, s.
const SHOWN_S: f64 = 0.1;

/// A ground station: says that it is there, decodes what arrives, and holds the estimates against the truth.
pub(super) struct Ground {
    socket: UdpSocket,
    encoder: Encoder,
    parser: Parser,
    last_heartbeat: Option<Instant>,
    pub force: Track,
    pub torque: Track,
    pub wind: Track,
    pub verdict: Option<MavobserverVerdict>,
    /// Wrench estimates in the air, and those that said that their assumptions are broken.
    estimates: u64,
    broken: u64,
    /// When they did, on the boot clock, s.
    broken_at: Vec<[f64; 2]>,
    /// Frames by message name, ours and the vehicle's.
    pub ours: BTreeMap<&'static str, u64>,
    pub vehicles: u64,
    /// First and last estimate, on the boot clock, s.
    pub span_s: Option<(f64, f64)>,
}

/// Time (s), truth, estimate, half-width.
type Point = (f64, Vector3<f64>, Vector3<f64>, Vector3<f64>);

/// Bounds given, and those that held.
#[derive(Default)]
pub(super) struct Held {
    bounded: u64,
    covered: u64,
}

impl Held {
    fn add(&mut self, held: bool) {
        self.bounded += 1;
        self.covered += u64::from(held);
    }

    pub fn share(&self) -> Option<f64> {
        (self.bounded > 0).then(|| self.covered as f64 / self.bounded as f64)
    }
}

/// One vector over time.
#[derive(Default)]
pub(super) struct Track {
    pub errors: [Errors; 3],
    /// Bounds that held: of all, and of those given while the observer called its assumptions sound.
    pub all: Held,
    pub sound: Held,
    pub last: Option<(Vector3<f64>, Vector3<f64>)>,
    series: Vec<Point>,
}

impl Track {
    fn add(&mut self, sound: bool, (t_s, truth, estimate, half_width): Point) {
        let error = estimate - truth;
        for (errors, (e, w)) in self.errors.iter_mut().zip(error.iter().zip(half_width.iter())) {
            errors.add(*e, *w);
        }
        if half_width.iter().all(|w| w.is_finite()) {
            let held = error.abs() <= half_width;
            self.all.add(held);
            if sound {
                self.sound.add(held);
            }
        }
        self.series.push((t_s, truth, estimate, half_width));
    }

    fn panel(&self, axis: usize, title: &str, unit: &str) -> Panel {
        let at = |v: &Vector3<f64>| v.get(axis).copied().unwrap_or(f64::NAN);
        let line = |pick: fn(&Point) -> Vector3<f64>| self.series.iter().map(move |s| [s.0, at(&pick(s))]);
        let bound = self.series.iter().map(|s| [s.0, at(&s.2) - at(&s.3), at(&s.2) + at(&s.3)]);
        Panel::new(title, unit).band("bound", Colour::Blue, bound).line("truth", Colour::Ink, line(|s| s.1)).line(
            "estimate",
            Colour::Blue,
            line(|s| s.2),
        )
    }
}

impl Ground {
    /// A station that speaks to the daemon's ground side.
    pub fn open(daemon: SocketAddr) -> Result<Self, Failure> {
        let failed = |e: std::io::Error| Failure::Failed(format!("ground station: {e}"));
        let socket = UdpSocket::bind("127.0.0.1:0").map_err(failed)?;
        socket.connect(daemon).map_err(failed)?;
        socket.set_read_timeout(Some(PATIENCE)).map_err(failed)?;
        Ok(Self {
            socket,
            encoder: Encoder::new(255, 190),
            parser: Parser::new(),
            last_heartbeat: None,
            force: Track::default(),
            torque: Track::default(),
            wind: Track::default(),
            verdict: None,
            estimates: 0,
            broken: 0,
            broken_at: Vec::new(),
            ours: BTreeMap::new(),
            vehicles: 0,
            span_s: None,
        })
    }

    /// Takes in what has arrived, or waits a moment for it.
    pub fn listen(&mut self, flight: &Flight) -> Result<(), Failure> {
        if self.last_heartbeat.is_none_or(|t| t.elapsed() >= HEARTBEAT_EVERY) {
            self.last_heartbeat = Some(Instant::now());
            let heartbeat = self.encoder.encode(&HEARTBEAT_DATA {
                mavtype: MavType::MAV_TYPE_GCS,
                autopilot: MavAutopilot::MAV_AUTOPILOT_INVALID,
                system_status: MavState::MAV_STATE_ACTIVE,
                mavlink_version: 3,
                ..Default::default()
            });
            // the daemon may not listen yet: the next heartbeat reaches it
            let _ = self.socket.send(heartbeat.bytes());
        }
        let mut datagram = [0; 2048];
        match self.socket.recv(&mut datagram) {
            Ok(len) => self.parser.push(datagram.get(..len).unwrap_or_default()),
            Err(e)
                if matches!(e.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut | ErrorKind::ConnectionRefused) => {}
            Err(e) => return Err(Failure::Failed(format!("ground station: {e}"))),
        }
        let mut parser = std::mem::take(&mut self.parser);
        while let Some(event) = parser.next() {
            if let Event::Frame(frame) = event {
                self.frame(frame, flight);
            }
        }
        self.parser = parser;
        Ok(())
    }

    fn frame(&mut self, frame: FrameRef<'_>, flight: &Flight) {
        if frame.component_id() != COMPONENT {
            self.vehicles += 1;
            return;
        }
        *self.ours.entry(message_info(frame.message_id()).map_or("unknown", |i| i.name)).or_default() += 1;
        if let Some(m) = decode::<WRENCH_ESTIMATE_DATA>(frame) {
            self.verdict = Some(m.verdict);
            let t_s = m.time_boot_us as f64 * 1e-6;
            let (force, torque) = (vector(m.force_ned), vector(m.torque_frd));
            let (force_width, torque_width) = (vector(m.force_half_width), vector(m.torque_half_width));
            self.force.last = Some((force, force_width));
            self.torque.last = Some((torque, torque_width));
            if let Some(truth) = flight.truth(Stamp::from_secs(t_s)) {
                let (first, _) = self.span_s.unwrap_or((t_s, t_s));
                self.span_s = Some((first, t_s));
                let sound = self.judge(t_s, m.verdict);
                self.force.add(sound, (t_s, truth.residual_force_ned_n, force, force_width));
                self.torque.add(sound, (t_s, truth.residual_torque_frd_nm, torque, torque_width));
            }
        } else if let Some(m) = decode::<WIND_ESTIMATE_DATA>(frame) {
            let t_s = m.time_boot_us as f64 * 1e-6;
            let (wind, width) = (vector(m.wind_ned), vector(m.half_width));
            self.wind.last = Some((wind, width));
            if let Some(truth) = flight.truth(Stamp::from_secs(t_s)) {
                let sound = m.verdict != MavobserverVerdict::MAVOBSERVER_VERDICT_ASSUMPTION_VIOLATED;
                self.wind.add(sound, (t_s, truth.wind_ned_mps, wind, width));
            }
        }
    }

    /// Notes what the observer thinks of its own assumptions; true when it calls them sound.
    fn judge(&mut self, t_s: f64, verdict: MavobserverVerdict) -> bool {
        let broken = verdict == MavobserverVerdict::MAVOBSERVER_VERDICT_ASSUMPTION_VIOLATED;
        self.estimates += 1;
        self.broken += u64::from(broken);
        if broken {
            match self.broken_at.last_mut() {
                Some(span) if t_s - span[1] < JOINED_S => span[1] = t_s + SHOWN_S,
                _ => self.broken_at.push([t_s, t_s + SHOWN_S]),
            }
        }
        !broken
    }

    /// Share of the wrench estimates that said that their assumptions are broken.
    pub fn violated(&self) -> f64 {
        self.broken as f64 / self.estimates.max(1) as f64
    }

    /// The run as a picture, without its title.
    pub fn figure(&self) -> Figure {
        let panels = [
            self.wind.panel(0, "Wind towards north", "m/s"),
            self.wind.panel(1, "Wind towards east", "m/s"),
            self.force.panel(0, "Force north", "N"),
            self.force.panel(1, "Force east", "N"),
            self.torque.panel(0, "Torque about the roll axis", "N m"),
            Panel::new("Assumptions broken, as the observer says", "").lane(
                "",
                Colour::Red,
                self.broken_at.iter().copied(),
            ),
        ];
        Figure::new("").x("time since boot", "s").panels(panels)
    }
}

fn vector(v: [f32; 3]) -> Vector3<f64> {
    Vector3::from(v).cast()
}
