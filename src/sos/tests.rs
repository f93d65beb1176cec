//! Sums of squares whose answers are known by other means.

use super::*;
use crate::sdp::{Affine, Outcome, Problem, Settings, Solution};
use nalgebra::dmatrix;
use proptest::prelude::*;
use std::collections::BTreeSet;

fn solve(p: &Problem) -> Solution {
    match p.solve(&Settings::default()).unwrap() {
        Outcome::Optimal(s) => s,
        other => panic!("expected an optimum, got {other:?}"),
    }
}

fn one() -> Polynomial {
    Polynomial::constant(1.0)
}

/// The largest t with p − t a sum of squares, and the check of the answer.
fn lower_bound(names: &Variables, p: &Polynomial, basis: &[Monomial]) -> (f64, Check) {
    let mut problem = Problem::new();
    let t = problem.scalar();
    let family = Family::from(p) - Family::new(&t, &one());
    let gram = positive(&mut problem, names, "p − t", &family, basis, 0.0).unwrap();
    problem.maximize(&t);
    // the best t leaves the matrix no room: the solver may stop just short of it
    let s = match problem.solve(&Settings::default()).unwrap() {
        Outcome::Optimal(s) | Outcome::Inaccurate { best: Some(s), .. } => s,
        other => panic!("expected an optimum, got {other:?}"),
    };
    (s.objective, check(&gram.value(&s), &(p - &Polynomial::constant(s.objective))))
}

#[test]
fn the_papers_example_is_a_square() {
    // Appendix B of Pitarch and Sala: (z₁ − 4z₂ − 2z₁z₂ + z₁²)²
    let mut names = Variables::new();
    let (a, b) = (names.add("z1"), names.add("z2"));
    let root = &(&a - &b.scaled(4.0)) + &(&(&a * &a) - &(&a * &b).scaled(2.0));
    let (p, all) = (&root * &root, monomials(&[0, 1], 2));
    let support: BTreeSet<Monomial> = p.terms().map(|t| t.0.clone()).collect();
    let basis = reduced(&all, &support);
    // of six monomials the constant and z₂² cannot serve
    assert_eq!((all.len(), basis.len()), (6, 4));
    let (t, _) = lower_bound(&names, &p, &all);
    assert!(t.abs() < 1e-5, "{t}");
}

#[test]
fn a_minimum_is_found_and_proven() {
    // x⁴ − 3x² + x·y + y² − y: known by calculus: ∂y: y = (1 − x)/2; a quartic in x remains
    let mut names = Variables::new();
    let (x, y) = (names.add("x"), names.add("y"));
    let square = &x * &x;
    let p = &(&(&square * &square) - &square.scaled(3.0)) + &(&(&(&x * &y) + &(&y * &y)) - &y);
    let reduced_to_x = |x: f64| p.at(&[x, 0.5 * (1.0 - x)]);
    let expected = (-3000..3000).map(|k| reduced_to_x(f64::from(k) * 1e-3)).fold(f64::INFINITY, f64::min);
    let (t, check) = lower_bound(&names, &p, &monomials(&[0, 1], 2));
    assert!((t - expected).abs() < 1e-4, "{t} {expected}");
    assert!(check.residual < 1e-6, "{check:?}");
}

#[test]
fn a_positive_polynomial_need_not_be_a_sum_of_squares() {
    // Motzkin: p + 0.01 ≥ 0, but p − t is no sum of squares for any t
    let mut names = Variables::new();
    let (x, y) = (names.add("x"), names.add("y"));
    let (xx, yy) = (&x * &x, &y * &y);
    let p = &(&(&(&xx * &xx) * &yy) + &(&(&yy * &yy) * &xx)) - &(&xx * &yy).scaled(3.0);
    let p = &p + &one();
    let mut problem = Problem::new();
    let t = problem.scalar();
    positive(
        &mut problem,
        &names,
        "Motzkin",
        &(Family::from(&p) - Family::new(&t, &one())),
        &monomials(&[0, 1], 3),
        0.0,
    )
    .unwrap();
    problem.positive("t ≥ −1", &t + Affine::identity(1));
    problem.maximize(&t);
    assert!(!matches!(problem.solve(&Settings::default()).unwrap(), Outcome::Optimal(_)));
}

