//! What the simulated autopilot says and hears: MAVLink, as ArduPilot or PX4 would.
//!
//! In: the [`SimVehicle`](super::SimVehicle) after each loop, and the frames of ground stations. Out: frames, each at
//! its rate, with the units, stamps, quantisation and habits of the stack. No I/O and no clock; nothing is allocated
//! for a frame sent. Imports `wire`.
//!
//! One table (`catalog`) names every stream: message, rate when unasked, and the function that fills it. Numbers and
//! habits are those of recorded ArduCopter 4.6.3 and PX4 1.17 streams.

mod catalog;
mod commands;
mod messages;
mod params;
mod schedule;
mod stack;
mod state;
mod view;
mod writer;

pub use catalog::{can_send, names};
pub use stack::Stack;
pub use state::{Feed, FeedConfig, MavlinkGeneration};

#[cfg(test)]
mod tests;
