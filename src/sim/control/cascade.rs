use super::{Mixer, MixerError, Navigation};
use crate::signal::MAX_ROTORS;
use crate::vehicle::{GRAVITY_MPS2, ThrustCurve, Vehicle};
use nalgebra::{Matrix3, Rotation3, UnitQuaternion, Vector3};

/// Where to be, how fast, with which acceleration, and which way to look.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Reference {
    pub position_ned_m: Vector3<f64>,
    pub velocity_ned_mps: Vector3<f64>,
    pub acceleration_ned_mps2: Vector3<f64>,
    pub yaw_rad: f64,
}

/// What the autopilot allows itself.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Limits {
    pub tilt_rad: f64,
    /// Correction of the position loop, m/s.
    pub catch_up_mps: f64,
    pub yaw_rate_rads: f64,
}

impl Default for Limits {
    fn default() -> Self {
        Self { tilt_rad: 0.6, catch_up_mps: 3.0, yaw_rate_rads: 1.5 }
    }
}

/// Position, velocity, attitude and rate loops, one inside the other, on a model of the vehicle.
///
/// The rate loop is as fast as the rotors' lag and the gyro's delay allow, and every outer loop is a fixed factor
/// slower than the one inside it.
#[derive(Debug, Clone)]
pub struct Controller {
    mixer: Mixer,
    curve: ThrustCurve,
    mass_kg: f64,
    inertia: Matrix3<f64>,
    limits: Limits,
    position_gain: f64,
    velocity_gain: f64,
    attitude_gain: f64,
    rate_gain: f64,
    /// Learnt acceleration (NED) and angular acceleration (FRD): wind, trim, model error.
    steady_acceleration: Vector3<f64>,
    steady_spin: Vector3<f64>,
    lift_n: f64,
}

impl Controller {
    /// Loops for this vehicle, updated every `period_s`.
    pub fn new(vehicle: &Vehicle, limits: Limits, period_s: f64) -> Result<Self, MixerError> {
        let d = &vehicle.dynamics;
        let lag = d.time_constant_s + d.delay_s + vehicle.sensors.gyro_delay_s + period_s;
        // first-order lag in a loop of gain k: damping 1/(2√(k·lag)), .8 at k = .4/lag
        let rate_gain = (0.4 / lag).min(20.0);
        let attitude_gain = rate_gain / 3.0;
        let velocity_gain = attitude_gain / 3.0;
        Ok(Self {
            mixer: Mixer::new(vehicle)?,
            curve: vehicle.thrust,
            mass_kg: vehicle.mass_kg.nominal,
            inertia: vehicle.inertia_kgm2,
            limits,
            position_gain: velocity_gain / 2.5,
            velocity_gain,
            attitude_gain,
            rate_gain,
            steady_acceleration: Vector3::zeros(),
            steady_spin: Vector3::zeros(),
            lift_n: 0.0,
        })
    }

    /// Forgets what was learnt; for take-off.
    pub fn reset(&mut self) {
        self.steady_acceleration = Vector3::zeros();
        self.steady_spin = Vector3::zeros();
        self.lift_n = 0.0;
    }

    /// Lift asked for last, as a share of the weight.
    pub fn lift_share(&self) -> f64 {
        self.lift_n / (self.mass_kg * GRAVITY_MPS2)
    }

    /// One command per rotor. `voltage_v` and `density_kgm3` are what the autopilot measures; `learn` is off while
    /// the ground carries the vehicle.
    pub fn update(
        &mut self,
        now: &Navigation,
        wish: &Reference,
        voltage_v: f64,
        density_kgm3: f64,
        learn: bool,
        dt: f64,
    ) -> [f64; MAX_ROTORS] {
        let thrust_ned = self.thrust(now, wish, learn, dt);
        let up = now.body_to_ned * -Vector3::z();
        self.lift_n = thrust_ned.dot(&up).clamp(0.05 * self.mass_kg * GRAVITY_MPS2, f64::MAX);
        let torque = self.torque(now, &thrust_ned, wish.yaw_rad, learn, dt);
        let mut out = self.mixer.thrusts(self.lift_n, torque);
        for thrust in out.iter_mut().take(self.mixer.count()) {
            *thrust = self.command(*thrust, voltage_v, density_kgm3);
        }
        out
    }

