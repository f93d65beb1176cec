//! The check that no design goes without: eigenvalues computed by nalgebra, outside the solver and outside the
//! routines the solver calls.

use nalgebra::DMatrix;

/// Smallest eigenvalue of the symmetric part; −∞ when an entry is not finite.
pub fn smallest_eigenvalue(m: &DMatrix<f64>) -> f64 {
    if m.iter().any(|x| !x.is_finite()) {
        return f64::NEG_INFINITY;
    }
    let symmetric = (m + m.transpose()) * 0.5;
    symmetric.symmetric_eigenvalues().iter().copied().fold(f64::INFINITY, f64::min)
}

/// Smallest eigenvalue of D·M·D with D = diag(M)^{−1/2}: how far M is from singular, whatever the units of its rows.
///
/// Congruence keeps the sign, so a positive answer proves M ≻ 0 once it exceeds [`rounding`]. A row that is zero
/// throughout is left out (it holds as 0 ≥ 0); a diagonal entry that is not positive gives a negative answer.
pub fn margin(m: &DMatrix<f64>) -> f64 {
    let n = m.nrows();
    let used: Vec<usize> = (0..n).filter(|&i| (0..n).any(|j| m[(i, j)] != 0.0 || m[(j, i)] != 0.0)).collect();
    if used.is_empty() {
        return 0.0;
    }
    let worst = used.iter().map(|&i| m[(i, i)]).fold(f64::INFINITY, f64::min);
    if worst.is_nan() || worst <= 0.0 {
        return smallest_eigenvalue(m).min(-f64::MIN_POSITIVE) / m.amax().max(f64::MIN_POSITIVE);
    }
    let d: Vec<f64> = used.iter().map(|&i| m[(i, i)].sqrt().recip()).collect();
    smallest_eigenvalue(&DMatrix::from_fn(used.len(), used.len(), |i, j| m[(used[i], used[j])] * d[i] * d[j]))
}

/// Bound on the rounding error of [`margin`] for an n×n matrix whose entries were computed with a few dozen
/// operations each: entries of the normalised matrix are at most 1, so n·2⁻⁵² times a generous count.
pub fn rounding(n: usize) -> f64 {
    64.0 * n as f64 * f64::EPSILON
}

/// Whether M ≻ 0 beyond doubt of rounding.
pub fn is_positive(m: &DMatrix<f64>) -> bool {
    margin(m) > rounding(m.nrows())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_margin_does_not_depend_on_units() {
        let m = DMatrix::from_row_slice(3, 3, &[2.0, 0.5, 0.1, 0.5, 1.0, -0.3, 0.1, -0.3, 4.0]);
        let d = DMatrix::from_diagonal(&nalgebra::dvector![1e6, 1e-6, 1.0]);
        assert!((margin(&(&d * &m * &d)) - margin(&m)).abs() < 1e-12);
        assert!(is_positive(&m));
    }

    #[test]
    fn what_is_not_positive_is_refused() {
        assert!(margin(&DMatrix::from_row_slice(2, 2, &[1.0, 2.0, 2.0, 1.0])) < -0.9);
        assert!(margin(&DMatrix::from_row_slice(2, 2, &[0.0, 1.0, 1.0, 1.0])) < 0.0);
        assert!(!is_positive(&DMatrix::from_row_slice(2, 2, &[1.0, 1.0, 1.0, 1.0])));
        assert!(!is_positive(&DMatrix::from_element(2, 2, f64::NAN)));
        // an empty row holds as 0 ⪰ 0
        assert!(is_positive(&DMatrix::from_row_slice(2, 2, &[0.0, 0.0, 0.0, 1.0])));
    }
}
