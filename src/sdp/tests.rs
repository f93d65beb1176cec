//! Problems whose answers are known by other means.

use super::*;
use nalgebra::{DMatrix, DVector, dmatrix};
use proptest::prelude::*;

fn optimal(p: &Problem, s: &Settings) -> Solution {
    match p.solve(s).unwrap() {
        Outcome::Optimal(s) => s,
        other => panic!("expected an optimum, got {other:?}"),
    }
}

fn symmetric(n: usize, entries: &[f64]) -> DMatrix<f64> {
    let m = DMatrix::from_fn(n, n, |i, j| entries[(i * n + j) % entries.len()]);
    (&m + m.transpose()) * 0.5
}

/// A random orthogonal matrix from random entries.
fn orthogonal(n: usize, entries: &[f64]) -> DMatrix<f64> {
    DMatrix::from_fn(n, n, |i, j| entries[(i * n + j) % entries.len()] + if i == j { 0.1 } else { 0.0 }).qr().q()
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
    // max 2·log det X − tr(MX) has the answer X = 2M⁻¹
    let m = dmatrix![2.0, 0.3; 0.3, 0.5];
    let mut p = Problem::new();
    let x = p.symmetric(2);
    p.maximize(-(&m * &x).trace());
    p.maximize_log_det(2.0, &x);
    let s = optimal(&p, &Settings::default());
    let expected = m.clone().try_inverse().unwrap() * 2.0;
    // the objective is flat at its top: the matrix is known to the root of the solver's tolerance
    assert!((s.value(&x) - &expected).amax() < 1e-3);
    assert!((s.objective - (2.0 * expected.determinant().ln() - 4.0)).abs() < 1e-6);
}

#[test]
fn the_off_diagonal_scale_is_right() {
    // svec's √2: max x₁₂ with [1 x; x 1] ⪰ 0 is 1, and the inner product with an off-diagonal matrix counts twice
    let mut p = Problem::new();
    let x = p.symmetric(2);
    p.positive("X", &x);
    p.positive("unit diagonal", Affine::identity(2) - diagonal_of(&x));
    p.maximize((&dmatrix![0.0, 1.0; 1.0, 0.0] * &x).trace());
    let s = optimal(&p, &Settings::default());
    assert!((s.objective - 2.0).abs() < 1e-6);
    assert!((s.value(&x) - DMatrix::from_element(2, 2, 1.0)).amax() < 1e-5);
}

fn diagonal_of(x: &Affine) -> Affine {
    let n = x.shape().0;
    let pick = |i: usize| DMatrix::from_fn(n, n, |r, c| if r == i && c == i { 1.0 } else { 0.0 });
    (0..n).fold(Affine::zeros(n, n), |sum, i| sum + &pick(i) * x * &pick(i))
}

#[test]
fn a_minimum_has_the_users_sign() {
    // the smallest trace of X ⪰ M is the sum of M's eigenvalues, plus a constant
    let m = dmatrix![1.0, 2.0; 2.0, -3.0];
    let mut p = Problem::new();
    let x = p.symmetric(2);
    p.positive("X ⪰ M", &x - Affine::constant(m.clone()));
    p.minimize(x.trace() + Affine::constant(dmatrix![5.0]));
    assert!((optimal(&p, &Settings::default()).objective - (m.trace() + 5.0)).abs() < 1e-6);
}

#[test]
fn a_margin_is_kept() {
    let mut p = Problem::new();
    let x = p.symmetric(2);
    p.positive("X ⪰ I", &x - Affine::identity(2));
    p.positive_by("Y", Affine::block(&[vec![2.0 * &x, x.clone()], vec![x.clone(), x.clone()]]), 1e-3);
    p.minimize(x.trace());
    let s = optimal(&p, &Settings::default());
    assert!(s.margins.iter().any(|(name, m)| name == "Y" && *m >= 1e-3), "{:?}", s.margins);
}

