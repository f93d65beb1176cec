//! Fuzzy-polynomial observer: angular speeds from angles and rotors (Pitarch, Sala 2014).
//!
//! | file | what |
//! |---|---|
//! | `plant` | the model (6), its vertices and symmetries |
//! | `design` | the six strategies and what a design is |
//! | `takagi_sugeno` | Corollary 1: (20)–(23) on the linear and the Takagi–Sugeno model |
//! | `inequalities` | the polynomials of Theorem 1 |
//! | `polynomial` | Theorem 1: designs and analyses by sums of squares |
//! | `units` | units in which a design's numbers are of size one |
//! | `cache` | what of a design is kept on disk |
//! | `front` | all strategies over decay rates, and the Pareto front |
//! | `experiment` | one experiment for every observer of the front (methodology II–V) |
//! | `rig` | that experiment in software |
//! | `schedule` | gains over the sample times of a flying vehicle |
//! | `online` | body rates of a flying vehicle without its gyro; `monitor`: how wrong they were |
//! | `paper` | what the paper prints |

mod cache;
mod design;
mod experiment;
mod front;
mod inequalities;
mod monitor;
mod online;
pub mod paper;
mod plant;
mod polynomial;
pub mod rig;
mod schedule;
mod takagi_sugeno;
mod units;

pub use design::{Design, DesignError, Gain, Method, Options, design};
pub use experiment::{Record, RecordError, estimates, integral_square_error, ranked};
pub use front::{front, pareto};
pub use online::{REGISTRATION, RateObserver};
pub use plant::{FITTED_RADIUS2, PRINTED_RADIUS2, Plant, PlantError};
pub use schedule::Schedule;

#[cfg(test)]
mod tests;
