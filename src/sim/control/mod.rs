//! The simulated autopilot's hands: a mission becomes a reference, the reference a thrust and a torque, these become
//! rotor commands.
//!
//! In: what the autopilot believes of its own motion ([`Navigation`], never the truth) and legs to fly. Out: one
//! command per rotor. The loops' speeds follow from the vehicle's rotor lag, so any vehicle model flies untuned.

mod cascade;
mod mission;
mod mixer;
mod shaper;

pub use cascade::{Controller, Limits, Reference};
pub use mission::{Flight, Leg, Pilot};
pub use mixer::{Mixer, MixerError};
pub(super) use shaper::wrap;

use nalgebra::{UnitQuaternion, Vector3};

/// What an autopilot believes of its own motion.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Navigation {
    pub position_ned_m: Vector3<f64>,
    pub velocity_ned_mps: Vector3<f64>,
    pub body_to_ned: UnitQuaternion<f64>,
    /// Body rate less the estimated bias, rad/s.
    pub rate_frd_rads: Vector3<f64>,
    /// Specific force less the estimated bias, m/s².
    pub accel_frd_mps2: Vector3<f64>,
}