#[test]
fn what_holds_on_a_region_only_needs_its_multiplier() {
    // the smallest x³ on [−1, 2] is −1; without the region there is none
    let mut names = Variables::new();
    let x = names.add("x");
    let cube = &(&x * &x) * &x;
    let interval = &(&x + &one()) * &(&Polynomial::constant(2.0) - &x);
    let mut problem = Problem::new();
    let t = problem.scalar();
    let family = Family::from(&cube) - Family::new(&t, &one());
    let region = [(interval.clone(), monomials(&[0], 1))];
    let local = positive_on(&mut problem, &names, "x³ − t", &family, &region, &monomials(&[0], 2), 1e-9).unwrap();
    problem.maximize(&t);
    let s = solve(&problem);
    assert!((s.objective + 1.0).abs() < 1e-4, "{}", s.objective);
    let check =
        local.certificate(&s).check(&(&cube - &Polynomial::constant(s.objective)), std::slice::from_ref(&interval));
    assert!(check.residual < 1e-6, "{check:?}");
    // and the identity holds as a statement about numbers
    for x in [-1.0, -0.3, 0.0, 1.1, 2.0, 5.0] {
        let forms = |g: &Gram| g.value(&s).iter().map(|(b, m)| form(b, m).at(&[x])).sum::<f64>();
        let right = forms(&local.rest) + forms(&local.multipliers[0]) * interval.at(&[x]);
        assert!((cube.at(&[x]) - s.objective - right).abs() < 1e-4 * (1.0 + x.powi(4)), "{x}");
    }
}

#[test]
fn a_lie_is_found_out() {
    let basis = vec![Monomial::one(), Monomial::variable(0)];
    let mut names = Variables::new();
    let x = names.add("x");
    // 1 + x + x²
    let p = &(&one() + &x) + &(&x * &x);
    let honest = [(basis.clone(), dmatrix![1.0, 0.5; 0.5, 1.0])];
    assert!((check(&honest, &p).margin - 0.5).abs() < 1e-9);
    // another polynomial, a matrix that is not positive, a monomial that the basis cannot make
    assert!(check(&honest, &(&p - &x.scaled(2.0))).margin < 0.0);
    assert!(check(&[(basis.clone(), dmatrix![1.0, 2.0; 2.0, 1.0])], &(&p + &x.scaled(3.0))).margin < 0.0);
    assert_eq!(check(&honest, &(&p + &(&(&x * &x) * &x))).margin, f64::NEG_INFINITY);
}

#[test]
fn a_basis_that_cannot_serve_is_named() {
    let mut names = Variables::new();
    let x = names.add("x");
    let p = Family::from(&(&(&x * &x) * &(&x * &x)));
    let mut problem = Problem::new();
    let error = positive(&mut problem, &names, "quartic", &p, &monomials(&[0], 1), 0.0).unwrap_err();
    assert_eq!(
        error.to_string(),
        "`quartic`: no two monomials of the basis have the product x^4; the basis is too small"
    );
    assert!(matches!(
        positive(&mut problem, &names, "none", &Family::zero(), &[], 0.0),
        Err(SosError::EmptyBasis { .. })
    ));
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    /// A random sum of squares plus one is found to be at least one, in blocks as in one piece, and proven.
    #[test]
    fn random_sums_of_squares_are_recognised(
        coefficients in prop::collection::vec(-1.0..1.0_f64, 12), at in prop::array::uniform2(-2.0..2.0_f64),
    ) {
        let mut names = Variables::new();
        names.group("x", 2);
        let basis = monomials(&[0, 1], 2);
        let square = |c: &[f64]| {
            let root = basis.iter().zip(c).fold(Polynomial::zero(), |sum, (m, c)| &sum + &Polynomial::from(m.clone()).scaled(*c));
            &root * &root
        };
        let p = basis.iter().fold(&square(&coefficients[..6]) + &square(&coefficients[6..]), |sum, m| {
            &sum + &(&Polynomial::from(m.clone()) * &Polynomial::from(m.clone()))
        });
        let mut problem = Problem::new();
        let gram = positive(&mut problem, &names, "p", &Family::from(&p), &basis, 1e-6).unwrap();
        let Outcome::Optimal(s) = problem.solve(&Settings::default()).unwrap() else { panic!() };
        let check = check(&gram.value(&s), &p);
        prop_assert!(check.margin > 0.0, "{check:?}");
        let value: f64 = gram.value(&s).iter().map(|(b, m)| form(b, m).at(&at)).sum();
        prop_assert!((value - p.at(&at)).abs() < 1e-8 * (1.0 + p.at(&at)));
    }
}
