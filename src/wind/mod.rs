//! Wind from what the vehicle feels: `w = v − R·v_air`, where the velocity through the air `v_air` is the inverse of the
//! vehicle's drag law, each axis from the channel that knows it best (DESIGN §6.7).
//!
//! | file | what |
//! |---|---|
//! | `instant` | wind of one measurement with its interval: drag across the thrust axis from the accelerometer, where neither thrust nor attitude plays a part; along it from the balance of thrust |
//! | `drift` | what a GNSS receiver knows better of the velocity than the autopilot |
//! | `follow` | what the noise of those instants leaves of the wind |
//! | `front` | how a bound opens when the wind turns, and closes again |
//! | `observer` | the three together |
//!
//! In: measurements, and the residual force with its interval where there is one. Out: the velocity of the air over
//! ground (towards), NED, with an interval. Imports `sets`, `vehicle` and `signal` only.
//!
//! # What the bound assumes
//! - **W1** nothing but air and the modelled rotors pushes the vehicle (no contact, no cable);
//! - **W2** mass, thrust, air density and drag coefficients lie in the vehicle's declared ranges;
//! - **W3** accelerometer, velocity, tilt and heading errors, and the vertical wind, lie within the declared bounds.
//!
//! Given W1–W3 the wind lies in the interval given: the drag law is monotone on each axis, so the ends of the force
//! interval give the ends of the airspeed interval. Where the wind turns within a second the interval is wider than
//! that: it then holds for all the air around the vehicle, old and new.

mod drift;
mod follow;
mod front;
mod instant;
mod observer;

pub use instant::{Flow, ForceInterval, Instant};
pub use observer::{Wind, WindObserver};
