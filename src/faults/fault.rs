use crate::signal::Stamp;

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
}

/// A fault that is present.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Active {
    pub fault: Fault,
    /// When its residual first left its bound.
    pub onset: Stamp,
    /// Lost share of thrust for a rotor, kg for a payload, the sensor's SI unit for a sensor.
    pub magnitude: f64,
}
