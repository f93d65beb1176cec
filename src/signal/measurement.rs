use super::{Barometer, GnssFix, Held, MAX_ROTORS, MagField, Stamp};
use nalgebra::{UnitQuaternion, Vector3};
use std::fmt;

/// What an observer can need. Its names appear in warnings about starved observers.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Channel {
    Imu,
    Attitude,
    Velocity,
    Actuators,
    Magnetometer,
    Gnss,
    Rpm,
    Battery,
    Pressure,
}

impl Channel {
    pub const ALL: [Self; 9] = [
        Self::Imu,
        Self::Attitude,
        Self::Velocity,
        Self::Actuators,
        Self::Magnetometer,
        Self::Gnss,
        Self::Rpm,
        Self::Battery,
        Self::Pressure,
    ];
}

impl Channel {
    /// The bit that stands for it in OBSERVER_STATUS's `missing`; its place in [`Self::ALL`].
    pub const fn bit(self) -> u16 {
        1 << self as u16
    }
}

impl fmt::Display for Channel {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Imu => "IMU (HIGHRES_IMU, RAW_IMU or SCALED_IMU)",
            Self::Attitude => "attitude (ATTITUDE_QUATERNION or ATTITUDE)",
            Self::Velocity => "velocity (LOCAL_POSITION_NED, ODOMETRY or GLOBAL_POSITION_INT)",
            Self::Actuators => "actuators (ACTUATOR_OUTPUT_STATUS or SERVO_OUTPUT_RAW)",
            Self::Magnetometer => "magnetometer (HIGHRES_IMU or RAW_IMU)",
            Self::Gnss => "GNSS (GPS_RAW_INT)",
            Self::Rpm => "rotor speed (ESC_TELEMETRY or ESC_STATUS)",
            Self::Battery => "battery voltage (BATTERY_STATUS or SYS_STATUS)",
            Self::Pressure => "static pressure (SCALED_PRESSURE or HIGHRES_IMU)",
        })
    }
}

/// A value and how old it is at the measurement's instant, s. Age may be slightly negative: a sample between two
/// IMU instants is carried to the later one.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Aged<T> {
    pub value: T,
    pub age_s: f64,
}

/// Specific force and body rate at the measurement's instant.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Imu {
    /// m/s², body FRD.
    pub accel_frd_mps2: Vector3<f64>,
    /// rad/s, body FRD.
    pub rate_frd_rads: Vector3<f64>,
}

/// Normalised rotor commands (0 = stopped, 1 = full output), the mean over the interval since the last measurement.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RotorCommands {
    pub command: [f64; MAX_ROTORS],
    pub count: usize,
}

/// Why continuity with the previous measurement is lost.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Discontinuity {
    /// First measurement of this vehicle.
    First,
    /// The boot clock went back.
    Reboot,
    /// No measurement for longer than the synchroniser allows.
    Gap,
    /// The autopilot's estimator moved its attitude, position or velocity by a jump.
    EstimatorReset,
}

/// What the vehicle model makes of the rotor commands, the mean over the interval since the last measurement.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Actuation {
    /// Commands after the rotors' lag.
    pub rotors: RotorCommands,
    /// Force of the rotors, body FRD, N.
    pub force_frd_n: Vector3<f64>,
    /// Torque of the rotors about the centre of mass, body FRD, N m.
    pub torque_frd_nm: Vector3<f64>,
    /// Σ√Tᵢ over the rotors' thrusts, √N: scales rotor drag.
    pub sum_sqrt_thrust: f64,
    /// Thrust lost to inflow, all rotors, over the square of the climb speed through the air, N per m²/s².
    pub inflow_n_per_mps2: f64,
    /// Share by which force and torque may be off because an input of the thrust law (voltage, air density) is unknown.
    pub doubt: f64,
    /// The climb speed over ground that `force_frd_n` reckons with, in place of that through the air, m/s.
    pub climb_mps: f64,
}

/// Flight condition, as far as the vehicle tells it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Gate {
    pub armed: Option<bool>,
    pub in_air: Option<bool>,
}

impl Gate {
    /// True unless the vehicle says that it is disarmed or on the ground.
    pub fn may_fly(self) -> bool {
        self.armed != Some(false) && self.in_air != Some(false)
    }
}

/// Everything known about one vehicle at one instant, aligned to the IMU sample that triggered it.
///
/// Missing data is `None`; old data says its age. Neither is an error.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Measurement {
    pub stamp: Stamp,
    /// Since the previous measurement, s; 0 at a discontinuity.
    pub dt_s: f64,
    pub discontinuity: Option<Discontinuity>,
    pub gate: Gate,
    pub imu: Imu,
    pub attitude: Option<Aged<UnitQuaternion<f64>>>,
    pub velocity_ned_mps: Option<Aged<Vector3<f64>>>,
    pub position_ned_m: Option<Aged<Vector3<f64>>>,
    pub actuation: Option<Aged<Actuation>>,
    /// rev/min; NaN where unknown.
    pub rotor_rpm: Option<Aged<[f64; MAX_ROTORS]>>,
    pub voltage_v: Option<Aged<f64>>,
    pub air_density_kgm3: Option<Aged<f64>>,
    /// Raw receiver solution.
    pub gnss: Option<Held<GnssFix>>,
    pub magnetometer: Option<Held<MagField>>,
    pub barometer: Option<Held<Barometer>>,
    /// Further inertial sensors (SCALED_IMU2, SCALED_IMU3) with their own stamps; never mixed with `imu`.
    pub other_imus: [Option<Held<Imu>>; 2],
    /// The autopilot's own position (GLOBAL_POSITION_INT) from the origin of the fixes, NED, m: comparable with
    /// `gnss`, as `position_ned_m`, which counts from the autopilot's origin, is not.
    pub global_position_ned_m: Option<Held<Vector3<f64>>>,
    /// What the vehicle itself says its mass is, kg.
    pub mass_kg: Option<Aged<f64>>,
}

impl Measurement {
    /// A measurement with nothing but an IMU sample.
    pub fn new(stamp: Stamp, imu: Imu) -> Self {
        Self {
            stamp,
            dt_s: 0.0,
            discontinuity: None,
            gate: Gate::default(),
            imu,
            attitude: None,
            velocity_ned_mps: None,
            position_ned_m: None,
            actuation: None,
            rotor_rpm: None,
            voltage_v: None,
            air_density_kgm3: None,
            gnss: None,
            magnetometer: None,
            barometer: None,
            other_imus: [None; 2],
            global_position_ned_m: None,
            mass_kg: None,
        }
    }
}
