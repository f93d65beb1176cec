use super::level::{chance, quantile};
use super::monitor::Monitor;
use crate::signal::{FixType, GnssFix, Guarantee, Measurement, Residual, Stamp};
use nalgebra::Vector2;

/// Positions may drift from the sum of their velocities by this, m, beside what chance makes of what they usually do:
/// under it lie the atmosphere and a velocity that is a little off. Velocities may differ from the vehicle's, m/s.
const POSITION_M: f64 = 1.2;
const VELOCITY_MPS: f64 = 2.5;
/// A receiver that owns to a greater error may drift by that, up to this, m; one that says nothing by this.
const ACCURACY_M: f64 = 10.0;
const UNKNOWN_M: f64 = 3.0;
/// Older disagreement is forgotten at this pace, s; once told, it is kept for as long as a receiver may take to recover.
const MEMORY_S: f64 = 8.0;
const KEPT_S: f64 = 40.0;
/// The usual drift is learnt over this time, s, each counted as at most three standard deviations; where that begins, m.
const LEARN_S: f64 = 120.0;
const USUAL_M: f64 = 0.15;
/// A receiver that is silent this long has lost its fix, s.
const SILENCE_S: f64 = 2.0;

/// GNSS against itself and against the vehicle's own velocity.
#[derive(Debug, Clone)]
pub(super) struct Fixes {
    last: Option<(Stamp, GnssFix)>,
    /// Position less the sum of velocities, leaking.
    drift_m: Vector2<f64>,
    /// Mean square of one axis of it.
    variance_m2: f64,
    /// Standard deviations that chance may reach.
    reach: f64,
    /// The receiver's own word of its error, m.
    accuracy_m: f64,
    kept_s: f64,
    velocity_mps: Vector2<f64>,
    had_fix: bool,
    position: Monitor,
    velocity: Monitor,
    lost: Monitor,
}

impl Fixes {
    pub fn new(per_hour: f64) -> Self {
        Self {
            last: None,
            drift_m: Vector2::zeros(),
            variance_m2: USUAL_M * USUAL_M,
            accuracy_m: UNKNOWN_M,
            reach: quantile(chance(per_hour, MEMORY_S), 2),
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
        self.accuracy_m = fix.horizontal_accuracy_m.unwrap_or(UNKNOWN_M);
        let moved = (Vector2::from(v) + Vector2::from(u)) * (0.5 * dt_s);
        self.drift_m += (p - q).xy() - moved;
        self.kept_s = if self.position.active() { self.kept_s + dt_s } else { 0.0 };
        if !self.position.active() || self.kept_s > KEPT_S {
            self.drift_m *= (-dt_s / MEMORY_S).exp();
        }
        let ratio = self.drift_m.norm() / self.position_m();
        if ratio < 1.0 && !self.position.active() {
            let square = (0.5 * self.drift_m.norm_squared()).min(9.0 * self.variance_m2);
            self.variance_m2 += (square - self.variance_m2) * (dt_s / LEARN_S).min(1.0);
        }
        self.position.see(ratio, m.stamp, dt_s);
        if let Some(own) = m.velocity_ned_mps {
            self.velocity_mps += (Vector2::from(v) - own.value.xy() - self.velocity_mps) * (dt_s / 0.5).min(1.0);
            self.velocity.see(self.velocity_mps.norm() / VELOCITY_MPS, m.stamp, dt_s);
        }
    }

    fn position_m(&self) -> f64 {
        self.accuracy_m.clamp(POSITION_M, ACCURACY_M) + self.reach * self.variance_m2.sqrt()
    }

    /// Position, lost fix, velocity.
    pub fn told(&self) -> [(&Monitor, Residual); 3] {
        let residual =
            |name, value, admissible| Residual { name, value, admissible, guarantee: Guarantee::Statistical(0.999) };
        [
            (&self.position, residual("gnss_position", self.drift_m.norm(), self.position_m())),
            (&self.lost, residual("gnss_fix", f64::from(u8::from(self.lost.active())), 0.5)),
            (&self.velocity, residual("gnss_velocity", self.velocity_mps.norm(), VELOCITY_MPS)),
        ]
    }
}
