//! MAVLink → [`Sample`](crate::signal::Sample) → [`Measurement`](crate::signal::Measurement).
//!
//! [`Decoder`] turns one frame into samples in SI units on the vehicle's boot clock ([`VehicleClock`]); [`Aligner`] brings the
//! channels to common instants. In: frames with their receive time. Out: measurements. No I/O, no clock of its own.
//!
//! A simulator's truth (SIMSTATE, SIM_STATE, HIL_STATE_QUATERNION) and the autopilot's own wind (WIND, WIND_COV) are
//! not decoded at all: an observer cannot see them.
//!
//! Imports `wire`, `signal` and `vehicle` only.

mod align;
mod clock;
mod decode;
mod geodesy;
mod history;
mod param_value;
pub mod parameters;
pub mod requests;
pub mod timesync;

pub use align::Aligner;
pub use clock::{ClockEvent, VehicleClock};
pub use decode::{Decoded, Decoder};
pub use geodesy::LocalOrigin;
pub use param_value::{Encoding, ParamValue};
