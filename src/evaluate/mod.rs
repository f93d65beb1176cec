//! How good the estimates are: simulated flights with known truth, flown in lock-step with the estimators.
//!
//! In: scenarios, seeds, names of observers. Out: for each of their signals error, bias, coverage and width of the
//! bound, how long a change takes to be followed, and what a step costs. An observer joins by its line in the registry;
//! a signal is scored when its name is one the truth knows. No I/O, no threads: callers spread trials over cores.
//! Imports `pipeline`, `sim`, `signal` and `wire`.

mod errors;
pub mod experiments;
mod settling;
mod trial;
mod truth;

pub use errors::{Errors, Stats};
pub use settling::{Settling, settle};
pub use trial::{Quantity, Trial, TrialError, fly};
pub use truth::{TruthTrack, is_known};
