//! Attitude, velocity and position from raw inertial sensors, magnetometer and GNSS (Grip, Saberi, Johansen 2012): an
//! observer for a nonlinear system whose output drives a linear one, of which alone something is measured.
//!
//! | file | what |
//! |---|---|
//! | `plant` | the linear system Σ₂, its extension by z (eq. 8), the navigation example and Example 1 |
//! | `conditions` | Assumption 4: detectable, left-invertible, no zero at the origin; minimum phase |
//! | `norm` | H∞ norms by Hamiltonian eigenvalues, outside the solver |
//! | `design` | gains from (14), (15) and pole regions; Theorems 1 and 1' |

mod conditions;
mod design;
mod norm;
mod plant;

pub use conditions::{Breach, Conditions};
pub use design::{Design, DesignError, Goal, PoleRegion, cascade_gamma, design, feedback_gamma};
pub use norm::{HinfNorm, eigenvalues, hinf_norm, spectral_abscissa};
pub use plant::{Extended, Measures, Plant, PlantError};