#[test]
fn infeasible_comes_with_multipliers_that_prove_it() {
    // t ≥ 2 and [1 t; t 1] ⪰ 0 contradict each other
    let mut p = Problem::new();
    let t = p.scalar();
    let one = Affine::identity(1);
    p.positive("t ≥ 2", &t - 2.0 * &one);
    p.positive("|t| ≤ 1", Affine::block(&[vec![one.clone(), t.clone()], vec![t.clone(), one.clone()]]));
    p.positive("t ≤ 1000", 1000.0 * &one - &t);
    p.maximize(&t);
    let Outcome::Infeasible(why) = p.solve(&Settings::default()).unwrap() else { panic!() };
    let z = |name: &str| why.multipliers.iter().find(|(n, _)| n == name).unwrap().1.clone();
    // Σ⟨Fᵢ(t), Zᵢ⟩ = (z₁ + 2·z₂₁₂ − z₃)·t + (−2·z₁ + tr Z₂ + 1000·z₃): the first vanishes, the second is negative
    let (z1, z2, z3) = (z("t ≥ 2")[(0, 0)], z("|t| ≤ 1"), z("t ≤ 1000")[(0, 0)]);
    assert!((z1 + 2.0 * z2[(0, 1)] - z3).abs() < 1e-6 * z1);
    assert!(-2.0 * z1 + z2.trace() + 1000.0 * z3 < 0.0);
    assert!(verify::smallest_eigenvalue(&z2) > -1e-9 && z3 > -1e-9);
    assert!(why.to_string().contains("t ≥ 2") && why.gap < 0.0);
}

#[test]
fn unbounded_comes_with_a_direction() {
    let mut p = Problem::new();
    let x = p.symmetric(2);
    p.positive("X ⪰ I", &x - Affine::identity(2));
    p.maximize(x.trace());
    let Outcome::Unbounded(ray) = p.solve(&Settings::default()).unwrap() else { panic!() };
    let d = ray.direction(&x);
    assert!(d.trace() > 0.0 && verify::smallest_eigenvalue(&d) > -1e-6 * d.trace());
    assert!(ray.to_string().contains("grows without end"));
    // a log det without a ceiling
    let mut p = Problem::new();
    let x = p.symmetric(2);
    p.positive("X ⪰ I", &x - Affine::identity(2));
    p.maximize_log_det(1.0, &x);
    assert!(matches!(p.solve(&Settings::default()).unwrap(), Outcome::Unbounded(_) | Outcome::Inaccurate { .. }));
}

#[test]
fn a_solver_that_is_stopped_early_does_not_call_it_optimal() {
    let mut p = Problem::new();
    let x = p.symmetric(3);
    p.positive("X ⪯ I", Affine::identity(3) - &x);
    p.maximize_log_det(1.0, &x);
    let outcome = p.solve(&Settings { max_iterations: 2, ..Settings::default() }).unwrap();
    assert!(matches!(outcome, Outcome::Inaccurate { .. }), "{outcome:?}");
}

#[test]
fn mistakes_are_errors_that_name_the_place() {
    let error = |build: &dyn Fn(&mut Problem)| {
        let mut p = Problem::new();
        build(&mut p);
        p.solve(&Settings::default()).unwrap_err()
    };
    assert_eq!(error(&|_| {}), ProblemError::Empty);
    let shape = error(&|p| {
        let x = p.matrix(2, 3);
        p.positive("sum", &x + x.transpose());
    });
    assert_eq!(shape.to_string(), "`sum`: sum: 2×3 does not fit 3×2");
    let tall = error(&|p| {
        let x = p.matrix(2, 3);
        p.positive("tall", x);
    });
    assert_eq!(tall, ProblemError::NotSquare { name: "tall".into(), rows: 2, cols: 3 });
    let skew = error(&|p| {
        let x = p.matrix(2, 2);
        p.negative("skew", x);
    });
    assert_eq!(skew, ProblemError::NotSymmetric { name: "skew".into() });
    let foreign = error(&|p| {
        let x = Problem::new().symmetric(2);
        p.positive("foreign", x);
    });
    assert_eq!(foreign, ProblemError::ForeignUnknown { name: "foreign".into() });
    let nan = error(&|p| {
        let x = p.symmetric(2);
        p.positive("nan", x + Affine::constant(DMatrix::from_element(2, 2, f64::NAN)));
    });
    assert_eq!(nan, ProblemError::NotFinite { name: "nan".into() });
    let objective = error(&|p| {
        let x = p.symmetric(2);
        p.positive("x", &x);
        p.maximize(x);
    });
    assert_eq!(objective, ProblemError::ObjectiveNotScalar { rows: 2, cols: 2 });
    let weight = error(&|p| {
        let x = p.symmetric(2);
        p.maximize_log_det(-1.0, &x);
    });
    assert_eq!(weight, ProblemError::LogDetWeight(-1.0));
}

