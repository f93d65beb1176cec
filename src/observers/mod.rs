//! The observers: one trait, one registry, one room per paper.
//!
//! In: [`Measurement`]s of one vehicle. Out: [`Estimate`]s with bounds and a verdict. An observer knows no MAVLink, no
//! clock, no I/O and no async runtime; its gains are designed in its builder, never in `step`.
//! A new observer is one new file (or room) and one line in [`REGISTRY`].
//! Imports `sets`, `sdp`, `sos`, `vehicle` and `signal` only.

pub mod cache;
pub mod cascade_gnss_ins;
pub mod fuzzy_polynomial;
mod options;
pub mod quadratic_bounded;
mod registry;
pub mod unknown_input;
pub mod zonotopic_ekf;

pub use options::{OptionError, OptionValue, Options};
pub use registry::{BuildError, Builder, Dial, REGISTRY, Registration, build, find};

use crate::signal::{Estimate, Measurement, Residual, Signal};

/// Why a step gave no estimate. Missing data and broken assumptions are verdicts inside the estimate, not errors.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum StepError {
    #[error("the state is no longer finite (first in {signal}); the observer was reset")]
    NotFinite { signal: &'static str },
}

/// A recursive estimator of what cannot be measured, for one vehicle.
pub trait Observer: Send {
    /// Name, unit and frame of each estimated scalar, in the order of the estimate's values.
    fn signals(&self) -> &[Signal];

    /// Takes in one measurement. Time comes from the measurement alone.
    fn step(&mut self, m: &Measurement) -> Result<&Estimate, StepError>;

    /// The newest answer.
    fn estimate(&self) -> &Estimate;

    /// How each output of the last step lay to what was expected of it; empty where an observer keeps no account.
    fn residuals(&self) -> &[Residual] {
        &[]
    }

    /// Forgets everything but the design.
    fn reset(&mut self);

    /// Another observer with the same design, which knows nothing yet: for another vehicle of the same model.
    fn fresh(&self) -> Box<dyn Observer>;
}
