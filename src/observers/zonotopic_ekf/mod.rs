//! Zonotopic extended Kalman filter: an interval for every state and output (Wang, Puig 2016).
//!
//! The state lies in a zonotope, which the model moves and each measurement cuts. What the paper leaves out, the
//! remainder of the linearisation, is bounded over the current set and added, so the intervals really hold the truth.
//!
//! | file | what |
//! |---|---|
//! | `model` | what the filter needs of a system: a linear form with bounded remainder; outputs |
//! | `smooth` | that form for any equations, by interval differentiation |
//! | `filter` | Algorithms 1 and 2 for any model |
//! | `quadrotor` | the linear form of a rigid body with rotors, by hand and fast |
//! | `online` | the observer on a flying vehicle; `registration`: its options |
//! | `paper` | the paper's own model and hover experiment |

mod filter;
mod model;
mod online;
pub mod paper;
mod quadrotor;
mod registration;
mod smooth;

pub use filter::{FilterSettings, Mode, Unbounded, ZonotopicFilter};
pub use model::{Linearised, Model, Output};
pub use online::{Outputs, Settings, StateObserver};
pub use quadrotor::{ATTITUDE, Drive, POSITION, Quadrotor, QuadrotorError, RATE, STATES, VELOCITY};
pub use registration::REGISTRATION;
pub use smooth::{Differentiated, Equations, Jet, Smooth, output};
