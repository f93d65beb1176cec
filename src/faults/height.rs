use super::monitor::Monitor;
use crate::signal::{Guarantee, Measurement, Residual};

/// The barometer may drift from the sum of vertical velocities by this before it counts, m.
const HEIGHT_M: f64 = 3.0;
/// Older disagreement is forgotten at this pace, s; once told, it is kept this long.
const MEMORY_S: f64 = 6.0;
const KEPT_S: f64 = 40.0;

/// The barometer's height against the vehicle's vertical velocity, summed.
#[derive(Debug, Clone)]
pub(super) struct Height {
    /// Height by velocity since the last sample, m.
    climbed_m: f64,
    since_s: f64,
    last_m: Option<f64>,
    drift_m: f64,
    kept_s: f64,
    monitor: Monitor,
}

impl Height {
    pub fn new() -> Self {
        Self { climbed_m: 0.0, since_s: 0.0, last_m: None, drift_m: 0.0, kept_s: 0.0, monitor: Monitor::new(0.15, 0.5) }
    }

    pub fn step(&mut self, m: &Measurement) {
        let Some(v) = m.velocity_ned_mps else { return };
        self.climbed_m -= v.value.z * m.dt_s;
        self.since_s += m.dt_s;
        let Some(barometer) = m.barometer.and_then(|b| b.fresh()) else { return };
        let dt_s = std::mem::take(&mut self.since_s);
        let climbed = std::mem::take(&mut self.climbed_m);
        if let Some(last) = self.last_m.replace(barometer.altitude_m).filter(|_| dt_s < 1.5) {
            self.drift_m += barometer.altitude_m - last - climbed;
            self.kept_s = if self.monitor.active() { self.kept_s + dt_s } else { 0.0 };
            if !self.monitor.active() || self.kept_s > KEPT_S {
                self.drift_m *= (-dt_s / MEMORY_S).exp();
            }
            self.monitor.see(self.drift_m.abs() / HEIGHT_M, m.stamp, dt_s);
        }
    }

    /// Forgets the past, where the vehicle's own height says nothing.
    pub fn restart(&mut self) {
        *self = Self::new();
    }

    pub fn told(&self) -> (&Monitor, Residual) {
        let guarantee = Guarantee::Statistical(0.999);
        (&self.monitor, Residual { name: "baro_height", value: self.drift_m, admissible: HEIGHT_M, guarantee })
    }
}