/// Rows and unknowns in units that differ by powers of ten.
fn units(exponents: &[f64]) -> DMatrix<f64> {
    DMatrix::from_diagonal(&DVector::from_iterator(exponents.len(), exponents.iter().map(|e| 10f64.powf(*e))))
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    /// max ⟨C, X⟩ with 0 ⪯ X ⪯ I is the sum of C's positive eigenvalues, in whatever units X is written.
    #[test]
    fn a_known_optimum_is_found_in_any_units(
        entries in prop::collection::vec(-1.0..1.0_f64, 25), n in 1usize..=5,
        exponents in prop::collection::vec(-6.0..6.0_f64, 5),
    ) {
        let c = symmetric(n, &entries);
        let expected: f64 = c.clone().symmetric_eigenvalues().iter().filter(|l| **l > 0.0).sum();
        let d = units(&exponents[..n]);
        let d_inv = units(&exponents[..n].iter().map(|e| -e).collect::<Vec<_>>());
        // X = D·X'·D
        let mut p = Problem::new();
        let x = p.symmetric(n);
        p.positive("X ⪰ 0", &x);
        p.positive("X ⪯ D⁻²", Affine::constant(&d_inv * &d_inv) - &x);
        p.maximize((&(&d * &c * &d) * &x).trace());
        let s = optimal(&p, &Settings::default());
        prop_assert!((s.objective - expected).abs() < 1e-5 * (1.0 + expected), "{} {expected}", s.objective);
        // in the units of X, 0 ⪯ X ⪯ I
        let found = &d * s.value(&x) * &d;
        prop_assert!(verify::smallest_eigenvalue(&found) > -1e-6, "{} {n} {exponents:?}", verify::smallest_eigenvalue(&found));
        prop_assert!(verify::smallest_eigenvalue(&(DMatrix::identity(n, n) - found)) > -1e-6);
    }

    /// A primal and a dual point that fit (complementary slackness) make an LMI problem with a known optimum:
    /// max bᵀy, Σ yₖFₖ ⪯ F₀, with F₀ = Σ yₖFₖ + S, bₖ = ⟨Fₖ, Z⟩, SZ = 0.
    #[test]
    fn a_random_problem_with_a_known_answer_is_solved(
        entries in prop::collection::vec(-1.0..1.0_f64, 16 * 5), y in prop::array::uniform3(-2.0..2.0_f64),
        rank in 1usize..4, exponents in prop::array::uniform4(-4.0..4.0_f64),
    ) {
        let n = 4;
        let q = orthogonal(n, &entries[..16]);
        let spread = |from: usize, to: usize| {
            &q * DMatrix::from_fn(n, n, |i, j| if i == j && (from..to).contains(&i) { 1.0 } else { 0.0 }) * q.transpose()
        };
        let (slack, z) = (spread(0, rank), spread(rank, n));
        let f: Vec<DMatrix<f64>> = (1..4).map(|k| symmetric(n, &entries[16 * k..16 * k + 16])).collect();
        let f0 = f.iter().zip(&y).fold(slack, |sum, (f, y)| sum + f * *y);
        let expected: f64 = f.iter().zip(&y).map(|(f, y)| f.dot(&z) * y).sum();
        let d = units(&exponents);
        let mut p = Problem::new();
        let unknowns: Vec<Affine> = (0..3).map(|_| p.scalar()).collect();
        let times = |u: &Affine, f: &DMatrix<f64>| {
            // u·F for a 1×1 u: the sum over columns of (F·eⱼ)·u·eⱼᵀ
            (0..n).fold(Affine::zeros(n, n), |sum, j| {
                let unit = DMatrix::from_fn(1, n, |_, c| if c == j { 1.0 } else { 0.0 });
                sum + &DMatrix::from_fn(n, 1, |i, _| f[(i, j)]) * u * &unit
            })
        };
        let sum = unknowns.iter().zip(&f).fold(Affine::constant(f0), |s, (u, f)| s - times(u, f));
        p.positive("LMI", sum.congruence(&d, &d));
        let objective = unknowns.iter().zip(&f).fold(Affine::zeros(1, 1), |s, (u, f)| s + f.dot(&z) * u);
        p.maximize(objective);
        match p.solve(&Settings::default()).unwrap() {
            Outcome::Optimal(s) => {
                prop_assert!((s.objective - expected).abs() < 1e-4 * (1.0 + expected.abs()), "{} {expected}", s.objective);
            }
            // degenerate draws may stay unsolved, but are not called anything they are not
            Outcome::Inaccurate { .. } => {}
            other => prop_assert!(false, "{other:?}"),
        }
    }

    /// ⟨Fₖ, Z⟩ = 0 for all k and ⟨F₀, Z⟩ < 0 with Z ≻ 0 make Σ yₖFₖ + F₀ ⪰ 0 impossible.
    #[test]
    fn a_random_infeasible_problem_is_never_called_solved(
        entries in prop::collection::vec(-1.0..1.0_f64, 16 * 4), lift in 0.1..3.0_f64,
        exponents in prop::array::uniform4(-3.0..3.0_f64),
    ) {
        let n = 4;
        let half = DMatrix::from_fn(n, n, |i, j| entries[i * n + j]);
        let z = &half * half.transpose() + DMatrix::identity(n, n) * 0.3;
        // shift each matrix along the identity until its product with Z is as wanted
        let with_product = |m: DMatrix<f64>, wanted: f64| {
            let shift = (m.dot(&z) - wanted) / z.trace();
            m - DMatrix::identity(n, n) * shift
        };
        let f: Vec<DMatrix<f64>> = (1..3).map(|k| with_product(symmetric(n, &entries[16 * k..16 * k + 16]), 0.0)).collect();
        let f0 = with_product(symmetric(n, &entries[48..]), -lift);
        let d = units(&exponents);
        let mut p = Problem::new();
        let y = p.matrix(1, 2);
        let term = |k: usize| {
            let pick = DMatrix::from_fn(2, 1, |i, _| if i == k { 1.0 } else { 0.0 });
            let u = &y * &pick;
            (0..n).fold(Affine::zeros(n, n), |sum, j| {
                let row = DMatrix::from_fn(1, n, |_, c| if c == j { 1.0 } else { 0.0 });
                sum + &DMatrix::from_fn(n, 1, |i, _| f[k][(i, j)]) * &u * &row
            })
        };
        p.positive("LMI", (Affine::constant(f0) + term(0) + term(1)).congruence(&d, &d));
        p.maximize(&y * &dmatrix![1.0; 0.5]);
        let outcome = p.solve(&Settings::default()).unwrap();
        prop_assert!(matches!(outcome, Outcome::Infeasible(_) | Outcome::Inaccurate { .. }), "{outcome:?}");
    }
}