    /// Thrust vector, NED, N.
    fn thrust(&mut self, now: &Navigation, wish: &Reference, learn: bool, dt: f64) -> Vector3<f64> {
        let correction = (wish.position_ned_m - now.position_ned_m) * self.position_gain;
        let speed_wish = wish.velocity_ned_mps + correction.cap_magnitude(self.limits.catch_up_mps);
        let speed_error = speed_wish - now.velocity_ned_mps;
        let asked = wish.acceleration_ned_mps2 + speed_error * self.velocity_gain + self.steady_acceleration;

        // at least a fifth of the weight upwards keeps the direction of thrust defined
        let up = (GRAVITY_MPS2 - asked.z).clamp(0.2 * GRAVITY_MPS2, 2.5 * GRAVITY_MPS2);
        let sideways = Vector3::new(asked.x, asked.y, 0.0);
        let allowed = sideways.cap_magnitude(up * self.limits.tilt_rad.tan());
        if learn {
            let saturated = (sideways - allowed).norm() > 0.0;
            let learning = speed_error * (0.25 * self.velocity_gain * self.velocity_gain * dt);
            if !saturated || learning.dot(&self.steady_acceleration) < 0.0 {
                self.steady_acceleration = (self.steady_acceleration + learning).cap_magnitude(8.0);
            }
        }
        (allowed - Vector3::z() * up) * self.mass_kg
    }

    /// Torque, FRD, N m, that turns the thrust axis to `thrust_ned` and the nose to `yaw_rad`.
    fn torque(
        &mut self,
        now: &Navigation,
        thrust_ned: &Vector3<f64>,
        yaw_rad: f64,
        learn: bool,
        dt: f64,
    ) -> Vector3<f64> {
        let error = now.body_to_ned.inverse() * facing(thrust_ned, yaw_rad);
        let angle = error.scaled_axis();
        let mut rate_wish = angle * self.attitude_gain;
        // yaw torque is weak: it must not cost roll and pitch their room
        rate_wish.z = (0.5 * rate_wish.z).clamp(-self.limits.yaw_rate_rads, self.limits.yaw_rate_rads);
        let rate_error = rate_wish - now.rate_frd_rads;
        if learn {
            let learning = rate_error * (0.15 * self.rate_gain * self.rate_gain * dt);
            self.steady_spin = (self.steady_spin + learning).cap_magnitude(50.0);
        }
        let spin = rate_error * self.rate_gain + self.steady_spin;
        let w = now.rate_frd_rads;
        self.inertia * spin + w.cross(&(self.inertia * w))
    }

    /// The command that gives a thrust: the thrust curve turned round, without inflow.
    fn command(&self, thrust_n: f64, voltage_v: f64, density_kgm3: f64) -> f64 {
        let c = &self.curve;
        let voltage = c.voltage_ref_v.map_or(1.0, |v_ref| (voltage_v / v_ref).powi(2)).max(0.1);
        let density = c.density_ref_kgm3.map_or(1.0, |rho| density_kgm3 / rho).max(0.1);
        let shape = (thrust_n / (c.max_n.nominal * voltage * density)).max(0.0);
        let linear = 1.0 - c.expo;
        // positive root of e·c² + (1 − e)·c = shape, in the form that also serves e = 0
        let root = linear + (linear * linear + 4.0 * c.expo * shape).sqrt();
        if root > 0.0 { (2.0 * shape / root).clamp(0.0, 1.0) } else { 0.0 }
    }
}

/// Attitude whose thrust axis (−z) points along a vector and whose nose looks towards `yaw_rad` as far as it can.
fn facing(thrust_ned: &Vector3<f64>, yaw_rad: f64) -> UnitQuaternion<f64> {
    let down = -thrust_ned.normalize();
    let nose = Vector3::new(yaw_rad.cos(), yaw_rad.sin(), 0.0);
    let right = down.cross(&nose);
    if !right.iter().all(|x| x.is_finite()) || right.norm() < 1e-6 {
        return UnitQuaternion::from_euler_angles(0.0, 0.0, yaw_rad);
    }
    let right = right.normalize();
    let forward = right.cross(&down);
    let axes = Matrix3::from_columns(&[forward, right, down]);
    UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(axes))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sim::testing::quad;
    use crate::vehicle::Air;

    #[test]
    fn commands_turn_the_thrust_curve_round() {
        let v = quad();
        let c = Controller::new(&v, Limits::default(), 0.0025).unwrap();
        for (thrust, voltage, density) in [(7.4, 12.6, 1.225), (3.0, 11.4, 1.157), (14.0, 12.3, 1.0)] {
            let air = Air { voltage_v: Some(voltage), density_kgm3: Some(density), climb_mps: 0.0 };
            assert!((v.thrust.thrust_n(c.command(thrust, voltage, density), air) - thrust).abs() < 1e-9);
        }
    }

    #[test]
    fn facing_points_thrust_and_nose() {
        let thrust = Vector3::new(3.0, -2.0, -25.0);
        let q = facing(&thrust, 1.0);
        assert!((q * -Vector3::z() - thrust.normalize()).norm() < 1e-12);
        let nose = q * Vector3::x();
        assert!((q.euler_angles().2 - 1.0).abs() < 0.05 && nose.z.abs() < 0.2);
        assert_eq!(facing(&Vector3::zeros(), 0.0), UnitQuaternion::identity());
    }
}
