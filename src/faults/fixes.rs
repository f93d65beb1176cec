use super::monitor::Monitor;
use crate::signal::{FixType, GnssFix, Guarantee, Measurement, Residual, Stamp};
use nalgebra::Vector2;

/// Positions may drift from the sum of their velocities by this before it counts, m; velocities from the vehicle's, m/s.
const POSITION_M: f64 = 5.0;
const VELOCITY_MPS: f64 = 2.5;
/// Older disagreement is forgotten at this pace, s; once told, it is kept for as long as a receiver may take to recover.
const MEMORY_S: f64 = 8.0;
const KEPT_S: f64 = 40.0;
/// A receiver that is silent this long has lost its fix, s.
const SILENCE_S: f64 = 2.0;

/// GNSS against itself and against the vehicle's own velocity.
#[derive(Debug, Clone)]
pub(super) struct Fixes {
    last: Option<(Stamp, GnssFix)>,
    /// Position less the sum of velocities, leaking.
    drift_m: Vector2<f64>,
    kept_s: f64,
    velocity_mps: Vector2<f64>,
    had_fix: bool,
    position: Monitor,
    velocity: Monitor,
    lost: Monitor,
}

impl Fixes {
    pub fn new() -> Self {
        Self {
            last: None,
            drift_m: Vector2::zeros(),
            kept_s: 0.0,
            velocity_mps: Vector2::zeros(),
            had_fix: false,
            position: Monitor::new(0.0, 0.3),
            velocity: Monitor::new(0.8, 1.0),
            lost: Monitor::new(0.2, 1.0),
        }
    }

    pub fn step(&mut self, m: &Measurement) {
        let Some(held) = m.gnss else { return };
        let fix = held.value;
        let good = fix.fix_type >= FixType::ThreeD && held.age_s < SILENCE_S;
        self.had_fix |= good;
        if self.had_fix {
            self.lost.see(if good { 0.0 } else { 2.0 }, m.stamp, m.dt_s);
        }
        let (true, true, Some(p), Some(v)) = (held.new, good, fix.position_ned_m, fix.ground_velocity_mps) else {
            return;
        };
        let before = self.last.replace((held.stamp, fix));
        let Some((then, before)) = before else { return };
        let dt_s = held.stamp - then;
        let (Some(q), Some(u)) = (before.position_ned_m, before.ground_velocity_mps) else { return };
        if !(0.01..1.5).contains(&dt_s) {
            self.drift_m = Vector2::zeros();
            return;
        }
        let moved = (Vector2::from(v) + Vector2::from(u)) * (0.5 * dt_s);
        self.drift_m += (p - q).xy() - moved;
        self.kept_s = if self.position.active() { self.kept_s + dt_s } else { 0.0 };
        if !self.position.active() || self.kept_s > KEPT_S {
            self.drift_m *= (-dt_s / MEMORY_S).exp();
        }
        self.position.see(self.drift_m.norm() / POSITION_M, m.stamp, dt_s);
        if let Some(own) = m.velocity_ned_mps {
            self.velocity_mps += (Vector2::from(v) - own.value.xy() - self.velocity_mps) * (dt_s / 0.5).min(1.0);
            self.velocity.see(self.velocity_mps.norm() / VELOCITY_MPS, m.stamp, dt_s);
        }
    }

    /// Position, lost fix, velocity.
    pub fn told(&self) -> [(&Monitor, Residual); 3] {
        let residual =
            |name, value, admissible| Residual { name, value, admissible, guarantee: Guarantee::Statistical(0.999) };
        [
            (&self.position, residual("gnss_position", self.drift_m.norm(), POSITION_M)),
            (&self.lost, residual("gnss_fix", f64::from(u8::from(self.lost.active())), 0.5)),
            (&self.velocity, residual("gnss_velocity", self.velocity_mps.norm(), VELOCITY_MPS)),
        ]
    }
}
