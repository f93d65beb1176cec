//! How good the estimates are: simulated flights with known truth, flown in lock-step with the estimators.
//!
//! In: scenarios, seeds, names of observers. Out: for each of their signals error, bias, coverage and width of the
//! bound, how long a change takes to be followed, what a step costs, and how faults were told. An observer joins by its
//! line in the registry; a signal is scored when its name is one the truth knows. No I/O, no threads: callers spread
//! trials over cores. Imports `observers`, `pipeline`, `sim`, `signal`, `vehicle` and `wire`.

mod detection;
mod errors;
pub mod experiments;
mod fly;
mod settling;
mod trial;
mod truth;

pub use detection::{Detection, FaultWatch, Told, TrueFault};
pub use errors::{Errors, Stats};
pub use fly::{TrialError, fly};
pub use settling::{Settling, settle};
pub use trial::{Conduct, Quantity, Trial};
pub use truth::{TruthTrack, is_known};
