//! The rigid body: rotors, drag, ground, battery and gyroscopic terms, integrated with a fixed step.
//!
//! In: rotor commands, the wind and any outside push, all held over one step. Out: the state, and the [`Truth`] in the
//! very terms the observers are judged by. Classical Runge-Kutta of order four; the rotors' lag is solved exactly.
//! Imports `vehicle` and `signal`.

mod atmosphere;
mod battery;
mod ground;
mod mass;
mod plant;
mod rotors;
mod state;
#[cfg(test)]
mod tests;
mod truth;

pub use atmosphere::pressure_pa;
pub use battery::Battery;
pub use ground::Ground;
pub use mass::{MassProperties, Payload};
pub use plant::{Inputs, Plant, PlantConfig, Push};
pub use rotors::RotorHealth;
pub use state::State;
pub use truth::Truth;
