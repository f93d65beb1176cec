//! The published table and gains.

use super::*;

fn made(method: Method, alpha: f64) -> Design {
    let d = design(&Plant::quanser(), method, alpha, Options::default()).unwrap();
    println!("{} {alpha}: {:.5} margin {:.1e} {:.3} s", method.name(), d.table_value(), d.margin, d.solve_s);
    d
}

/// Both ends of a row; `design all` compares the whole table.
fn compare(method: Method, tolerance: f64) {
    let published = paper::table_2(method);
    for k in [0, 5] {
        let (alpha, published) = (paper::ALPHAS[k], published[k]);
        let value = made(method, alpha).table_value();
        assert!((value / published - 1.0).abs() < tolerance, "{method:?} α = {alpha}: {value}, published {published}");
    }
}

#[test]
fn table_2_linear_design() {
    compare(Method::LinearDesign, 1e-3);
}

/// The gain is not unique, and at its own decay rate it leaves the analysis hardly any room.
#[test]
fn table_2_linear_analysis() {
    compare(Method::LinearAnalysis, 0.03);
}

#[test]
fn table_2_eight_gains() {
    compare(Method::EightGains, 5e-4);
}

#[test]
fn table_2_one_gain() {
    compare(Method::OneGain, 5e-4);
}

#[test]
fn table_2_one_gain_analysis() {
    compare(Method::OneGainAnalysis, 1e-3);
}

#[test]
fn table_2_sums_of_squares() {
    compare(Method::SumsOfSquares, 1e-3);
}

fn entry(d: &Design, vertex: usize, i: usize, j: usize) -> f64 {
    d.gains[vertex].constant[(i, j)]
}

#[test]
fn gains_at_18() {
    let sos = made(Method::SumsOfSquares, 18.0);
    let close = |found: f64, published: f64| assert!((found / published - 1.0).abs() < 5e-3, "{found} {published}");
    for (i, j, published) in [(0, 0, 0.7289), (1, 0, 12.509), (2, 1, 0.7289), (4, 2, 0.8194), (5, 2, 14.2346)] {
        close(entry(&sos, 0, i, j), published);
        close(entry(&sos, 1, i, j), published);
    }
    // the coupling has one sign at one vertex and the other at the other; so has the paper
    for (i, j, published) in [(0, 1, 0.0620), (1, 1, 0.8887), (2, 0, 0.0620), (3, 0, 0.8887)] {
        close(entry(&sos, 0, i, j).abs(), published);
        assert_eq!(entry(&sos, 0, i, j), -entry(&sos, 1, i, j));
    }
    let ts = made(Method::OneGain, 18.0);
    for (i, j, published) in [(0, 0, 1.1624), (1, 0, 51.984), (4, 2, 1.1903), (5, 2, 53.595)] {
        close(entry(&ts, 0, i, j), published);
    }
}

/// Theorem 1's two claims on the plant itself, without polynomials: at random states of the region V falls by e^{−2αT}, and
/// V⁺ − V + |De|² ≤ γ|(w, ν)|².
#[test]
fn the_theorem_holds_at_random_points() {
    use nalgebra::{DMatrix, DVector};
    use rand::{RngExt, SeedableRng, rngs::StdRng};
    let plant = Plant { inertia_kgm2: [0.05, 0.06, 0.1], ..Plant::quanser() };
    let d = design(&plant, Method::SumsOfSquares, 14.0, Options::default()).unwrap();
    let mut rng = StdRng::seed_from_u64(14);
    let mut number = |size: f64| size * rng.random_range(-1.0..1.0);
    let v = |e: &DVector<f64>| e.dot(&(&d.p * e));
    let mut tightest = f64::INFINITY;
    for _ in 0..20_000 {
        let u = number(1.0);
        // speeds and their errors within the ball, angles anywhere
        let mut ball = || loop {
            let s: [f64; 3] = [0, 1, 2].map(|_| number(plant.radius2.sqrt()));
            if s.iter().map(|v| v * v).sum::<f64>() <= plant.radius2 {
                return s;
            }
        };
        let (eta, es) = (ball(), ball());
        let x: [f64; 6] = std::array::from_fn(|i| if i % 2 == 0 { number(0.5) } else { eta[i / 2] });
        let e: [f64; 6] = std::array::from_fn(|i| if i % 2 == 0 { number(0.3) } else { es[i / 2] });
        let estimate: [f64; 6] = std::array::from_fn(|i| x[i] - e[i]);
        let (w, nu) = ([0, 1, 2].map(|_| number(3.0)), [0, 1, 2].map(|_| number(3.0)));
        let gain = d.gain_at(u, [estimate[1], estimate[3], estimate[5]], plant.premise_speed);
        let next = |w: [f64; 3], nu: [f64; 3]| -> DVector<f64> {
            let (a, b) = (plant.step(&x, u), plant.step(&estimate, u));
            let y = DMatrix::from_fn(3, 1, |k, _| e[2 * k] + plant.output[k] * nu[k]);
            let pushed = plant.driven() * DMatrix::from_row_slice(3, 1, &w);
            let corrected = &gain * y;
            DVector::from_fn(6, |i, _| a[i] - b[i] - corrected[i] + pushed[i])
        };
        let e = DVector::from_row_slice(&e);
        let kept = (-2.0 * d.alpha * plant.dt_s).exp();
        let rate = v(&next([0.0; 3], [0.0; 3])) / (kept * v(&e));
        assert!(rate <= 1.0, "V kept {rate} times what it may");
        let weighted = plant.weights() * &e;
        let size: f64 = w.iter().chain(&nu).map(|v| v * v).sum();
        let left = d.gain_bound.powi(2) * size + v(&e) - v(&next(w, nu)) - weighted.norm_squared();
        assert!(left >= 0.0, "{left}");
        tightest = tightest.min(1.0 - rate);
    }
    println!("V fell by at least {tightest:.2e} more than promised");
}

