//! Sums of squares: polynomial inequalities turned into linear matrix inequalities, and certificates checked again.
//!
//! In: a [`Family`] of polynomials whose coefficients are affine in the unknowns of a [`Problem`](crate::sdp::Problem),
//! a basis of monomials, and possibly a region. Out: a [`Gram`] of matrices that the problem makes positive, and after
//! solving a [`Check`] that compares every coefficient of the identity, so that p ≥ 0 follows without trust in the
//! solver.
//!
//! A polynomial p is a sum of squares when p(z) = b(z)ᵀ·G·b(z) with G ⪰ 0 for a vector b of monomials; the matrices with
//! this identity are an affine set, of which G is written as the general member. Signs that no monomial of p notices
//! split G into blocks ([`Signs`]), and monomials whose square nothing can balance leave b ([`reduced`]).
//!
//! Imports `sdp`.

mod basis;
mod check;
mod family;
mod gram;
mod monomial;
mod polynomial;

pub use basis::{Signs, monomials, reduced};
pub use check::{Blocks, Certificate, Check, check, form};
pub use family::{Family, bilinear, quadratic};
pub use gram::{Gram, Local, SosError, positive, positive_on};
pub use monomial::{Monomial, Variables};
pub use polynomial::Polynomial;

#[cfg(test)]
mod tests;
