//! The vehicle model: a rigid body with rotors and drag, and the map from actuator messages to a wrench.
//!
//! In: a checked [`Vehicle`] (from TOML or a preset) and rotor commands. Out: thrust, actuator wrench, drag and its
//! inverse, each with an interval where the model itself is uncertain. Imports `sets` and `signal` only.

mod drag;
mod model;
mod rotors;

pub use drag::air_density_kgm3;
pub use model::{
    Actuators, Drag, Envelope, NoiseBounds, OutputSource, Ranged, Rotor, RotorDynamics, Sensors, Spin, ThrustCurve,
    Vehicle,
};
pub use rotors::{Air, RotorBank, Wrench};

/// Standard gravity, m/s².
pub const GRAVITY_MPS2: f64 = 9.80665;