/// A tenth of a second between samples is too long for the decay rate that the others reach.
#[test]
fn any_vehicle_and_sample_time() {
    for (name, dt_s, alpha) in [("arducopter-sitl", 0.008, 5.0), ("px4-x500", 0.02, 5.0), ("px4-x500", 0.1, 2.0)] {
        let plant = Plant::of_vehicle(&crate::vehicle::resolve(name).unwrap(), dt_s);
        let d = design(&plant, Method::SumsOfSquares, alpha, Options::default()).unwrap();
        assert!(d.margin > 0.0 && d.gain_bound.is_finite());
    }
}

#[test]
fn what_cannot_be_is_refused_with_its_reason() {
    let of = |plant: &Plant, method, alpha| design(plant, method, alpha, Options::default()).unwrap_err();
    let plant = Plant::quanser();
    assert!(matches!(of(&plant, Method::SumsOfSquares, -1.0), DesignError::Rate(_)));
    assert!(matches!(of(&plant, Method::OneGain, f64::NAN), DesignError::Rate(_)));
    // a mismatch as large as the state itself leaves nothing to decay
    let blurred = Plant { mismatch: 1.5, ..plant.clone() };
    let refused = of(&blurred, Method::OneGain, 18.0);
    assert!(matches!(refused, DesignError::Infeasible { .. }), "{refused}");
    assert!(refused.to_string().contains("α = 18"), "{refused}");
    // what the mismatch allows is exceeded, and a sample keeps e^{−20} of V
    for (method, alpha) in [(Method::EightGains, 40.0), (Method::LinearDesign, 2000.0), (Method::SumsOfSquares, 2000.0)]
    {
        let refused = of(&plant, method, alpha);
        assert!(matches!(refused, DesignError::Infeasible { .. }), "{refused}");
    }
    let still = Plant { dt_s: f64::NAN, ..plant };
    assert!(matches!(of(&still, Method::SumsOfSquares, 1.0), DesignError::Plant(_)));
}

#[test]
fn other_units_give_the_same_design() {
    // angles in µrad, and inertia in g mm²: gains scale, the bound does not
    let plant = Plant::quanser();
    let heavy = Plant {
        inertia_kgm2: plant.inertia_kgm2.map(|i| i * 1e6),
        rotor_momentum: plant.rotor_momentum * 1e6,
        ..plant.clone()
    };
    let weighted = Plant { weight: plant.weight.map(|w| w.map(|w| w * 1e6)), ..plant.clone() };
    for (other, factor) in [(heavy, 1.0), (weighted, 1e6)] {
        for method in [Method::OneGain, Method::SumsOfSquares] {
            let (a, b) = (made(method, 14.0), design(&other, method, 14.0, Options::default()).unwrap());
            assert!((b.gain_bound / (factor * a.gain_bound) - 1.0).abs() < 1e-3, "{method:?} {}", b.gain_bound);
        }
    }
}

/// Section 5.2: the observers at α = 18 on the experiment, in software. The paper reports .875 and less than .5.
#[test]
fn integral_square_errors_of_the_experiment() {
    let plant = Plant::quanser();
    let designs: Vec<Design> =
        [Method::LinearAnalysis, Method::OneGainAnalysis, Method::SumsOfSquares].map(|m| made(m, 18.0)).to_vec();
    for (name, experiment) in [("printed", rig::Experiment::printed()), ("fast", rig::Experiment::fast())] {
        let record = experiment.record(&plant);
        let ise: Vec<f64> =
            designs.iter().map(|d| integral_square_error(&estimates(&plant, d, &record), &record, 2.0)).collect();
        let (to_linear, to_takagi_sugeno) = (ise[2] / ise[0], ise[2] / ise[1]);
        println!("{name}: {ise:.4?} rad²/s, ratios {to_linear:.3} {to_takagi_sugeno:.3}");
        assert!(to_takagi_sugeno <= 0.5);
        if name == "fast" {
            assert!(to_linear <= 0.9);
        }
    }
}

/// They gain a few per cent at α = 18; the paper saw nothing in it.
#[test]
#[ignore = "takes a minute"]
fn gains_that_depend_on_the_estimate_are_no_worse() {
    let plant = Plant::quanser();
    let constant = made(Method::SumsOfSquares, 18.0);
    let begun = std::time::Instant::now();
    let polynomial = design(&plant, Method::SumsOfSquares, 18.0, Options { polynomial_gains: true }).unwrap();
    println!("{:.4} {:.4} {:?}", polynomial.table_value(), constant.table_value(), begun.elapsed());
    assert!(polynomial.gain_bound <= constant.gain_bound * (1.0 + 1e-3));
    assert_eq!(polynomial.gains[0].by_speed.len(), 3);
}
