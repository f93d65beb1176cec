//! Problems whose answers are known by other means.

use super::*;
use nalgebra::dmatrix;

fn optimal(p: &Problem, s: &Settings) -> Solution {
    match p.solve(s).unwrap() {
        Outcome::Optimal(s) => s,
        other => panic!("expected an optimum, got {other:?}"),
    }
}

#[test]
fn the_largest_determinant_below_a_matrix_is_its_own() {
    // max log det X, X ⪯ M has the answer X = M
    let m = dmatrix![4.0, 1.0, 0.2; 1.0, 3.0, -0.5; 0.2, -0.5, 2.0];
    for log_det in [LogDet::Exponential, LogDet::GeometricMean] {
        let mut p = Problem::new();
        let x = p.symmetric(3);
        p.positive("X ⪯ M", Affine::constant(m.clone()) - &x);
        p.maximize_log_det(1.0, &x);
        let s = optimal(&p, &Settings { log_det, ..Settings::default() });
        assert!((s.objective - m.determinant().ln()).abs() < 1e-6, "{log_det:?}");
        assert!((s.value(&x) - &m).amax() < 1e-4);
    }
}

#[test]
fn a_log_det_and_a_linear_term_add_up() {
    // max log det X − tr(MX) has the answer X = M⁻¹
    let m = dmatrix![2.0, 0.3; 0.3, 0.5];
    let mut p = Problem::new();
    let x = p.symmetric(2);
    let product = &m * &x;
    let trace = dmatrix![1.0, 0.0] * 1.0;
    let t = &trace * &product * &trace.transpose() + &dmatrix![0.0, 1.0] * &product * &dmatrix![0.0; 1.0];
    p.maximize(-t);
    p.maximize_log_det(1.0, &x);
    let s = optimal(&p, &Settings::default());
    assert!((s.value(&x) - m.clone().try_inverse().unwrap()).amax() < 1e-4);
    assert!((s.objective - (-m.determinant().ln() - 2.0)).abs() < 1e-6);
}
