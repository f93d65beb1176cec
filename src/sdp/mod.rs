//! Semidefinite programs.
#[cfg(not(feature = "system-openblas"))]
mod lapack;
