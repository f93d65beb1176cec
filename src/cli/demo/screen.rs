use super::flight::Flight;
use super::ground::Ground;
use crate::wire::dialect::mavobserver::MavobserverVerdict;
use nalgebra::Vector3;
use std::io::{IsTerminal, Write};
use std::time::{Duration, Instant};

/// Time between two looks on a terminal, and between two lines elsewhere.
const REDRAW: Duration = Duration::from_millis(200);
const LINE: Duration = Duration::from_secs(5);

/// What a person sees while it flies: a table that redraws itself on a terminal, plain lines elsewhere, all on standard
/// error.
pub(super) struct Screen {
    quiet: bool,
    terminal: bool,
    last: Option<Instant>,
    drawn: usize,
}

impl Screen {
    pub fn new(quiet: bool) -> Self {
        Self { quiet, terminal: std::io::stderr().is_terminal(), last: None, drawn: 0 }
    }

    /// A line that stays.
    pub fn say(&self, text: &str) {
        self.write(&format!("{text}\n"));
    }

    pub fn show(&mut self, ground: &Ground, flight: &Flight) {
        let every = if self.terminal { REDRAW } else { LINE };
        if self.quiet || self.last.is_some_and(|t| t.elapsed() < every) {
            return;
        }
        self.last = Some(Instant::now());
        let Some((boot, truth)) = flight.now() else { return };
        let rows = [
            ("wind", "m/s", truth.wind_ned_mps, ground.wind.last),
            ("force", "N", truth.residual_force_ned_n, ground.force.last),
            ("torque", "N m", truth.residual_torque_frd_nm, ground.torque.last),
        ];
        if !self.terminal {
            let (_, unit, truth, estimate) = rows[0];
            self.write(&format!(
                "{:5.1} s  {:12}  wind {} {unit}, truth {}\n",
                boot.secs(),
                verdict(ground.verdict),
                estimate.map_or_else(|| "–".to_owned(), |(v, w)| format!("{} ± {}", three(v), three(w))),
                three(truth)
            ));
            return;
        }
        let mut text = String::new();
        let share = (boot.secs() / flight.duration_s).clamp(0.0, 1.0);
        let done = (share * 40.0) as usize;
        text.push_str(&format!(
            "{}{} {:4.0}/{:.0} s  {}\n",
            "█".repeat(done),
            "░".repeat(40 - done),
            boot.secs(),
            flight.duration_s,
            verdict(ground.verdict)
        ));
        text.push_str(&format!("{:8}{:>24}{:>26}{:>24}\n", "", "truth", "estimate", "bound ±"));
        for (name, unit, truth, estimate) in rows {
            let (value, width) = estimate.map_or(("–".to_owned(), "–".to_owned()), |(v, w)| (three(v), three(w)));
            text.push_str(&format!("{name:8}{:>24}{value:>26}{width:>24}  {unit}\n", three(truth)));
        }
        let ours: u64 = ground.ours.values().sum();
        text.push_str(&format!(
            "{} frames of the vehicle and {ours} estimates at the ground station\n",
            ground.vehicles
        ));
        self.clear();
        self.drawn = text.lines().count();
        self.write(&text);
    }

    /// Takes the table away.
    pub fn clear(&mut self) {
        if self.terminal && self.drawn > 0 {
            // so many lines up, and everything below gone
            self.write(&format!("\x1b[{}A\x1b[J", self.drawn));
            self.drawn = 0;
        }
    }

    fn write(&self, text: &str) {
        if !self.quiet {
            // a standard error that has gone is no reason to stop
            let _ = std::io::stderr().write_all(text.as_bytes());
        }
    }
}

fn three(v: Vector3<f64>) -> String {
    let places = if v.abs().max() < 1.0 { 3 } else { 2 };
    v.iter()
        .map(|x| if x.is_finite() { format!("{x:6.places$}") } else { "     –".to_owned() })
        .collect::<Vec<_>>()
        .join(" ")
}

fn verdict(v: Option<MavobserverVerdict>) -> &'static str {
    use MavobserverVerdict as V;
    match v {
        None => "waiting",
        Some(V::MAVOBSERVER_VERDICT_CONSISTENT) => "consistent",
        Some(V::MAVOBSERVER_VERDICT_SETTLING) => "settling",
        Some(V::MAVOBSERVER_VERDICT_ASSUMPTION_VIOLATED) => "violated",
        Some(V::MAVOBSERVER_VERDICT_STARVED) => "starved",
        Some(V::MAVOBSERVER_VERDICT_GROUNDED) => "on ground",
    }
}
