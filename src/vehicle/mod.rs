//! The vehicle model: a rigid body with rotors and drag, and the map from actuator messages to a wrench.
//!
//! In: a checked [`Vehicle`] (from TOML or a preset) and rotor commands. Out: thrust, actuator wrench, drag and its
//! inverse, each with an interval where the model itself is uncertain. Imports `sets`, `signal`
//! and `document` only.

pub mod airframe;
mod drag;
mod facts;
pub mod identify;
mod inflow;
mod load;
mod model;
pub mod presets;
mod rotors;

pub use drag::{SEA_LEVEL_KGM3, air_density_kgm3};
pub use facts::Facts;
pub use inflow::{Climb, Flying};
pub use load::{VehicleError, from_file, parse, resolve};
pub use model::{
    Actuators, Drag, Envelope, NoiseBounds, OutputSource, Ranged, Rotor, RotorDynamics, Sensors, Spin, ThrustCurve,
    Vehicle,
};
pub use rotors::{Air, RotorBank, Wrench};

/// Standard gravity, m/s².
pub const GRAVITY_MPS2: f64 = 9.80665;
