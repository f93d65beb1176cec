//! The unknown-input observer: torque under changing mass and inertia (Pham, Ichalal, Mammar 2020), and the mass itself.
//!
//! | file | what |
//! |---|---|
//! | `plant` | a polytope of plants with an unknown input; that of a vehicle, and the paper's |
//! | `design` | the paper's conditions, each with its reason, and the corrected matrix inequality (22) |
//! | `torque` | the unknown input without any derivative of a measurement, exact between samples |
//! | `mass` | mass from the balance of thrust and specific force |
//! | `schedule` | which mass and inertia hold now |
//! | `online` | the observer on a flying vehicle |

mod design;
mod mass;
mod online;
pub mod plant;
mod schedule;
mod torque;

pub use design::{DesignError, Objective, UnknownInputDesign, design};
pub use mass::MassBalance;
pub use online::{REGISTRATION, TorqueObserver};
pub use plant::{Polytope, Vertex, attitude_of};
pub use schedule::{Body, Schedule, Source};
pub use torque::{TorqueFilter, TorqueStep};
