//! Which part of a vehicle is at fault, from what its telemetry contradicts.
//!
//! In: the measurements of one vehicle. Out: the active [`Fault`]s, each with its onset and size. A fault stands behind
//! a [`Residual`](crate::signal::Residual): two sources that should agree, and by how much they may differ. None is
//! told before its residual has been beyond its admissible size for a set time, and none clears before it has been well
//! within for another.
//!
//! | file | residual | fault |
//! |---|---|---|
//! | `inertial` | two inertial sensors of one body | gyro, accelerometer |
//! | `fixes` | GNSS positions against their own velocities; those against the vehicle's | GNSS |
//! | `height` | barometer against vertical velocity | barometer |
//! | `field` | length of the magnetic field against what it was | magnetometer |
//! | `rotors` | torque against what each rotor's loss would leave | rotor |
//! | `weight` | vertical force against weight | payload |
//! | `monitor` | how long before a fault is told, and before it clears | |
//! | `bank` | all together | |
//!
//! The levels are statistical: they come from the vehicle's declared noise with room for what telemetry adds.
//! Imports `signal`, `vehicle` and nothing else.

mod bank;
mod fault;
mod field;
mod fixes;
mod height;
mod inertial;
mod monitor;
mod rotors;
mod weight;

#[cfg(test)]
mod tests;

pub use bank::FaultBank;
pub use fault::{Active, Fault};
