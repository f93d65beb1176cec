//! Sets that hold what is not known exactly: [`Interval`], [`Zonotope`], [`Ellipsoid`].
//!
//! Each stands for everything a quantity may be. An operation answers with a set that holds the exact result for
//! every member of its operands. That includes the rounding of the computer: every result is widened by a bound on
//! the error of its own arithmetic, so "contains" means contains, and a point that is outside is really outside.
//!
//! | operation | interval | zonotope | ellipsoid |
//! |---|---|---|---|
//! | Minkowski sum | exact | exact | outer, of least trace |
//! | linear map | tight for each row | exact | exact |
//! | intersection with a strip | exact | outer, of least Frobenius radius | outer, of least volume |
//! | interval hull, support | exact | exact | exact |
//! | membership | exact | by a certificate, else undecided | within rounding |
//! | volume | exact | exact while there are few generators | exact |
//!
//! "Exact" is meant up to that widening. A zonotope grows with every sum, so it is reduced now and then: see
//! [`Reduction`].
//!
//! A point that moves and turns a little, with an error box, measured by a strip:
//!
//! ```
//! use mavobserver::sets::{Interval, Reduction, Strip, Zonotope};
//! use nalgebra::{matrix, vector};
//!
//! // at most 20 generators in the plane: nothing here allocates
//! let mut set: Zonotope<2, 20> = Zonotope::from_box(&[Interval::centred(1.0, 0.2), Interval::centred(0.0, 0.2)]);
//! for _ in 0..10 {
//!     set = set.map(&matrix![0.9, -0.3; 0.3, 0.9]);
//!     set.add_box(&vector![0.01, 0.01]);
//!     set.reduce(Reduction::Girard, 5, &vector![1.0, 1.0]);
//! }
//! let wide = set.radius(0);
//! let seen = set.intersect_strip(&Strip { normal: vector![1.0, 0.0], offset: set.centre()[0], half_width: 0.05 });
//! assert!(seen.is_some() && set.radius(0) < wide);
//! ```
//!
//! Imports nothing of this crate.

mod elementary;
mod ellipsoid;
mod interval;
mod linear;
mod measure;
mod membership;
mod products;
mod reduce;
mod rounding;
mod strip;
mod volume;
mod zonotope;

pub use ellipsoid::Ellipsoid;
pub use interval::Interval;
pub use measure::AxisStrip;
pub use membership::Membership;
pub use reduce::Reduction;
pub use strip::{Overlap, Strip};
pub use zonotope::Zonotope;
