//! What breaks, and when: rotors, sensors, payload and the radio link.
//!
//! In: a schedule of [`Fault`]s. Out: rotor health and payload for the physics, sensor errors for the sensors,
//! [`LinkTrouble`] for the link, and the names of what is active, as the estimates' `faults` column spells them.

mod kinds;
mod link;
mod schedule;

pub use kinds::{Fault, FaultKind};
pub use link::{LinkTrouble, TroubledLink};
pub use schedule::FaultSchedule;
