//! Bounds on the rounding of floating-point arithmetic.
//!
//! One operation errs by at most u = 2⁻⁵³ of its result; a sum of n products in any order by at most
//! γₙ = n·u/(1 − n·u) of the sum of their absolute values (Higham, *Accuracy and Stability of Numerical Algorithms*,
//! §3.1). What is lost when a product underflows is less than 2⁻¹⁰⁷⁴ each, and [`up`] covers 2⁵² of them.

const U: f64 = 0.5 * f64::EPSILON;

/// At least γₙ, for n up to 2⁴⁵.
pub(super) fn gamma(n: usize) -> f64 {
    1.01 * n as f64 * U
}

/// At least the exact value of a quantity ≥ 0 that was computed as `x` from numbers ≥ 0 in `n` roundings.
pub(super) fn up(x: f64, n: usize) -> f64 {
    x * (1.0 + gamma(n + 2)) + f64::MIN_POSITIVE
}

/// False for NaN too.
pub(super) fn is_positive(x: f64) -> bool {
    x > 0.0
}

/// Strands of a sum: enough for the processor to add while earlier additions are still under way.
pub(super) const STRANDS: usize = 8;

/// Σ|xⱼ|.
pub(super) fn sum_abs(x: &[f64]) -> f64 {
    let (chunks, rest) = x.as_chunks::<STRANDS>();
    let mut s = [0.0; STRANDS];
    for c in chunks {
        for i in 0..STRANDS {
            s[i] += c[i].abs();
        }
    }
    s.iter().sum::<f64>() + rest.iter().map(|x| x.abs()).sum::<f64>()
}

/// x·y.
pub(super) fn dot(x: &[f64], y: &[f64]) -> f64 {
    let ((a, more_a), (b, more_b)) = (x.as_chunks::<STRANDS>(), y.as_chunks::<STRANDS>());
    let mut s = [0.0; STRANDS];
    for (a, b) in a.iter().zip(b) {
        for i in 0..STRANDS {
            s[i] += a[i] * b[i];
        }
    }
    s.iter().sum::<f64>() + more_a.iter().zip(more_b).map(|(x, y)| x * y).sum::<f64>()
}
