//! Quadratic boundedness: force and torque wrench with an ellipsoid that holds the error (Cayero et al. 2019).
//!
//! | file | what |
//! |---|---|
//! | `plant` | plants and their bounded disturbances, checked; ellipsoids and their volumes |
//! | `sampled` | the design that runs: a certificate for held samples (DESIGN §6.2) |
//! | `design` | the paper's continuous design; `paper`: its plant; `declared`: a vehicle's; `riccati`: its closed form |
//! | `synthesis` | its semidefinite programs |
//! | `detect` | why a plant has no observer |
//! | `certify` | the proof of that certificate at every step length; `flow`, `jet`: what it computes with |
//! | `cache` | what of a design is kept on disk |
//! | `channels` | one design for each world axis of a vehicle, from its declared bounds; the registration |
//! | `filter` | the sampled observer and the level of its certificate, for any plant |
//! | `online` | the observer on a flying vehicle; `thrust`: what it does not know of the rotors; `trust`: whether its
//! | | sensors tell one story |

mod cache;
mod certify;
mod channels;
mod declared;
mod design;
mod detect;
mod filter;
mod flow;
mod jet;
mod online;
pub mod paper;
mod plant;
mod riccati;
mod sampled;
mod synthesis;
mod thrust;
mod tradeoff;
mod trust;

pub use super::cache::Cache;
pub use cache::design_cached;
pub use certify::Coverage;
pub use channels::{Channels, REGISTRATION};
pub use declared::declared_plant;
pub use design::{ContinuousDesign, choose_rates, design_continuous, front};
pub(in crate::observers) use detect::unseen_motion;
pub use filter::Filter;
pub use online::WrenchObserver;
pub use plant::{NoiseBlock, Plant, PlantError, SampledPlant, half_widths, projected, volume};
pub(super) use riccati::stabilising;
pub use sampled::{Certificate, DesignError, PartialStep, SampledDesign, choose_rate, design_sampled, step_nodes};
pub use tradeoff::TradeOff;
