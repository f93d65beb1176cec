use nalgebra::{DMatrix, DVector};

/// Below this share of the largest a singular value counts as zero, in balanced coordinates.
const RANK_TOLERANCE: f64 = 1e-9;

/// Why (A, C) cannot be observed at rate α: a motion that no output shows and that does not converge by itself at α/2.
/// `None` when there is no such motion.
///
/// It explains a failed design and is not asked before one: rank decisions need a tolerance, the program does not.
pub(in crate::observers) fn unseen_motion(a: &DMatrix<f64>, c: &DMatrix<f64>, alpha: f64) -> Option<String> {
    let n = a.nrows();
    let d = balancing(a);
    let a = DMatrix::from_fn(n, n, |i, j| a[(i, j)] * d[j] / d[i]);
    let c = DMatrix::from_fn(c.nrows(), n, |i, j| c[(i, j)] * d[j]);
    let mut hidden = kernel(&c, c.norm());
    // the largest part of the kernel that A keeps to itself
    while hidden.ncols() > 0 {
        let leaving = &a * &hidden - &hidden * (hidden.transpose() * &a * &hidden);
        let staying = kernel(&leaving, a.norm());
        if staying.ncols() == hidden.ncols() {
            break;
        }
        hidden *= staying;
    }
    if hidden.ncols() == 0 {
        return None;
    }
    let restricted = hidden.transpose() * &a * &hidden;
    let k = restricted.nrows();
    let eigenvalues = faer::Mat::from_fn(k, k, |i, j| restricted[(i, j)]).eigenvalues().ok()?;
    let slowest = eigenvalues.iter().map(|e| e.re).fold(f64::NEG_INFINITY, f64::max);
    if slowest < -0.5 * alpha {
        return None;
    }
    let state = hidden.row_iter().map(|r| r.norm()).enumerate().max_by(|a, b| a.1.total_cmp(&b.1))?.0;
    Some(format!("no output shows a motion, mostly of state {state}, that does not converge by itself"))
}

/// Diagonal d that brings the entries aᵢⱼ·dⱼ/dᵢ that are not zero near one, in the least-squares sense of logarithms.
fn balancing(a: &DMatrix<f64>) -> Vec<f64> {
    let n = a.nrows();
    let pairs: Vec<(usize, usize)> =
        (0..n).flat_map(|i| (0..n).map(move |j| (i, j))).filter(|&(i, j)| i != j && a[(i, j)] != 0.0).collect();
    if pairs.is_empty() {
        return vec![1.0; n];
    }
    let m = DMatrix::from_fn(pairs.len(), n, |k, x| f64::from(x == pairs[k].1) - f64::from(x == pairs[k].0));
    let rhs = DVector::from_fn(pairs.len(), |k, _| -a[pairs[k]].abs().ln());
    match m.svd(true, true).solve(&rhs, 1e-12) {
        Ok(x) => x.iter().map(|x| x.clamp(-300.0, 300.0).exp()).collect(),
        Err(_) => vec![1.0; n],
    }
}

/// An orthonormal basis of the kernel. Rows far below `scale` are rounding; the others are brought to unit length.
fn kernel(m: &DMatrix<f64>, scale: f64) -> DMatrix<f64> {
    let n = m.ncols();
    let rows: Vec<_> = m.row_iter().filter(|r| r.norm() > RANK_TOLERANCE * scale).map(|r| r / r.norm()).collect();
    let square = rows.iter().fold(DMatrix::<f64>::zeros(n, n), |s, r| s + r.transpose() * r);
    let eigen = square.symmetric_eigen();
    let zero: Vec<usize> = (0..n).filter(|&k| eigen.eigenvalues[k] <= RANK_TOLERANCE).collect();
    DMatrix::from_fn(n, zero.len(), |i, k| eigen.eigenvectors[(i, zero[k])])
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::dmatrix;

    #[test]
    fn what_is_not_measured_and_not_driven_by_what_is_stays_hidden() {
        let chain = dmatrix![0.0, 1.0; 0.0, 0.0];
        assert_eq!(unseen_motion(&chain, &dmatrix![1.0, 0.0], 1.0), None);
        let why = unseen_motion(&chain, &dmatrix![0.0, 1.0], 1.0).unwrap();
        assert!(why.contains("state 0"), "{why}");
        // in any units
        for unit in [1e-9, 1e9] {
            let chain = dmatrix![0.0, unit; 0.0, 0.0];
            assert_eq!(unseen_motion(&chain, &dmatrix![1.0, 0.0], 1.0), None);
            assert!(unseen_motion(&chain, &dmatrix![0.0, 1.0], 1.0).is_some());
        }
    }

    #[test]
    fn a_hidden_motion_that_dies_fast_enough_does_no_harm() {
        let a = dmatrix![-3.0, 0.0; 0.0, 0.0];
        assert_eq!(unseen_motion(&a, &dmatrix![0.0, 1.0], 4.0), None);
        assert!(unseen_motion(&a, &dmatrix![0.0, 1.0], 8.0).is_some());
    }
}
