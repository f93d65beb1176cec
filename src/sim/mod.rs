//! A multirotor in software: the physics, the air, the sensors, the autopilot and the MAVLink stream it would send.
//!
//! In: a vehicle, a scenario (mission, wind, faults, seed) and, live, the frames a ground station sends. Out: frames as
//! an autopilot sends them, and the truth beside them. No I/O and no clock: time advances only by `step`, so a run is
//! the same on every machine and as fast as it goes. The physics runs on a fixed fine step, whatever the telemetry.
//!
//! Flow per loop: `wind` and `disturbance` push on `dynamics`; `sensors` measure it; `estimator` turns readings into
//! what an autopilot believes; `control` flies the mission on that belief; `feed` tells the world.
//! Imports `vehicle`, `signal`, `wire` (the feed) and the checked-TOML reader of `config` (scenarios).

pub mod control;
pub mod dynamics;
pub mod estimator;
pub mod faults;
pub mod feed;
pub mod profile;
pub mod random;
mod run;
pub mod scenario;
pub mod sensors;
mod truth_log;
mod vehicle;
pub mod wind;

pub use run::{Received, Run, RunOptions};
pub use truth_log::TruthLog;
pub use vehicle::{Acts, Disturbance, FlightPlan, Moment, NavigationSource, SimError, SimVehicle, wind_from};

#[cfg(test)]
pub(crate) mod testing;
