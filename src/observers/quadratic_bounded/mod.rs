//! Quadratic boundedness: force and torque wrench with an ellipsoid that holds the error (Cayero et al. 2019).
//!
//! | file | what |
//! |---|---|
//! | `sampled` | the design that runs: a certificate for held samples (DESIGN §6.2) |
//! | `channels` | one design for each world axis of a vehicle, from its declared bounds; the registration |
//! | `filter` | the sampled observer and the level of its certificate, for any plant |
//! | `online` | the observer on a flying vehicle |

mod certify;
mod channels;
mod filter;
mod flow;
mod jet;
mod online;
mod plant;
mod sampled;

pub use channels::{Channels, REGISTRATION};
pub use filter::{Designed, Filter};
pub use online::WrenchObserver;
