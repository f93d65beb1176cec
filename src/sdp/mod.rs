//! Semidefinite programs: linear matrix inequalities written as they stand in a paper, solved, and checked.
//!
//! In: a [`Problem`] made of unknown matrices, [`Affine`] expressions of them, inequalities `⪰ 0` and an objective
//! (linear, log det, or both). Out: an [`Outcome`]: optimal, infeasible with a certificate, unbounded with a direction,
//! or inaccurate. [`verify`] judges a result by eigenvalues computed outside the solver; a design is accepted on its
//! word alone. `bridge` is the only file that knows Clarabel, `scaling` brings every problem to comparable units, and
//! `lapack` gives Clarabel its linear algebra in pure Rust.
//!
//! Imports nothing of this crate.

mod bridge;
mod expr;
// C symbols, called by Clarabel through pointers
#[allow(unsafe_code)]
#[cfg(not(feature = "system-openblas"))]
mod lapack;
mod norms;
mod outcome;
mod parallel;
mod problem;
mod scaling;
pub mod verify;

pub use expr::{Affine, ShapeError};
pub use outcome::{Infeasible, Outcome, Solution, Unbounded};
pub use parallel::in_parallel;
pub use problem::{LogDet, Problem, ProblemError, Settings};

#[cfg(test)]
mod tests;
