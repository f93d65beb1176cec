use super::{Place, pressure_altitude_m};
use crate::signal::Stamp;
use crate::sim::control::Navigation;
use crate::sim::sensors::{GnssFix, ImuReading};
use crate::vehicle::GRAVITY_MPS2;
use nalgebra::{UnitQuaternion, Vector3};

/// How much of the past is kept to meet late GNSS fixes, loops.
const HISTORY: usize = 256;
/// A fix further away than this is not believed, m and m/s...
const POSITION_GATE_M: f64 = 8.0;
const VELOCITY_GATE_MPS: f64 = 3.0;
/// ...until it has been so for this long: then the filter jumps to it, s.
const RESET_AFTER_S: f64 = 7.0;

/// Gains, per second of measurement: horizontal position and velocity form a loop of about .5 rad/s with tilt, which
/// shows as acceleration; height runs at about 1 rad/s on pressure.
mod gain {
    pub const POSITION: f64 = 0.8;
    pub const VELOCITY_FROM_POSITION: f64 = 0.15;
    pub const VELOCITY: f64 = 1.2;
    pub const TILT: f64 = 0.04;
    pub const GYRO_BIAS: f64 = 0.004;
    pub const HEIGHT: f64 = 2.0;
    pub const CLIMB: f64 = 1.3;
    pub const ACCEL_BIAS: f64 = 0.1;
    pub const HEADING: f64 = 0.5;
    pub const HEADING_BIAS: f64 = 0.02;
}

/// Low-passed sizes of what measurements disagreed by, each over its gate.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Innovations {
    pub velocity: f64,
    pub position: f64,
    pub height: f64,
    pub heading: f64,
}

impl Innovations {
    pub fn worst(&self) -> f64 {
        self.velocity.max(self.position).max(self.height)
    }
}

/// One filter on one inertial sensor.
#[derive(Debug, Clone)]
pub(super) struct Lane {
    position: Vector3<f64>,
    velocity: Vector3<f64>,
    attitude: UnitQuaternion<f64>,
    gyro_bias: Vector3<f64>,
    accel_bias: Vector3<f64>,
    rate: Vector3<f64>,
    accel: Vector3<f64>,
    declination_rad: f64,
    home_altitude_m: Option<f64>,
    history: Box<[(Vector3<f64>, Vector3<f64>); HISTORY]>,
    newest: usize,
    last_fix: Option<Stamp>,
    refused_for_s: f64,
    last_pressure: Option<Stamp>,
    last_mag: Option<Stamp>,
    innovations: Innovations,
    resets: u8,
}

impl Lane {
    /// Aligned on the ground at the local origin.
    pub fn aligned(place: Place) -> Self {
        Self {
            position: Vector3::zeros(),
            velocity: Vector3::zeros(),
            attitude: UnitQuaternion::from_euler_angles(0.0, 0.0, place.heading_rad),
            gyro_bias: Vector3::zeros(),
            accel_bias: Vector3::zeros(),
            rate: Vector3::zeros(),
            accel: Vector3::zeros(),
            declination_rad: place.declination_rad,
            home_altitude_m: None,
            history: Box::new([(Vector3::zeros(), Vector3::zeros()); HISTORY]),
            newest: 0,
            last_fix: None,
            refused_for_s: 0.0,
            last_pressure: None,
            last_mag: None,
            innovations: Innovations::default(),
            resets: 0,
        }
    }

    pub fn navigation(&self) -> Navigation {
        Navigation {
            position_ned_m: self.position,
            velocity_ned_mps: self.velocity,
            body_to_ned: self.attitude,
            rate_frd_rads: self.rate,
            accel_frd_mps2: self.accel,
        }
    }

    pub fn innovations(&self) -> Innovations {
        self.innovations
    }

    /// Times the filter has jumped to a fix.
    pub fn resets(&self) -> u8 {
        self.resets
    }

    pub fn gyro_bias(&self) -> Vector3<f64> {
        self.gyro_bias
    }

    pub fn accel_bias(&self) -> Vector3<f64> {
        self.accel_bias
    }

    /// Strapdown step.
    pub fn predict(&mut self, imu: &ImuReading, dt: f64) {
        self.rate = imu.rate_frd_rads - self.gyro_bias;
        self.accel = imu.accel_frd_mps2 - self.accel_bias;
        let turned = (imu.raw_rate_frd_rads - self.gyro_bias) * dt;
        self.attitude *= UnitQuaternion::from_scaled_axis(turned);
        self.attitude.renormalize_fast();
        let pushed = imu.raw_accel_frd_mps2 - self.accel_bias;
        let acceleration = self.attitude * pushed + Vector3::z() * GRAVITY_MPS2;
        self.position += (self.velocity + acceleration * (0.5 * dt)) * dt;
        self.velocity += acceleration * dt;
        self.newest = (self.newest + 1) % HISTORY;
        self.history[self.newest] = (self.position, self.velocity);
    }

