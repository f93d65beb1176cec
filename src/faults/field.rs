use super::monitor::Monitor;
use crate::signal::{Guarantee, Measurement, Residual};
use nalgebra::Vector3;

/// The field's length may change by this share before it counts.
const SHARE: f64 = 0.25;
/// The length to compare with is learnt over this many samples.
const LEARN: f64 = 100.0;
/// So many equal samples in a row are none of a working sensor that changed before.
const STUCK: u32 = 100;

/// The length of the magnetic field against what it was, and a sensor that repeats itself.
#[derive(Debug, Clone)]
pub(super) struct Field {
    expected: f64,
    seen: f64,
    length: f64,
    last: Option<Vector3<f64>>,
    equal: u32,
    changes: u32,
    monitor: Monitor,
}

impl Field {
    pub fn new() -> Self {
        Self {
            expected: 0.0,
            seen: 0.0,
            length: 0.0,
            last: None,
            equal: 0,
            changes: 0,
            monitor: Monitor::new(0.8, 1.0),
        }
    }

    pub fn step(&mut self, m: &Measurement) {
        let Some(field) = m.magnetometer.and_then(|b| b.fresh()).map(|b| b.field_frd_gauss) else { return };
        if self.last.replace(field) == Some(field) {
            self.equal += 1;
        } else {
            self.equal = 0;
            self.changes = self.changes.saturating_add(1);
        }
        let norm = field.norm();
        let share = 1.0 / (self.seen + 1.0).min(10.0);
        self.length += (norm - self.length) * share;
        if self.seen < LEARN {
            self.seen += 1.0;
            self.expected += (norm - self.expected) / self.seen;
            return;
        }
        // a sensor of a few steps' resolution repeats itself; one that used to change with every sample does not
        let lively = f64::from(self.changes) > 2.0 * LEARN;
        let stuck = if self.equal > STUCK && lively { 2.0 } else { 0.0 };
        self.monitor.see(self.residual().ratio().max(stuck), m.stamp, m.dt_s);
    }

    fn residual(&self) -> Residual {
        let value = self.length - self.expected;
        let guarantee = Guarantee::Statistical(0.999);
        Residual { name: "mag_length", value, admissible: SHARE * self.expected, guarantee }
    }

    pub fn told(&self) -> (&Monitor, Residual) {
        (&self.monitor, self.residual())
    }
}
