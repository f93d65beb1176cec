//! Sets that hold what is not known exactly. For now the interval; every operation rounds outward.
//!
//! Imports nothing of this crate.

mod interval;

pub use interval::Interval;
