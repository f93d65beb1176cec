use super::monitor::Monitor;
use crate::signal::{Guarantee, MAX_ROTORS, Measurement, Residual};
use crate::vehicle::{Air, GRAVITY_MPS2, Vehicle};

/// How long a rotor may take to follow, and its telemetry to come: so many stretches of so many seconds.
const STRETCHES: usize = 9;
const STRETCH_S: f64 = 0.05;
/// Speeds may lie off what the commands of that time make of them by this share.
const SHARE: f64 = 0.12;
/// The speed that belongs to a command is learnt over this time, s, and believed after so long.
const LEARN_S: f64 = 30.0;
const BELIEVED_S: f64 = 3.0;
/// Rotors of which less than this share of hover is asked are not judged: they idle, or the vehicle stands.
const ASKED: f64 = 0.3;
/// Older speeds are not looked at, s.
const OLD_S: f64 = 0.5;

/// Measured speed of each rotor against its command: what it was beside that command before.
///
/// Speed goes with the root of thrust at equal density, so the ratio of the two is a constant of the propeller. The
/// commands of the last [`STRETCHES`] give an interval of speeds; a speed outside it is a rotor that does not do what it
/// is told, whatever its thrust does.
#[derive(Debug, Clone)]
pub(super) struct Speed {
    vehicle: Vehicle,
    /// Root of the least thrust at which speed says something, √N.
    least: f64,
    /// Least and greatest root of thrust asked for in each of the last stretches of time, √N.
    asked: [[[f64; 2]; STRETCHES]; MAX_ROTORS],
    stretch: usize,
    stretch_s: f64,
    /// rev/min over √N.
    ratio: [f64; MAX_ROTORS],
    off: [f64; MAX_ROTORS],
    seen_s: f64,
    monitors: [Monitor; MAX_ROTORS],
}

impl Speed {
    pub fn new(vehicle: &Vehicle) -> Self {
        Self {
            least: (ASKED * vehicle.mass_kg.nominal * GRAVITY_MPS2 / vehicle.rotors.len().max(1) as f64).sqrt(),
            vehicle: vehicle.clone(),
            asked: [[[0.0; 2]; STRETCHES]; MAX_ROTORS],
            stretch: 0,
            stretch_s: 0.0,
            ratio: [0.0; MAX_ROTORS],
            off: [0.0; MAX_ROTORS],
            seen_s: 0.0,
            monitors: [Monitor::new(0.12, 1.0); MAX_ROTORS],
        }
    }

    pub fn step(&mut self, m: &Measurement) {
        let (Some(actuation), Some(rpm)) = (m.actuation, m.rotor_rpm.filter(|r| r.age_s < OLD_S)) else { return };
        let air = Air { voltage_v: m.voltage_v.map(|v| v.value), density_kgm3: None, climb_mps: 0.0 };
        let first = self.seen_s == 0.0;
        self.seen_s += m.dt_s;
        self.stretch_s += m.dt_s;
        let next = self.stretch_s > STRETCH_S;
        if next {
            (self.stretch, self.stretch_s) = ((self.stretch + 1) % STRETCHES, 0.0);
        }
        for i in 0..self.vehicle.rotors.len().min(MAX_ROTORS) {
            let asked = self.vehicle.thrust.thrust_n(actuation.value.rotors.command[i], air).sqrt();
            let stretches = &mut self.asked[i];
            if first {
                *stretches = [[asked; 2]; STRETCHES];
            }
            let now = &mut stretches[self.stretch];
            *now = if next { [asked; 2] } else { [now[0].min(asked), now[1].max(asked)] };
            let low = stretches.iter().map(|s| s[0]).fold(f64::INFINITY, f64::min);
            let high = stretches.iter().map(|s| s[1]).fold(0.0, f64::max);
            let turns = rpm.value[i];
            if !turns.is_finite() || low < self.least {
                self.monitors[i].see(0.0, m.stamp, m.dt_s);
                continue;
            }
            let (least, most) = (self.ratio[i] * low, self.ratio[i] * high);
            let beyond = (turns - most).max(least - turns).max(0.0);
            self.off[i] = if self.seen_s > BELIEVED_S { beyond.copysign(turns - least) / most.max(1.0) } else { 0.0 };
            if self.off[i].abs() < SHARE {
                let share = (m.dt_s / self.seen_s.min(LEARN_S)).min(1.0);
                self.ratio[i] += (turns / asked.max(1e-3) - self.ratio[i]) * share;
            }
            self.monitors[i].see(self.off[i].abs() / SHARE, m.stamp, m.dt_s);
        }
    }

    /// Forgets what was asked lately, and what it saw of it.
    pub fn restart(&mut self) {
        *self = Self::new(&self.vehicle);
    }

    /// A rotor whose speed is not that of its command, with the share of thrust that it lacks.
    pub fn told(&self) -> Option<(usize, &Monitor, Residual)> {
        let i = (0..MAX_ROTORS).filter(|i| self.monitors[*i].active()).max_by(|a, b| {
            let size = |i: &usize| self.off[*i].abs();
            size(a).total_cmp(&size(b))
        })?;
        let residual = self.residual(i);
        Some((i, &self.monitors[i], Residual { value: self.lacking(i), ..residual }))
    }

    /// Share of thrust that the speed of a rotor lacks.
    fn lacking(&self, i: usize) -> f64 {
        1.0 - (1.0 + self.off[i]).powi(2)
    }

    fn residual(&self, i: usize) -> Residual {
        let guarantee = Guarantee::Statistical(0.999);
        Residual { name: "rotor_speed", value: self.off[i], admissible: SHARE, guarantee }
    }

    pub fn residuals(&self, told: &mut dyn FnMut(Residual)) {
        (0..self.vehicle.rotors.len().min(MAX_ROTORS)).for_each(|i| told(self.residual(i)));
    }
}
