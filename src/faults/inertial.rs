use super::averaged::{Averaged, Comparison};
use super::monitor::Monitor;
use crate::signal::{Imu, Measurement, Residual, Stamp};
use crate::vehicle::Vehicle;
use nalgebra::Vector3;

/// Instants of the first sensor that are kept: 0.3 s at 200 Hz.
const KEPT: usize = 64;
/// Differences are smoothed over this time, s: of accelerometers, of gyroscopes.
const ACCEL_SPAN_S: f64 = 1.0;
const GYRO_SPAN_S: f64 = 1.5;
/// Size of the difference of two healthy gyroscopes that a calibration leaves and warmth changes, rad/s.
const GYRO_RADS: f64 = 0.01;
/// Likewise of two accelerometers beside their declared biases: what they feel differently where they sit, m/s².
const ACCEL_MPS2: f64 = 0.1;

/// Two inertial sensors of one body against each other. It tells that one of them is wrong, not which: the fault names
/// the kind of sensor.
#[derive(Debug, Clone)]
pub(super) struct Pair {
    kept: [Option<(Stamp, Imu)>; KEPT],
    next: usize,
    gyro: Averaged,
    accel: Averaged,
    delay_s: f64,
    last: Option<Stamp>,
}

impl Pair {
    pub fn new(vehicle: &Vehicle, per_hour: f64) -> Self {
        let noise = &vehicle.noise;
        // of bounds of three standard deviations, two sensors, and some ten samples to smooth over
        let sigma = |bound: [f64; 3]| Vector3::from(bound).max() * 2.0_f64.sqrt() / 3.0 / 10.0_f64.sqrt();
        let bias = Vector3::from(noise.accel_bias_mps2).norm();
        let with = |name, span_s, still, sigma| Comparison {
            name,
            span_s,
            still,
            constant: 2.0 * still,
            sigma,
            per_hour,
            tell_s: 0.2,
            clear_s: 1.0,
        };
        Self {
            kept: [None; KEPT],
            next: 0,
            gyro: Averaged::new(with("gyro_pair", GYRO_SPAN_S, GYRO_RADS, sigma(noise.gyro_rads))),
            accel: Averaged::new(with("accel_pair", ACCEL_SPAN_S, ACCEL_MPS2 + 2.0 * bias, sigma(noise.accel_mps2))),
            delay_s: vehicle.sensors.gyro_delay_s,
            last: None,
        }
    }

    pub fn step(&mut self, m: &Measurement) {
        self.kept[self.next] = Some((m.stamp, m.imu));
        self.next = (self.next + 1) % KEPT;
        for other in m.other_imus.iter().flatten().filter(|o| o.new).take(1) {
            let at = other.stamp.plus_secs(-self.delay_s);
            let Some(first) = self.at(at) else { continue };
            let dt_s = self.last.map_or(0.0, |last| (at - last).clamp(0.0, 0.5));
            self.last = Some(at);
            self.gyro.see(first.rate_frd_rads - other.value.rate_frd_rads, m.stamp, dt_s);
            self.accel.see(first.accel_frd_mps2 - other.value.accel_frd_mps2, m.stamp, dt_s);
        }
    }

    /// The first sensor at an instant, between its samples.
    fn at(&self, t: Stamp) -> Option<Imu> {
        let all = || self.kept.iter().flatten();
        let before = all().filter(|(s, _)| *s <= t).max_by_key(|(s, _)| *s)?;
        let after = all().filter(|(s, _)| *s >= t).min_by_key(|(s, _)| *s).unwrap_or(before);
        let gap = after.0 - before.0;
        // a sample a little newer than the newest of the first sensor still has a pair
        if gap > 0.2 || t - before.0 > 0.05 {
            return None;
        }
        let share = if gap > 0.0 { (t - before.0) / gap } else { 0.0 };
        Some(Imu {
            accel_frd_mps2: before.1.accel_frd_mps2.lerp(&after.1.accel_frd_mps2, share),
            rate_frd_rads: before.1.rate_frd_rads.lerp(&after.1.rate_frd_rads, share),
        })
    }

    /// Gyro and accelerometer, each with its residual.
    pub fn told(&self) -> [(&Monitor, Residual); 2] {
        [(&self.gyro.monitor, self.gyro.residual()), (&self.accel.monitor, self.accel.residual())]
    }
}
