use super::averaged::{Averaged, Comparison};
use super::monitor::Monitor;
use crate::signal::{Guarantee, Measurement, Residual};
use nalgebra::Vector3;

/// By so much the field may change from what it was, in size and direction, gauss: iron on the ground, the currents of
/// the motors, and the error of the attitude by which it is turned.
const LAWFUL_GAUSS: f64 = 0.07;
/// The field is smoothed over this time, s.
const SPAN_S: f64 = 0.4;
/// A healthy sensor that changed with every sample doesn't repeat itself so often...
const STUCK: u32 = 100;
/// ...once it has changed so often.
const LIVELY: u32 = 200;

/// The Earth's field, by the vehicle's attitude, against what it was; and a sensor that repeats itself.
#[derive(Debug, Clone)]
pub(super) struct Field {
    world: Averaged,
    last: Option<Vector3<f64>>,
    equal: u32,
    changes: u32,
    since_s: f64,
    stuck: Monitor,
}

impl Field {
    pub fn new(per_hour: f64) -> Self {
        let with = Comparison {
            name: "mag_field",
            span_s: SPAN_S,
            still: LAWFUL_GAUSS,
            // whatever the field is where the flight begins
            constant: f64::INFINITY,
            sigma: 0.005,
            per_hour,
            tell_s: 0.2,
            clear_s: 1.0,
        };
        Self {
            world: Averaged::new(with),
            last: None,
            equal: 0,
            changes: 0,
            since_s: 0.0,
            stuck: Monitor::new(0.8, 1.0),
        }
    }

    /// Takes in one measurement. The direction is judged only while the attitude is to be trusted.
    pub fn step(&mut self, m: &Measurement, upright: bool) {
        self.since_s += m.dt_s;
        let Some(field) = m.magnetometer.and_then(|b| b.fresh()).map(|b| b.field_frd_gauss) else { return };
        let Some(attitude) = m.attitude else { return };
        let dt_s = std::mem::take(&mut self.since_s);
        if self.last.replace(field) == Some(field) {
            self.equal += 1;
        } else {
            self.equal = 0;
            self.changes = self.changes.saturating_add(1);
        }
        if upright {
            self.world.see(attitude.value * field, m.stamp, dt_s.min(1.0));
        }
        // a sensor of a few steps' resolution repeats itself; one that used to change with every sample does not
        self.stuck.see(self.repeats().ratio(), m.stamp, dt_s);
    }

    fn repeats(&self) -> Residual {
        let value = if self.changes > LIVELY { f64::from(self.equal) } else { 0.0 };
        Residual { name: "mag_stuck", value, admissible: f64::from(STUCK), guarantee: Guarantee::Statistical(0.999) }
    }

    /// The field, and whether the sensor is stuck.
    pub fn told(&self) -> [(&Monitor, Residual); 2] {
        [(&self.world.monitor, self.world.residual()), (&self.stuck, self.repeats())]
    }
}
