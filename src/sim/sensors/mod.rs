//! The sensors: what a perfect instrument would read, and how far the real one is from it.
//!
//! In: the truth, once per autopilot loop, and which faults are active. Out: [`Readings`], each sensor at its own rate.
//! Noise is Gaussian or bounded by choice; every sensor draws from its own random stream.

mod barometer;
mod filter;
mod gnss;
mod imu;
mod magnetometer;
mod noise;
mod rotor_speed;
mod suite;

pub use barometer::BarometerSpec;
pub use gnss::{GnssFix, GnssSpec};
pub use imu::{ImuReading, ImuSpec, Vibration};
pub use magnetometer::MagnetometerSpec;
pub use noise::NoiseShape;
pub use rotor_speed::RotorSpeedSpec;
pub use suite::{ImuError, Readings, SensorErrors, SensorSuite, Sensors};
