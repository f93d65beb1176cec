use super::Place;
use super::lane::{Innovations, Lane};
use crate::signal::Stamp;
use crate::sim::control::Navigation;
use crate::sim::sensors::Readings;
use nalgebra::Vector3;

/// A lane is left when its innovations are this large and this many times those of the other.
const BAD: f64 = 0.3;
const WORSE: f64 = 2.0;

/// Two filters side by side, one on each inertial sensor; the healthier one flies.
#[derive(Debug, Clone)]
pub struct Estimator {
    lanes: [Lane; 2],
    active: usize,
    loop_s: f64,
    switches: u8,
}

impl Estimator {
    pub fn new(place: Place, loop_s: f64) -> Self {
        Self { lanes: [Lane::aligned(place), Lane::aligned(place)], active: 0, loop_s, switches: 0 }
    }

    /// One loop; `on_ground` while the motors stand.
    pub fn update(&mut self, readings: &Readings, on_ground: bool, now: Stamp) -> Navigation {
        for (lane, imu) in self.lanes.iter_mut().zip(&readings.imu) {
            lane.predict(imu, self.loop_s);
            if let Some(fix) = &readings.gnss {
                lane.use_fix(fix, now, self.loop_s);
            }
            if let Some(p) = readings.pressure_pa {
                lane.use_pressure(p, on_ground, now);
            }
            if let Some(m) = readings.mag_frd_gauss {
                lane.use_mag(m, now);
            }
        }
        let [first, second] = &self.lanes;
        let (mine, other) = if self.active == 0 { (first, second) } else { (second, first) };
        let (mine, other) = (mine.innovations().worst(), other.innovations().worst());
        if mine > BAD && mine > WORSE * other {
            self.active = 1 - self.active;
            self.switches = self.switches.wrapping_add(1);
        }
        self.lane().navigation()
    }

    fn lane(&self) -> &Lane {
        let [first, second] = &self.lanes;
        if self.active == 0 { first } else { second }
    }

    pub fn innovations(&self) -> Innovations {
        self.lane().innovations()
    }

    /// Which inertial sensor flies: 0 or 1.
    pub fn active_lane(&self) -> usize {
        self.active
    }

    /// Counts jumps of the estimate: changes of lane and resets to a fix.
    pub fn reset_count(&self) -> u8 {
        self.lane().resets().wrapping_add(self.switches)
    }

    /// Estimated biases (rad/s, m/s²) of the active lane.
    pub fn biases(&self) -> (Vector3<f64>, Vector3<f64>) {
        (self.lane().gyro_bias(), self.lane().accel_bias())
    }
}
