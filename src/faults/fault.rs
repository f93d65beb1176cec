use crate::signal::{Guarantee, Stamp};

/// What can be at fault. The bit of each is its place in MAVOBSERVER_FAULT.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Fault {
    /// Loss of thrust of a rotor, numbered from 0.
    Rotor(u8),
    Gyro,
    Accelerometer,
    Magnetometer,
    Barometer,
    GnssPosition,
    GnssVelocity,
    Payload,
}

impl Fault {
    /// The bit that stands for it.
    pub fn bit(self) -> u32 {
        let place = match self {
            Self::Rotor(i) => u32::from(i.min(11)),
            Self::Gyro => 12,
            Self::Accelerometer => 13,
            Self::Magnetometer => 14,
            Self::Barometer => 15,
            Self::GnssPosition => 16,
            Self::GnssVelocity => 17,
            Self::Payload => 19,
        };
        1 << place
    }

    /// Does an output that no admissible noise explains speak for this fault? By the output's name, as the observers of
    /// the whole state call it.
    pub(super) fn shows_in(self, output: &str) -> bool {
        let within = |stems: &[&str]| stems.iter().any(|stem| output.starts_with(stem));
        match self {
            Self::Rotor(_) => within(&["rate_"]),
            Self::Gyro => within(&["rate_", "roll", "pitch", "yaw"]),
            Self::Accelerometer | Self::Payload | Self::GnssVelocity => within(&["velocity_"]),
            Self::Magnetometer => within(&["yaw"]),
            Self::Barometer => within(&["velocity_d", "position_d"]),
            Self::GnssPosition => within(&["position_n", "position_e"]),
        }
    }
}

/// A fault that is present.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Active {
    pub fault: Fault,
    /// Bits of other faults of which it may be one instead, where the data cannot tell.
    pub or: u32,
    /// When its residual first left its bound.
    pub onset: Stamp,
    /// Lost share of thrust for a rotor, kg for a payload (negative for one put down), the sensor's unit for a sensor.
    pub magnitude: f64,
    /// `Guaranteed` where an observer's output also contradicted every admissible noise since the onset: then something
    /// is wrong beyond doubt, and isolation says what. Else `Statistical`: healthy data stay within the bound of the
    /// fault's residual with this probability.
    pub guarantee: Guarantee,
}
