use super::monitor::Monitor;
use crate::signal::{Guarantee, Measurement, Residual};
use crate::vehicle::{GRAVITY_MPS2, Vehicle};

/// Share of the model's mass that may be missing; more than that is the ground's doing.
const MOST_DROPPED: f64 = 0.3;
/// Smoothing of force and acceleration, s.
const SMOOTH_S: f64 = 0.3;
/// How restless the air is, is learnt at this pace from what departs from the mean of this time, s; and counts so often.
const LEARN_S: f64 = 40.0;
const MEAN_S: f64 = 5.0;
const GUSTS: f64 = 2.0;

/// The mass that vertical force and acceleration show, `M·a = f + drag`, against the model's.
#[derive(Debug, Clone)]
pub(super) struct Weight {
    vehicle: Vehicle,
    force_n: f64,
    acceleration_mps2: f64,
    seen_s: f64,
    mean_kg: f64,
    /// Square of the usual departure from that mean, kg².
    restless_kg2: f64,
    admissible_kg: f64,
    monitor: Monitor,
}

impl Weight {
    pub fn new(vehicle: &Vehicle) -> Self {
        Self {
            vehicle: vehicle.clone(),
            force_n: 0.0,
            acceleration_mps2: 0.0,
            seen_s: 0.0,
            mean_kg: 0.0,
            restless_kg2: 0.0,
            admissible_kg: f64::INFINITY,
            monitor: Monitor::new(0.4, 0.3),
        }
    }

    pub fn step(&mut self, m: &Measurement) {
        let (Some(q), Some(v), Some(a)) = (m.attitude, m.velocity_ned_mps, m.actuation) else { return };
        let density = m.air_density_kgm3.map(|d| d.value).or(self.vehicle.thrust.density_ref_kgm3).unwrap_or(1.225);
        let drag = |v: f64| self.vehicle.drag.force(2, v, a.value.sum_sqrt_thrust, density);
        let force = (q.value * a.value.force_frd_n).z + drag(v.value.z);
        let acceleration = (q.value * m.imu.accel_frd_mps2).z;
        if self.seen_s == 0.0 {
            (self.force_n, self.acceleration_mps2) = (force, acceleration);
        }
        self.seen_s += m.dt_s;
        let share = 1.0 - (-m.dt_s / SMOOTH_S).exp();
        self.force_n += (force - self.force_n) * share;
        self.acceleration_mps2 += (acceleration - self.acceleration_mps2) * share;
        // what thrust law, vertical wind and accelerometer leave open
        let mass = &self.vehicle.mass_kg;
        let air = drag(self.vehicle.envelope.vertical_wind_mps).abs() / GRAVITY_MPS2;
        let thrust = &self.vehicle.thrust.max_n;
        let law = thrust.range.radius() / thrust.nominal + a.value.doubt;
        let bias = self.vehicle.noise.accel_bias_mps2[2] / GRAVITY_MPS2;
        let still = air + mass.nominal * (law + bias + 0.02) + mass.range.radius();
        let value = self.residual().value;
        let departure = (value - self.mean_kg).clamp(-still, still);
        self.mean_kg += (value - self.mean_kg) * (m.dt_s / MEAN_S).min(1.0);
        self.restless_kg2 += (departure * departure - self.restless_kg2) * (m.dt_s / LEARN_S).min(1.0);
        self.admissible_kg = still + GUSTS * self.restless_kg2.sqrt();
        if self.seen_s > 4.0 * SMOOTH_S {
            let residual = self.residual();
            // nobody drops this much: something else carries the vehicle
            let carried = residual.value < -MOST_DROPPED * mass.nominal;
            self.monitor.see(if carried { 0.0 } else { residual.ratio() }, m.stamp, m.dt_s);
        }
    }

    pub fn restart(&mut self) {
        (self.seen_s, self.mean_kg) = (0.0, 0.0);
        self.monitor.forget();
    }

    fn residual(&self) -> Residual {
        let value = self.force_n / self.acceleration_mps2.min(-1.0) - self.vehicle.mass_kg.nominal;
        let guarantee = Guarantee::Statistical(0.999);
        Residual { name: "payload_kg", value, admissible: self.admissible_kg, guarantee }
    }

    pub fn told(&self) -> (&Monitor, Residual) {
        (&self.monitor, self.residual())
    }
}