    pub fn use_fix(&mut self, fix: &GnssFix, now: Stamp, loop_s: f64) {
        let dt = self.last_fix.replace(now).map_or(0.0, |last| (now - last).clamp(0.0, 1.0));
        let late = ((now - fix.stamp) / loop_s).round().clamp(0.0, (HISTORY - 1) as f64) as usize;
        let (position, velocity) = self.history[(self.newest + HISTORY - late) % HISTORY];
        let mut position_error = fix.position_ned_m - position;
        let velocity_error = fix.velocity_ned_mps - velocity;
        // height is the barometer's
        position_error.z = 0.0;
        self.note(|i| &mut i.position, position_error.norm() / POSITION_GATE_M, dt);
        self.note(|i| &mut i.velocity, velocity_error.norm() / VELOCITY_GATE_MPS, dt);

        if position_error.norm() > POSITION_GATE_M || velocity_error.norm() > VELOCITY_GATE_MPS {
            self.refused_for_s += dt;
            if self.refused_for_s > RESET_AFTER_S {
                self.jump(position_error, velocity_error);
            }
            return;
        }
        self.refused_for_s = 0.0;
        self.position += position_error * (gain::POSITION * dt);
        self.velocity += (velocity_error * gain::VELOCITY + position_error * gain::VELOCITY_FROM_POSITION) * dt;
        // believed north acceleration too small means leaning too little forward: a turn about east, and so on
        let lean = Vector3::new(velocity_error.y, -velocity_error.x, 0.0);
        self.turn(lean * (gain::TILT * dt));
        self.gyro_bias -= self.attitude.inverse() * lean * (gain::GYRO_BIAS * dt);
    }

    fn jump(&mut self, position_error: Vector3<f64>, velocity_error: Vector3<f64>) {
        self.position += position_error;
        self.velocity += velocity_error;
        for (p, v) in self.history.iter_mut() {
            *p += position_error;
            *v += velocity_error;
        }
        self.refused_for_s = 0.0;
        self.resets = self.resets.wrapping_add(1);
    }

    pub fn use_pressure(&mut self, pressure_pa: f64, on_ground: bool, now: Stamp) {
        let dt = self.last_pressure.replace(now).map_or(0.0, |last| (now - last).clamp(0.0, 0.2));
        let altitude = pressure_altitude_m(pressure_pa);
        let home = self.home_altitude_m.get_or_insert(altitude);
        if on_ground {
            // zeroed until take-off, as autopilots do
            *home += (altitude + self.position.z - *home) * (0.5 * dt);
        }
        let error = -(altitude - *home) - self.position.z;
        self.note(|i| &mut i.height, error.abs() / 5.0, dt);
        self.position.z += gain::HEIGHT * dt * error;
        self.velocity.z += gain::CLIMB * dt * error;
        let up = self.attitude.inverse() * Vector3::z();
        self.accel_bias -= up * (gain::ACCEL_BIAS * dt * error).clamp(-0.01, 0.01);
    }

    pub fn use_mag(&mut self, field_frd: Vector3<f64>, now: Stamp) {
        let dt = self.last_mag.replace(now).map_or(0.0, |last| (now - last).clamp(0.0, 0.2));
        let field = self.attitude * field_frd;
        let error = crate::sim::control::wrap(self.declination_rad - field.y.atan2(field.x));
        self.note(|i| &mut i.heading, error.abs() / 0.5, dt);
        self.turn(Vector3::z() * (gain::HEADING * dt * error));
        self.gyro_bias -= self.attitude.inverse() * Vector3::z() * (gain::HEADING_BIAS * dt * error);
    }

    /// Turns the belief by a small rotation about NED axes.
    fn turn(&mut self, angle: Vector3<f64>) {
        self.attitude = UnitQuaternion::from_scaled_axis(angle) * self.attitude;
    }

    fn note(&mut self, which: impl Fn(&mut Innovations) -> &mut f64, size: f64, dt: f64) {
        let mean = which(&mut self.innovations);
        *mean += (size - *mean) * (dt / 1.0).min(1.0);
    }
}
