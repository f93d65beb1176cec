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
//! | `paper` | what the paper prints |

mod cache;
mod design;
mod front;
mod inequalities;
pub mod paper;
mod plant;
mod polynomial;
mod takagi_sugeno;
mod units;

pub use design::{Design, DesignError, Gain, Method, Options, design};
pub use front::{front, pareto};
pub use plant::{FITTED_RADIUS2, PRINTED_RADIUS2, Plant, PlantError};

#[cfg(test)]
mod tests;
