use nalgebra::{Quaternion, UnitQuaternion, Vector3};

/// What is integrated of a vehicle; the rotors' lag is solved beside it. Position and velocity are those of the body's origin (the empty
/// vehicle's centre of mass): they do not jump when a payload is dropped, and the IMU sits there.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct State {
    pub position_ned_m: Vector3<f64>,
    pub velocity_ned_mps: Vector3<f64>,
    /// Body FRD to world NED; unit length between steps.
    pub attitude: Quaternion<f64>,
    pub rate_frd_rads: Vector3<f64>,
    pub voltage_v: f64,
    /// Charge drawn from the battery, A s.
    pub used_as: f64,
}

impl State {
    /// At rest at the local origin, level, nose at `heading_rad` east of north, with a full battery.
    pub fn at_rest(heading_rad: f64, voltage_v: f64) -> Self {
        Self {
            position_ned_m: Vector3::zeros(),
            velocity_ned_mps: Vector3::zeros(),
            attitude: UnitQuaternion::from_euler_angles(0.0, 0.0, heading_rad).into_inner(),
            rate_frd_rads: Vector3::zeros(),
            voltage_v,
            used_as: 0.0,
        }
    }

    pub fn body_to_ned(&self) -> UnitQuaternion<f64> {
        UnitQuaternion::new_unchecked(self.attitude)
    }

    /// This state moved along `d` for `h` seconds.
    pub(super) fn moved(&self, d: &Rates, h: f64) -> Self {
        Self {
            position_ned_m: self.position_ned_m + d.velocity * h,
            velocity_ned_mps: self.velocity_ned_mps + d.acceleration * h,
            attitude: self.attitude + d.attitude * h,
            rate_frd_rads: self.rate_frd_rads + d.angular_acceleration * h,
            voltage_v: self.voltage_v + d.voltage * h,
            used_as: self.used_as + d.used * h,
        }
    }
}

/// Rate of change of a [`State`].
#[derive(Debug, Clone, Copy)]
pub(super) struct Rates {
    pub velocity: Vector3<f64>,
    pub acceleration: Vector3<f64>,
    pub attitude: Quaternion<f64>,
    pub angular_acceleration: Vector3<f64>,
    pub voltage: f64,
    pub used: f64,
}

impl Rates {
    /// Simpson's weighting of the four Runge-Kutta slopes.
    pub fn simpson(a: &Self, b: &Self, c: &Self, d: &Self) -> Self {
        let s = 1.0 / 6.0;
        Self {
            velocity: (a.velocity + (b.velocity + c.velocity) * 2.0 + d.velocity) * s,
            acceleration: (a.acceleration + (b.acceleration + c.acceleration) * 2.0 + d.acceleration) * s,
            attitude: (a.attitude + (b.attitude + c.attitude) * 2.0 + d.attitude) * s,
            angular_acceleration: (a.angular_acceleration
                + (b.angular_acceleration + c.angular_acceleration) * 2.0
                + d.angular_acceleration)
                * s,
            voltage: (a.voltage + 2.0 * (b.voltage + c.voltage) + d.voltage) * s,
            used: (a.used + 2.0 * (b.used + c.used) + d.used) * s,
        }
    }
}
