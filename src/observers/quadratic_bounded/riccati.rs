//! The paper's optimisation (31) in closed form: a Riccati equation.
//!
//! With unit disturbances (G₁ = W₁·Q₁^{−½}, R = W₂·Q₂⁻¹·W₂ᵀ, both for Q = ½·blkdiag(Q₁, Q₂)), Schur complements turn (7) into
//!
//! ```text
//! Ψ + αP + α⁻¹·P·G₁G₁ᵀ·P + α⁻¹·Y·R·Yᵀ ⪯ 0,
//! ```
//!
//! and completing the square in Y leaves Y = −α·CᵀR⁻¹ as the best choice for every P. In S = P⁻¹, with
//! A_α = A + ½α·I, that is the filter's Riccati inequality
//!
//! ```text
//! A_α·S + S·A_αᵀ − α·S·CᵀR⁻¹C·S + α⁻¹·G₁G₁ᵀ ⪯ 0.
//! ```
//!
//! An S ≻ 0 that satisfies it bounds the covariance of its own filter, so the stabilising solution S₊ of the equation
//! lies below it: S₊ ⪯ S. Hence P₊ = S₊⁻¹ is the largest P of all, and det X is largest for it whatever E₁ is.
//!
//! What is solved is the equation in P, multiplied out: −A_αᵀ·P − P·A_α − α⁻¹·P·G₁G₁ᵀ·P + α·CᵀR⁻¹C = 0, whose stabilising
//! solution is P₊ (its closed loop −A_α − α⁻¹·G₁G₁ᵀ·P₊ is similar to (A_α − α·S₊·CᵀR⁻¹C)ᵀ). At high rates the
//! disturbances hardly matter and it tends to a Lyapunov equation, where the equation in S degenerates.
//!
//! The semidefinite program is solved in the coordinates of P₊, in which its own answer is the identity, and must
//! agree; a front over many rates is computed from the equation alone.

use nalgebra::DMatrix;

/// T with S = T·Tᵀ the stabilising solution S ≻ 0 of A·S + S·Aᵀ − S·G·S + H = 0 (A − S·G stable), for G, H ⪰ 0. `None` when
/// there is none: a mode of A that is not stable is not seen through G, or not driven through H.
///
/// Structure-preserving doubling (Chu, Fan, Lin 2005), repeated in the coordinates that the last answer turns to the
/// identity, until it stays there: entries of S span many powers of ten.
pub(in crate::observers) fn stabilising(a: &DMatrix<f64>, g: &DMatrix<f64>, h: &DMatrix<f64>) -> Option<DMatrix<f64>> {
    let n = a.nrows();
    let mut t = DMatrix::<f64>::identity(n, n);
    for _ in 0..10 {
        let lu = t.clone().lu();
        let a = lu.solve(&(a * &t))?;
        let g = t.transpose() * g * &t;
        let h = lu.solve(&lu.solve(h)?.transpose())?;
        let s = doubling(&a, &g, &h)?;
        let residual = &a * &s + &s * a.transpose() - &s * &g * &s + &h;
        // as a share: an overflow gives NaN, which is no solution
        let solved = residual.norm() / ((a.norm() + (&g * &s).norm()) * s.norm()) < 1e-9;
        let settled = (&s - DMatrix::identity(n, n)).norm() < 1e-6;
        t *= s.cholesky()?.l();
        if settled && solved {
            return Some(t);
        }
    }
    None
}

fn doubling(a: &DMatrix<f64>, g: &DMatrix<f64>, h: &DMatrix<f64>) -> Option<DMatrix<f64>> {
    let n = a.nrows();
    let identity = DMatrix::<f64>::identity(n, n);
    // the iteration is written for AᵀX + XA − XGX + H = 0
    let a = a.transpose();
    // any γ > 0 that is no eigenvalue serves; the scale of the problem is a good one
    let gamma = a.norm().max((g.norm() * h.norm()).sqrt()) * 1.1;
    let shifted = &a - &identity * gamma;
    let shifted_inv = shifted.clone().try_inverse()?;
    let inner = (shifted.transpose() + h * &shifted_inv * g).try_inverse()?;
    let mut e = &identity + inner.transpose() * (2.0 * gamma);
    let mut gk = &shifted_inv * g * &inner * (2.0 * gamma);
    let mut hk = &inner * h * &shifted_inv * (2.0 * gamma);
    for _ in 0..60 {
        let w = (&identity + &gk * &hk).lu();
        let (we, wg) = (w.solve(&e)?, w.solve(&gk)?);
        let step = e.transpose() * &hk * &we;
        gk += &e * wg * e.transpose();
        e = &e * we;
        hk += &step;
        hk = (&hk + hk.transpose()) * 0.5;
        gk = (&gk + gk.transpose()) * 0.5;
        if !hk.iter().all(|x| x.is_finite()) {
            return None;
        }
        if step.norm() <= 1e-15 * hk.norm() {
            return Some(hk);
        }
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::dmatrix;
    use proptest::prelude::*;

    #[test]
    fn a_scalar_equation_has_its_known_root() {
        // 2as − gs² + h = 0
        for (a, g, h) in [(1.0, 2.0, 3.0), (-1.0, 0.5, 1e-6), (0.3, 1e4, 1e-9), (5.0, 1e-6, 1e3)] {
            let s = stabilising(&dmatrix![a], &dmatrix![g], &dmatrix![h]).unwrap()[(0, 0)].powi(2);
            let root: f64 = (a + f64::hypot(a, f64::sqrt(g * h))) / g;
            assert!((s - root).abs() < 1e-9 * root, "{s} {root}");
        }
    }

    #[test]
    fn a_mode_that_is_not_seen_or_not_driven_has_no_solution() {
        let a = dmatrix![0.5, 0.0; 0.0, 0.5];
        let (half, full) = (dmatrix![1.0, 0.0; 0.0, 0.0], DMatrix::identity(2, 2));
        assert!(stabilising(&a, &full, &full).is_some());
        assert!(stabilising(&a, &half, &full).is_none());
        assert!(stabilising(&a, &full, &half).is_none());
    }

    proptest! {
        #[test]
        fn the_residual_vanishes_and_the_filter_is_stable(
            entries in prop::collection::vec(-1.0..1.0_f64, 48), units in prop::array::uniform4(-3.0..3.0_f64),
        ) {
            let m = |k: usize| DMatrix::from_column_slice(4, 4, &entries[16 * k..16 * k + 16]);
            let (g, h) = (m(1) * m(1).transpose(), m(2) * m(2).transpose());
            let d = DMatrix::from_diagonal(&nalgebra::DVector::from_iterator(4, units.iter().map(|u| 10f64.powf(*u))));
            let d_inv = d.clone().try_inverse().unwrap();
            let (a, g, h) = (&d * m(0) * &d_inv, &d_inv * g * &d_inv, &d * h * &d);
            if let Some(t) = stabilising(&a, &g, &h) {
                let s = &t * t.transpose();
                let residual = &a * &s + &s * a.transpose() - &s * &g * &s + &h;
                let scale = |i: usize, j: usize| (s[(i, i)] * s[(j, j)]).sqrt();
                let speed = (&d_inv * &a * &d).norm() + (&d_inv * &s * &g * &d).norm();
                for i in 0..4 {
                    for j in 0..4 {
                        prop_assert!(residual[(i, j)].abs() <= 1e-8 * speed * scale(i, j));
                    }
                }
            } else {
                prop_assert!(false, "no solution");
            }
        }
    }
}
