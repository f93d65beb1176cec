//! The values that flow through the program, in SI units, free of MAVLink, I/O and clocks.
//!
//! [`Stamp`] is time on one vehicle's boot clock. [`Sample`] is one decoded message. [`Measurement`] is the aligned
//! view of a vehicle at one IMU instant, which is all an observer ever sees. [`Estimate`] is what an observer answers.
//!
//! Frames: world is NED, body is FRD, quaternions take body to world. Names carry frame and unit
//! (`force_ned_n`, `rate_frd_rads`) wherever a swap would still compile.

mod estimate;
mod held;
mod measurement;
mod sample;
mod stamp;

pub use estimate::{Estimate, Guarantee, Residual, Signal, Verdict};
pub use held::{Barometer, FixType, GnssFix, Held, MagField, MagSource};
pub use measurement::{Actuation, Aged, Channel, Discontinuity, Gate, Imu, Measurement, RotorCommands};
pub use sample::{ImuSource, Sample, SampleKind};
pub use stamp::Stamp;

/// The most rotors a vehicle may have (octocopter, coaxial dodeca included).
pub const MAX_ROTORS: usize = 12;
