use crate::signal::Measurement;
use crate::vehicle::{GRAVITY_MPS2, Vehicle};
use nalgebra::{Matrix3, Vector3};

/// Time over which differences are gathered, s: a constant error b of the accelerometer shows as b times this.
const WINDOW_S: f64 = 3.0;
/// Share of the newest difference between two accelerometers in their mean difference.
const NEWEST: f64 = 0.05;
/// A guarantee comes back after this time without contradiction, s.
const REGAIN_S: f64 = 30.0;

/// The inertial part of one measurement.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Inertial {
    pub rotation: Matrix3<f64>,
    pub velocity_ned_mps: Vector3<f64>,
    pub accel_frd_mps2: Vector3<f64>,
}

/// Whether accelerometer, attitude and velocity tell one story, within what is declared of each.
///
/// The wrench's own outputs cannot tell an accelerometer that is off from a force: both move the residual. But
/// `R·a + g` must integrate to the velocity, whatever force acts. The gathered difference
/// `s⁺ = e^{−Δ/T}·s + (R·a + g)Δ − δv` is bounded by the declared errors of all three; beyond that one of them is broken,
/// and no bound that rests on them is guaranteed until they have agreed for a while.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct Trust {
    gathered_mps: Vector3<f64>,
    /// What the declared errors can have gathered, m/s; without velocity's.
    allowed_mps: Vector3<f64>,
    /// Mean difference to each further accelerometer, body FRD, m/s².
    apart_mps2: [Vector3<f64>; 2],
    waiting_s: f64,
}

impl Trust {
    /// Takes in samples of the vehicle's further accelerometers. They feel the same, so a lasting difference beyond both
    /// declared errors means that one is broken, and nobody knows which. Gives the largest over what is admissible.
    pub fn compare(&mut self, vehicle: &Vehicle, m: &Measurement) -> f64 {
        let noise = &vehicle.noise;
        let mut worst: f64 = 0.0;
        for (apart, other) in self.apart_mps2.iter_mut().zip(&m.other_imus) {
            let Some(other) = other.filter(|o| o.new) else { continue };
            *apart += NEWEST * (m.imu.accel_frd_mps2 - other.value.accel_frd_mps2 - *apart);
            for i in 0..3 {
                let rate = vehicle.envelope.force_rate_nps[i] / vehicle.mass_kg.range.lo();
                let allowed = 2.0 * (noise.accel_mps2[i] + noise.accel_bias_mps2[i]) + rate * other.age_s.abs();
                worst = worst.max(apart[i].abs() / allowed);
            }
        }
        if worst > 1.0 {
            self.waiting_s = REGAIN_S;
        }
        worst
    }

    /// Takes in the step between two measurements; gives the largest difference over what is admissible.
    pub fn step(&mut self, vehicle: &Vehicle, before: &Inertial, now: &Inertial, dt_s: f64) -> f64 {
        let noise = &vehicle.noise;
        let keep = (-dt_s / WINDOW_S).exp();
        let felt = (before.rotation * before.accel_frd_mps2 + now.rotation * now.accel_frd_mps2) * 0.5;
        let gained = (felt + Vector3::z() * GRAVITY_MPS2) * dt_s;
        self.gathered_mps = self.gathered_mps * keep + gained - (now.velocity_ned_mps - before.velocity_ned_mps);
        let sensor = Vector3::from_fn(|i, _| noise.accel_mps2[i] + noise.accel_bias_mps2[i]);
        let across = felt.xy().norm();
        // between two samples the force may go another way than straight
        let curved = Vector3::from(vehicle.envelope.force_rate_nps) * (0.5 * dt_s / vehicle.mass_kg.range.lo());
        let turned = Vector3::new(
            noise.tilt_rad * felt.z.abs() + noise.yaw_rad * across,
            noise.tilt_rad * felt.z.abs() + noise.yaw_rad * across,
            noise.tilt_rad * across,
        );
        let allowed = now.rotation.abs() * sensor + curved + turned;
        self.allowed_mps = self.allowed_mps * keep + allowed * dt_s;
        // velocity's errors telescope: the newest, and a mean of the older ones
        let worst = (0..3)
            .map(|i| self.gathered_mps[i].abs() / (self.allowed_mps[i] + 2.0 * noise.velocity_mps[i]))
            .fold(0.0, f64::max);
        self.waiting_s = if worst > 1.0 { REGAIN_S } else { (self.waiting_s - dt_s).max(0.0) };
        worst
    }

    /// May a bound be called guaranteed now?
    pub fn holds(&self) -> bool {
        self.waiting_s == 0.0
    }

    /// After a jump of velocity or attitude what was gathered means nothing; what was found before still counts.
    pub fn restart(&mut self) {
        (self.gathered_mps, self.allowed_mps) = (Vector3::zeros(), Vector3::zeros());
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::signal::{Held, Imu, Stamp};
    use crate::vehicle::resolve;

    fn hover(bias: f64) -> Inertial {
        Inertial {
            rotation: Matrix3::identity(),
            velocity_ned_mps: Vector3::zeros(),
            accel_frd_mps2: Vector3::new(bias, 0.0, -GRAVITY_MPS2),
        }
    }

    #[test]
    fn two_accelerometers_that_disagree_are_not_believed() {
        let vehicle = resolve("arducopter-sitl").unwrap();
        let imu =
            |bias: f64| Imu { accel_frd_mps2: Vector3::new(bias, 0.0, -GRAVITY_MPS2), rate_frd_rads: Vector3::zeros() };
        let mut trust = Trust::default();
        let mut m = Measurement::new(Stamp::default(), imu(0.05));
        let other = |bias: f64, new: bool| {
            Some(Held { value: imu(bias), stamp: Stamp::default(), age_s: 0.0, sequence: 1, new })
        };
        m.other_imus[0] = other(-0.04, true);
        for _ in 0..200 {
            assert!(trust.compare(&vehicle, &m) <= 1.0);
        }
        m.other_imus[0] = other(-0.7, false);
        trust.compare(&vehicle, &m);
        assert!(trust.holds(), "an old sample is no news");
        m.other_imus[0] = other(-0.7, true);
        for _ in 0..20 {
            trust.compare(&vehicle, &m);
        }
        assert!(!trust.holds());
    }

    #[test]
    fn a_bias_beyond_the_declared_is_noticed_and_forgiven_after_a_while() {
        let vehicle = resolve("arducopter-sitl").unwrap();
        let mut trust = Trust::default();
        let declared = vehicle.noise.accel_mps2[0] + vehicle.noise.accel_bias_mps2[0];
        for _ in 0..1000 {
            assert!(trust.step(&vehicle, &hover(declared), &hover(declared), 0.02) <= 1.0);
        }
        let noticed = (0..200).position(|_| trust.step(&vehicle, &hover(0.8), &hover(0.8), 0.02) > 1.0).unwrap();
        assert!(noticed < 60, "{noticed} steps of 20 ms");
        assert!(!trust.holds());
        let regained = (0..2000).position(|_| {
            trust.step(&vehicle, &hover(0.0), &hover(0.0), 0.02);
            trust.holds()
        });
        assert!(regained.is_some_and(|k| k > 1500));
    }
}
