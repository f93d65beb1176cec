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
//! | `field` | magnetic field, by the vehicle's attitude, against what it was | magnetometer |
//! | `rotors` | torque against what each rotor's loss would leave | rotor |
//! | `health` | what each rotor gave over a flight, fault or none | |
//! | `speed` | measured rotor speed against its command | rotor |
//! | `weight` | force along the thrust axis against weight | payload |
//! | `averaged` | the smoothed difference of two sources against chance | |
//! | `level` | how far chance reaches, from the false alarms that are bearable | |
//! | `monitor` | how long before a fault is told, and before it clears | |
//! | `bank` | all together, and which of them explains which | |
//!
//! The levels are statistical: what is declared of the vehicle, and beside it what chance makes of the unrest that each
//! residual shows, at a rate of false alarms that is set. Where an observer's guaranteed residual contradicts the data at
//! the same time, the fault is told as guaranteed.
//! Imports `signal`, `vehicle` and nothing else.

mod averaged;
mod bank;
mod fault;
mod field;
mod fixes;
mod health;
mod height;
mod inertial;
mod level;
mod monitor;
mod rotors;
mod settings;
mod speed;
mod weight;

#[cfg(test)]
mod tests;

pub use bank::FaultBank;
pub use fault::{Active, Fault};
pub use health::RotorHealth;
pub use settings::FaultSettings;
