//! Wind from the residual force: `w = v − R·v_air`, where the velocity through the air `v_air` is the inverse of the
//! vehicle's drag law at the residual force.
//!
//! In: a measurement, the residual force with its interval. Out: the velocity of the air over ground (towards), NED,
//! with an interval. Imports `sets`, `vehicle` and `signal` only.
//!
//! # What the bound assumes
//! - **W1** nothing but air and the modelled rotors pushes the vehicle (no contact, no cable);
//! - **W2** mass, air density and drag coefficients lie in the vehicle's declared ranges;
//! - **W3** accelerometer, velocity, tilt and heading errors, and the vertical wind, lie within the declared bounds.
//!
//! Given W1–W3 and a residual-force interval that holds, the wind lies in the interval given. The drag law is monotone
//! on each axis, so the ends of the force interval give the ends of the airspeed interval.

mod from_force;

pub use from_force::{Flow, ForceInterval, Wind, wind_from_force};
