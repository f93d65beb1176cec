//! Attitude, velocity and position from raw inertial sensors, magnetometer and GNSS (Grip, Saberi, Johansen 2012): an
//! observer for a nonlinear system whose output drives a linear one, of which alone something is measured.
//!
//! | file | what |
//! |---|---|
//! | `plant` | the linear system Σ₂, its extension by z (eq. 8), the navigation example and Example 1 |
//! | `conditions` | Assumption 4: detectable, left-invertible, no zero at the origin; minimum phase |
//! | `norm` | H∞ norms by Hamiltonian eigenvalues, outside the solver |
//! | `design` | gains from (14), (15) and pole regions; Theorems 1 and 1' |
//! | `interconnected` | the observer (9), (10) and (17), (18) for any such pair of systems |
//! | `gains` | those of the navigation observer (24), for the noise of a receiver |
//! | `attitude` | Σ₁: attitude and gyro bias, eq. (24d) |
//! | `heading` | how much a magnetometer may turn the heading |
//! | `translation` | Σ₂: position, velocity and the estimated force, eqs. (24a)–(24c), with delayed fixes |
//! | `field` | the Earth's magnetic field |
//! | `online` | the observer on a flying vehicle |

mod attitude;
mod conditions;
mod design;
mod field;
mod gains;
mod heading;
mod interconnected;
mod norm;
mod online;
mod plant;
mod translation;

pub use conditions::{Breach, Conditions};
pub use design::{Design, DesignError, Goal, PoleRegion, cascade_gamma, design, feedback_gamma};
pub use field::earth_field_ned_gauss;
pub use gains::{AxisGains, NavigationGains, NavigationGoal};
pub use heading::HeadingNoise;
pub use interconnected::{Estimates, Interconnected, Nonlinear};
pub use norm::{HinfNorm, eigenvalues, gain_at, hinf_norm, spectral_abscissa};
pub use online::{NavigationObserver, NavigationSettings, REGISTRATION};
pub use plant::{Extended, Measures, Plant, PlantError};
