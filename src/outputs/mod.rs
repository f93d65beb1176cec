//! [`Snapshot`](crate::pipeline::Snapshot) → MAVLink messages, at the rates of one link. No I/O, no clock.
//!
//! In: snapshots, notices and "this vehicle was heard", each with its receive time. Out: frames in the name of the
//! vehicle's system and our component (191), numbered per link and system, so that a receiver counts no losses.
//!
//! | message | name | fields | unit, frame |
//! |---|---|---|---|
//! | HEARTBEAT | | onboard controller, no autopilot | 1 Hz while the vehicle is heard |
//! | DEBUG_VECT | `WR_F` | force | N, NED |
//! | DEBUG_VECT | `WR_T` | torque | N m, FRD |
//! | DEBUG_FLOAT_ARRAY 1 | `WRENCH` | \[0..2\] force, \[3..5\] torque, \[6..11\] their half-widths, \[12..14\] wind, \[15..17\] its half-width, \[18\] 1 if guaranteed, \[19\] fault mask | N NED, N m FRD, m/s NED towards |
//! | DEBUG_FLOAT_ARRAY 2, 3 | `BOUND_LO`, `BOUND_HI` | ends of every observer's signals, in registry order, at most 58 | SI |
//! | NAMED_VALUE_FLOAT | see [`SCALARS`] | one name at a time, in turn | see there |
//! | NAMED_VALUE_INT | `Faults` | fault mask, with every FAULT_STATUS | |
//! | WIND_COV (only if asked for) | | wind, and half-width/√3 as its deviation | m/s NED towards |
//! | STATUSTEXT | | start, state changes | 50 characters a chunk |
//! | WRENCH_ESTIMATE, WIND_ESTIMATE, STATE_BOUNDS, FAULT_STATUS, OBSERVER_STATUS | | everything | `dialects/mavobserver.xml` |
//!
//! Times are the measurement's, since the vehicle booted. What is not known is NaN, and so is a half-width that claims
//! nothing: plots leave NaN out, while infinity breaks their scale. Our own dialect says infinity for such a half-width.
//! A message without any known number is not sent. Half-widths are rounded up, so that a bound holds on the wire too.
//!
//! Imports `wire`, `signal` and `pipeline` only.

mod common;
mod limiter;
mod link;
mod own;
mod rounding;
mod settings;
mod text;

pub use common::{SCALARS, Scalar};
pub use link::LinkOutputs;
pub use rounding::half_widths;
pub use settings::{OutputSettings, Rate, Rates};
