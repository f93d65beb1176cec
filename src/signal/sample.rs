use super::{GnssFix, MAX_ROTORS, MagField, Stamp};
use nalgebra::{UnitQuaternion, Vector3};

/// Which message brought an inertial sample. An autopilot often sends one sensor through several messages; the
/// synchroniser uses exactly one source, the best that arrives.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum ImuSource {
    /// SCALED_IMU3 and SCALED_IMU2: other sensors, kept beside the first and never mixed with it.
    Third,
    Second,
    /// RAW_IMU or SCALED_IMU: integers, 1 mG and 1 mrad/s.
    Scaled,
    /// HIGHRES_IMU: floats.
    HighRes,
}

/// One decoded message of a vehicle, in SI units, stamped with the vehicle's boot clock.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sample {
    pub stamp: Stamp,
    pub kind: SampleKind,
}

#[derive(Debug, Clone, Copy, PartialEq)]
pub enum SampleKind {
    /// Specific force (m/s², gravity not included: at rest z reads −9.81) and rate (rad/s), body FRD.
    Imu {
        source: ImuSource,
        accel_frd_mps2: Vector3<f64>,
        rate_frd_rads: Vector3<f64>,
    },
    Mag(MagField),
    /// Attitude, body FRD to world NED.
    Attitude {
        body_to_ned: UnitQuaternion<f64>,
    },
    /// Local position (m) and velocity (m/s), NED.
    LocalPosition {
        position_ned_m: Vector3<f64>,
        velocity_ned_mps: Vector3<f64>,
    },
    /// Velocity NED (m/s), where no local position comes with it.
    Velocity {
        velocity_ned_mps: Vector3<f64>,
    },
    /// Position estimate of the autopilot, with height above mean sea level (m).
    GlobalPosition {
        latitude_deg: f64,
        longitude_deg: f64,
        altitude_m: f64,
    },
    /// Raw receiver solution; its position in NED is filled in by the synchroniser, which knows the origin.
    Gnss(GnssFix),
    /// Output of the mixer for rotor 1.., on the scale the vehicle's actuator map names (µs of pulse, or 0..1).
    Actuators {
        outputs: [f64; MAX_ROTORS],
    },
    /// Measured rotor speed, rev/min; `NaN` where unknown.
    RotorRpm {
        rpm: [f64; MAX_ROTORS],
    },
    /// Battery voltage under load, V.
    Battery {
        voltage_v: f64,
    },
    /// Static pressure, Pa.
    Pressure {
        pressure_pa: f64,
    },
    /// What the vehicle itself says its mass is, kg.
    Mass {
        mass_kg: f64,
    },
    /// From HEARTBEAT.
    Armed(bool),
    /// From EXTENDED_SYS_STATE; `None` when the autopilot does not know.
    InAir(Option<bool>),
}
