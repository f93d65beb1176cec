use super::LinkTrouble;
use crate::sim::dynamics::Payload;
use nalgebra::Vector3;
use std::fmt;

/// A fault and the time it lasts.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Fault {
    pub kind: FaultKind,
    pub from_s: f64,
    /// Infinite when it never clears.
    pub until_s: f64,
}

/// What is wrong. Rotors count from 0, inertial sensors too.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum FaultKind {
    /// The motor reaches only this share of its thrust; 0 is a lost rotor.
    RotorWeak {
        rotor: usize,
        share: f64,
    },
    /// The propeller gives only this share of its thrust at full speed.
    RotorDamaged {
        rotor: usize,
        share: f64,
    },
    /// The rotor turns at this command, whatever is asked.
    RotorStuck {
        rotor: usize,
        command: f64,
    },
    /// Changes mass, centre of mass and inertia while it lasts.
    PayloadAttached(Payload),
    AccelBias {
        imu: usize,
        bias_mps2: Vector3<f64>,
    },
    AccelNoise {
        imu: usize,
        sigma_mps2: f64,
    },
    AccelFrozen {
        imu: usize,
    },
    GyroBias {
        imu: usize,
        bias_rads: Vector3<f64>,
    },
    GyroNoise {
        imu: usize,
        sigma_rads: f64,
    },
    GyroFrozen {
        imu: usize,
    },
    MagBias {
        bias_gauss: Vector3<f64>,
    },
    MagNoise {
        sigma_gauss: f64,
    },
    MagFrozen,
    BaroBias {
        bias_pa: f64,
    },
    BaroNoise {
        sigma_pa: f64,
    },
    BaroFrozen,
    /// The position is off by this.
    GnssStep {
        shift_ned_m: Vector3<f64>,
    },
    /// The position walks away at this speed.
    GnssRamp {
        speed_ned_mps: Vector3<f64>,
    },
    GnssLost,
    Link(LinkTrouble),
}

impl FaultKind {
    /// What happens, in the word that a scenario's file has for it.
    pub fn kind(&self) -> &'static str {
        match self {
            Self::RotorWeak { share, .. } if *share == 0.0 => "rotor_lost",
            Self::RotorWeak { .. } => "rotor_weak",
            Self::RotorDamaged { .. } => "rotor_damaged",
            Self::RotorStuck { .. } => "rotor_stuck",
            Self::PayloadAttached(_) => "payload",
            Self::AccelBias { .. } => "accel_bias",
            Self::AccelNoise { .. } => "accel_noise",
            Self::AccelFrozen { .. } => "accel_frozen",
            Self::GyroBias { .. } => "gyro_bias",
            Self::GyroNoise { .. } => "gyro_noise",
            Self::GyroFrozen { .. } => "gyro_frozen",
            Self::MagBias { .. } => "mag_bias",
            Self::MagNoise { .. } => "mag_noise",
            Self::MagFrozen => "mag_frozen",
            Self::BaroBias { .. } => "baro_bias",
            Self::BaroNoise { .. } => "baro_noise",
            Self::BaroFrozen => "baro_frozen",
            Self::GnssStep { .. } => "gnss_step",
            Self::GnssRamp { .. } => "gnss_ramp",
            Self::GnssLost => "gnss_lost",
            Self::Link(_) => "link",
        }
    }
}

impl fmt::Display for FaultKind {
    /// The name an estimate's fault column uses.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::RotorWeak { rotor, .. } | Self::RotorDamaged { rotor, .. } | Self::RotorStuck { rotor, .. } => {
                return write!(f, "rotor_{}", rotor + 1);
            }
            Self::PayloadAttached(_) => "payload",
            Self::AccelBias { .. } | Self::AccelNoise { .. } | Self::AccelFrozen { .. } => "accel",
            Self::GyroBias { .. } | Self::GyroNoise { .. } | Self::GyroFrozen { .. } => "gyro",
            Self::MagBias { .. } | Self::MagNoise { .. } | Self::MagFrozen => "mag",
            Self::BaroBias { .. } | Self::BaroNoise { .. } | Self::BaroFrozen => "baro",
            Self::GnssStep { .. } | Self::GnssRamp { .. } | Self::GnssLost => "gnss_position",
            Self::Link(_) => "link",
        })
    }
}
