use super::monitor::Monitor;
use crate::signal::{Guarantee, Imu, Measurement, Residual, Stamp};
use crate::vehicle::Vehicle;
use nalgebra::Vector3;

/// Instants of the first sensor that are kept: 0.6 s at 50 Hz.
const KEPT: usize = 32;
/// Pairs that are averaged, by a leaky mean.
const PAIRS: f64 = 5.0;
/// How far the stamps of two messages may be off, s.
const STAMP_S: f64 = 0.01;

/// Two inertial sensors of one body against each other. It tells that one of them is wrong, not which: the fault names
/// the kind of sensor.
#[derive(Debug, Clone)]
pub(super) struct Pair {
    kept: [Option<(Stamp, Imu)>; KEPT],
    next: usize,
    gyro: Channel,
    accel: Channel,
    delay_s: f64,
    last: Option<Stamp>,
}

#[derive(Debug, Clone)]
struct Channel {
    name: &'static str,
    mean: Vector3<f64>,
    admissible: Vector3<f64>,
    /// Largest wiggle of the last pairs.
    wiggle: Vector3<f64>,
    monitor: Monitor,
}

impl Channel {
    fn new(name: &'static str, admissible: [f64; 3]) -> Self {
        let zero = Vector3::zeros();
        Self { name, mean: zero, admissible: Vector3::from(admissible), wiggle: zero, monitor: Monitor::new(0.6, 1.0) }
    }

    fn see(&mut self, difference: Vector3<f64>, wiggle: Vector3<f64>, stamp: Stamp, dt_s: f64) {
        self.mean += (difference - self.mean) / PAIRS;
        self.wiggle += (wiggle - self.wiggle) / PAIRS;
        self.monitor.see(self.residual().ratio(), stamp, dt_s);
    }

    /// The axis that differs most.
    fn residual(&self) -> Residual {
        let limit = self.admissible + self.wiggle;
        let worst = (0..3).max_by(|a, b| {
            let ratio = |i: &usize| self.mean[*i].abs() / limit[*i];
            ratio(a).total_cmp(&ratio(b))
        });
        let i = worst.unwrap_or(0);
        Residual {
            name: self.name,
            value: self.mean[i],
            admissible: limit[i],
            guarantee: Guarantee::Statistical(0.999),
        }
    }
}

impl Pair {
    pub fn new(vehicle: &Vehicle) -> Self {
        let noise = &vehicle.noise;
        Self {
            kept: [None; KEPT],
            next: 0,
            gyro: Channel::new("gyro_pair", noise.gyro_rads),
            accel: Channel::new(
                "accel_pair",
                std::array::from_fn(|i| 2.0 * (noise.accel_mps2[i] + noise.accel_bias_mps2[i])),
            ),
            delay_s: vehicle.sensors.gyro_delay_s,
            last: None,
        }
    }

    pub fn step(&mut self, m: &Measurement) {
        self.kept[self.next] = Some((m.stamp, m.imu));
        self.next = (self.next + 1) % KEPT;
        for other in m.other_imus.iter().flatten().filter(|o| o.new).take(1) {
            let at = other.stamp.plus_secs(-self.delay_s);
            let Some((first, wiggle)) = self.at(at) else { continue };
            let dt_s = self.last.map_or(0.0, |last| (at - last).clamp(0.0, 0.5));
            self.last = Some(at);
            let (mine, theirs) = (first.rate_frd_rads, other.value.rate_frd_rads);
            self.gyro.see(mine - theirs, wiggle.rate_frd_rads, m.stamp, dt_s);
            let (mine, theirs) = (first.accel_frd_mps2, other.value.accel_frd_mps2);
            self.accel.see(mine - theirs, wiggle.accel_frd_mps2, m.stamp, dt_s);
        }
    }

    /// The first sensor at an instant, between its samples, and how much it may move while the stamps are off.
    fn at(&self, t: Stamp) -> Option<(Imu, Imu)> {
        let all = || self.kept.iter().flatten();
        let before = all().filter(|(s, _)| *s <= t).max_by_key(|(s, _)| *s)?;
        let after = all().filter(|(s, _)| *s >= t).min_by_key(|(s, _)| *s).unwrap_or(before);
        let gap = after.0 - before.0;
        // a sample a little newer than the newest of the first sensor still has a pair
        if gap > 0.2 || t - before.0 > 0.05 {
            return None;
        }
        let share = if gap > 0.0 { (t - before.0) / gap } else { 0.0 };
        let value = Imu {
            accel_frd_mps2: before.1.accel_frd_mps2.lerp(&after.1.accel_frd_mps2, share),
            rate_frd_rads: before.1.rate_frd_rads.lerp(&after.1.rate_frd_rads, share),
        };
        let near = || all().filter(|(s, _)| (*s - t).abs() < 0.05);
        let span = |pick: fn(&Imu) -> &Vector3<f64>| {
            let low = near().fold(Vector3::repeat(f64::INFINITY), |l, (_, x)| l.inf(pick(x)));
            let high = near().fold(Vector3::repeat(f64::NEG_INFINITY), |h, (_, x)| h.sup(pick(x)));
            (high - low).map(|x| if x.is_finite() { x.max(0.0) * (STAMP_S / 0.1 + 0.1) } else { 0.0 })
        };
        let wiggle = Imu { accel_frd_mps2: span(|x| &x.accel_frd_mps2), rate_frd_rads: span(|x| &x.rate_frd_rads) };
        Some((value, wiggle))
    }

    /// Gyro and accelerometer, each with its residual.
    pub fn told(&self) -> [(&Monitor, Residual); 2] {
        [(&self.gyro.monitor, self.gyro.residual()), (&self.accel.monitor, self.accel.residual())]
    }
}