/// The smallest t for which `within` holds at a fixed matrix.
fn smallest(m: &DMatrix<f64>, within: impl Fn(&Affine, &Affine) -> Affine) -> f64 {
    let mut p = Problem::new();
    let t = p.scalar();
    p.positive("norm", within(&Affine::constant(m.clone()), &t));
    p.minimize(&t);
    optimal(&p, &Settings::default()).objective
}

#[test]
fn norms_are_what_they_are_called() {
    let m = dmatrix![1.0, -2.0, 0.5; 0.3, 4.0, 1.0];
    let frobenius = m.norm();
    let spectral = m.clone().singular_values().max();
    assert!((smallest(&m, Affine::spectral_norm_within) - spectral).abs() < 1e-6);
    assert!((smallest(&m, Affine::frobenius_norm_within) - frobenius).abs() < 1e-6);
    assert!((smallest(&m, Affine::squares_within) - frobenius.powi(2)).abs() < 1e-5);
    // shapes that do not fit stay faults
    let mut p = Problem::new();
    let t = p.matrix(2, 1);
    p.positive("bound", Affine::constant(m).spectral_norm_within(&t));
    assert!(matches!(p.solve(&Settings::default()), Err(ProblemError::Shape { .. })));
}

#[test]
fn the_centre_of_a_set_is_found_in_any_units() {
    // 0 ⪯ X ⪯ M has its centre at M/2; an interval at its middle
    for unit in [1.0, 1e6, 1e-6] {
        let m = dmatrix![4.0, 1.0; 1.0, 3.0] * unit;
        let mut p = Problem::new();
        let x = p.symmetric(2);
        p.positive("X ⪰ 0", &x);
        p.positive("X ⪯ M", Affine::constant(m.clone()) - &x);
        // an objective does not move it
        p.maximize(x.trace());
        let Outcome::Optimal(s) = p.centre(&Settings::default()).unwrap() else { panic!() };
        // flat at its top, as every log det
        assert!((s.value(&x) - &m * 0.5).amax() < 2e-3 * unit, "{unit} {}", s.value(&x));
    }
    // an open direction has no centre
    let mut p = Problem::new();
    let x = p.scalar();
    p.positive("x ≥ 1", &x - Affine::identity(1));
    assert!(!matches!(p.centre(&Settings::default()).unwrap(), Outcome::Optimal(_)));
}
