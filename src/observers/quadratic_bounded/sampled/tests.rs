use super::*;
use crate::observers::quadratic_bounded::NoiseBlock;
use crate::observers::quadratic_bounded::flow::square_root;
use nalgebra::dmatrix;
use proptest::prelude::*;

const INPUT: f64 = 0.5;
const RATE: f64 = 10.0;
const MOMENTUM: f64 = 0.3;
const FORCE: f64 = 1.5;

/// One axis of the online observer: ṗ = u + d + w, ḋ = η; p and d measured.
fn axis() -> SampledPlant {
    SampledPlant {
        a: dmatrix![0.0, 1.0; 0.0, 0.0],
        process: vec![NoiseBlock::scalar(2, 0, INPUT), NoiseBlock::scalar(2, 1, RATE)],
        c: dmatrix![1.0, 0.0; 0.0, 1.0],
        output: vec![NoiseBlock::scalar(2, 0, MOMENTUM), NoiseBlock::scalar(2, 1, FORCE)],
        e1: dmatrix![0.0, 1.0],
    }
}

fn design() -> SampledDesign {
    design_sampled(&axis(), 4.0, &step_nodes(0.004, 0.1, 8)).unwrap()
}

fn level(d: &SampledDesign, e: &DMatrix<f64>) -> f64 {
    (e.transpose() * &d.p * e)[(0, 0)]
}

/// Error after one step with the outputs of a mask; `held` are the disturbances (w, η) in equal parts of the step.
fn step(d: &SampledDesign, e: &DMatrix<f64>, dt: f64, mask: u32, held: &[[f64; 2]], v: [f64; 2]) -> DMatrix<f64> {
    let mut e = e.clone();
    let h = dt / held.len() as f64;
    for [w, eta] in held {
        let (p, f) = (e[(0, 0)], e[(1, 0)]);
        e = dmatrix![p + h * (f + INPUT * w) + 0.5 * h * h * RATE * eta; f + h * RATE * eta];
    }
    let mut gain = DMatrix::zeros(2, 2);
    d.partial_gain_at(mask, dt, &mut gain);
    let v = dmatrix![MOMENTUM * v[0]; FORCE * v[1]];
    &e + &gain * (&d.c * &e + v)
}

#[test]
fn an_axis_is_designed_and_proven() {
    let d = design();
    assert_eq!(d.certificate.coverage, Coverage::Proven);
    assert!(d.certificate.margin > 0.0);
    // the force is known better than its own measurement's worst case times a few, and the momentum too
    assert!(d.half_widths[1] < 3.2 && d.half_widths[0] < 4.0, "{:?}", d.half_widths);
    assert!((d.volume - 2.0 * d.half_widths[1]).abs() < 1e-9, "z is d alone");
    assert_eq!(d.partial.len(), 3);
}

/// The step inequality in the published block form, at nodes and between them, by its own eigenvalues.
#[test]
fn the_block_inequality_holds_at_nodes_and_between_them() {
    let (d, plant) = (design(), axis());
    let flow = Flow::new(&plant.a);
    for k in 0..=200 {
        let dt = 0.004 + (0.1 - 0.004) * k as f64 / 200.0;
        let (i, next, s) = d.locate(dt);
        let mut gain = DMatrix::zeros(2, 2);
        d.gain_at(dt, &mut gain);
        let lambda = 1.0 - (-d.alpha * dt).exp();
        let weights: Vec<f64> =
            d.shares[i].iter().zip(&d.shares[next]).map(|(a, b)| lambda * (a + s * (b - a))).collect();
        assert!(weights.iter().sum::<f64>() <= lambda * (1.0 + 1e-12));
        let corrected = &d.p * (DMatrix::identity(2, 2) + &gain * &plant.c);
        let mut effects = vec![(&corrected * flow.transition(dt), None)];
        let (process, output) = plant.units().unwrap();
        for (w, weight) in process.iter().zip(&weights) {
            effects.push((&corrected * square_root(&flow.spread(w, dt)), Some(*weight)));
        }
        for (v, weight) in output.iter().zip(&weights[process.len()..]) {
            effects.push((&d.p * &gain * v, Some(*weight)));
        }
        let size: usize = effects.iter().map(|(e, _)| e.ncols()).sum();
        let mut m = DMatrix::zeros(size + 2, size + 2);
        m.view_mut((size, size), (2, 2)).copy_from(&d.p);
        let mut at = 0;
        for (effect, weight) in &effects {
            let c = effect.ncols();
            let block = weight.map_or_else(|| &d.p * (1.0 - lambda), |w| DMatrix::identity(c, c) * w);
            m.view_mut((at, at), (c, c)).copy_from(&block);
            m.view_mut((size, at), (2, c)).copy_from(effect);
            m.view_mut((at, size), (c, 2)).copy_from(&effect.transpose());
            at += c;
        }
        assert!(verify::margin(&m) > -1e-10, "{dt}: {}", verify::margin(&m));
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(12))]
    /// Whatever bounded disturbances do between the samples, the level stays below its promise; an adversary who
    /// looks one step ahead comes near it.
    #[test]
    fn no_trajectory_breaks_the_promise(
        seed in any::<u64>(), parts in 1usize..6, e0 in prop::array::uniform2(-20.0..20.0_f64), greedy in any::<bool>(),
    ) {
        use rand::{RngExt, SeedableRng, rngs::StdRng};
        let mut rng = StdRng::seed_from_u64(seed);
        let d = design();
        let mut e = dmatrix![e0[0]; e0[1]];
        let mut bound = level(&d, &e);
        let mut sign = move || if rng.random::<bool>() { 1.0 } else { -1.0 };
        let mut clock = StdRng::seed_from_u64(!seed);
        for _ in 0..3000 {
            let dt = clock.random_range(0.004..=0.1);
            // now and then an output is missing
            let mask = if clock.random_range(0..10) == 0 { clock.random_range(0..3) } else { 3 };
            let tries = if greedy { 16 } else { 1 };
            let next = (0..tries)
                .map(|_| {
                    let held: Vec<[f64; 2]> = if greedy {
                        vec![[sign(), sign()]; parts]
                    } else {
                        (0..parts).map(|_| [sign(), sign()]).collect()
                    };
                    step(&d, &e, dt, mask, &held, [sign(), sign()])
                })
                .max_by(|a, b| level(&d, a).total_cmp(&level(&d, b)))
                .unwrap();
            let (growth, offset) = d.partial_growth(mask, dt);
            prop_assert!(level(&d, &next) <= growth * level(&d, &e) + offset + 1e-9);
            bound = growth * bound + offset;
            e = next;
            prop_assert!(level(&d, &e) <= bound + 1e-9, "{} > {bound}", level(&d, &e));
        }
    }
}

#[test]
fn the_promise_is_not_idle() {
    // the force measurement is off by its worst for good, the momentum too: the error settles at a level that a
    // bound ten times as wide would not notice
    let d = design();
    let mut e = dmatrix![0.0; 0.0];
    let mut worst: f64 = 0.0;
    for k in 0..4000 {
        let turn = if (k / 40) % 2 == 0 { 1.0 } else { -1.0 };
        e = step(&d, &e, 0.1, 3, &[[turn, turn]], [-turn, -turn]);
        worst = worst.max(level(&d, &e));
    }
    assert!(worst > 0.1, "{worst}");
}

#[test]
fn a_prediction_covers_any_gap() {
    let d = design();
    assert_eq!(d.prediction_growth(0.0), (1.0, 0.0));
    assert!(d.prediction_growth(f64::NAN).0.is_infinite() && d.prediction_growth(1e9).1.is_infinite());
    for gap in [0.0005, 0.002, 0.01, 0.05, 0.1, 0.17, 0.63, 2.0] {
        let (growth, offset) = d.prediction_growth(gap);
        for turn in 0..64 {
            let angle = turn as f64 * 0.1;
            let e = d.p_inv.clone().cholesky().unwrap().l() * dmatrix![angle.cos(); angle.sin()];
            for signs in [[1.0, 1.0], [1.0, -1.0], [-1.0, 1.0], [-1.0, -1.0]] {
                let moved = dmatrix![
                    e[(0, 0)] + gap * (e[(1, 0)] + INPUT * signs[0]) + 0.5 * gap * gap * RATE * signs[1];
                    e[(1, 0)] + gap * RATE * signs[1]
                ];
                assert!(level(&d, &moved) <= growth + offset, "{gap}");
            }
        }
    }
}

#[test]
fn units_do_not_matter() {
    let reference = design();
    // momentum in mN·s, force in kN
    let d = dmatrix![1e3, 0.0; 0.0, 1e-3];
    let d_inv = dmatrix![1e-3, 0.0; 0.0, 1e3];
    let plant = axis();
    let blocks = |b: &[NoiseBlock]| b.iter().map(|b| NoiseBlock { w: &d * &b.w, q: b.q.clone() }).collect();
    let scaled = SampledPlant {
        a: &d * &plant.a * &d_inv,
        process: blocks(&plant.process),
        c: DMatrix::identity(2, 2),
        output: blocks(&plant.output),
        e1: dmatrix![0.0, 1.0],
    };
    let other = design_sampled(&scaled, 4.0, &reference.dt_s).unwrap();
    assert!((other.half_widths[1] * 1e3 / reference.half_widths[1] - 1.0).abs() < 1e-3);
    assert!((other.half_widths[0] / 1e3 / reference.half_widths[0] - 1.0).abs() < 0.02);
}

#[test]
fn a_rate_is_chosen_from_a_list() {
    let rates = [1.0, 4.0, 16.0, 64.0];
    let (tight, front) = choose_rate(&axis(), &rates, &step_nodes(0.01, 0.05, 3), 1.0).unwrap();
    assert_eq!(front.len(), rates.len());
    let least = front.iter().map(|p| p.1).fold(f64::INFINITY, f64::min);
    assert!(front.contains(&(tight, least)));
    assert_eq!(choose_rate(&axis(), &rates, &step_nodes(0.01, 0.05, 3), 0.0).unwrap().0, 64.0);
}

#[test]
fn a_chain_of_three_is_designed() {
    let plant = SampledPlant {
        a: dmatrix![0.0, 1.0, 0.0; 0.0, 0.0, 1.0; 0.0, 0.0, 0.0],
        process: vec![NoiseBlock::scalar(3, 0, INPUT), NoiseBlock::scalar(3, 2, 30.0)],
        c: dmatrix![1.0, 0.0, 0.0; 0.0, 1.0, 0.0],
        output: vec![NoiseBlock::scalar(2, 0, MOMENTUM), NoiseBlock::scalar(2, 1, FORCE)],
        e1: dmatrix![0.0, 1.0, 0.0],
    };
    let d = design_sampled(&plant, 3.0, &step_nodes(0.01, 0.05, 5)).unwrap();
    assert_eq!(d.certificate.coverage, Coverage::Proven);
}

#[test]
fn a_plant_with_decay_is_checked_on_a_grid() {
    // ṗ = d − p/τ: not nilpotent
    let plant = SampledPlant { a: dmatrix![-2.0, 1.0; 0.0, 0.0], ..axis() };
    let d = design_sampled(&plant, 2.0, &step_nodes(0.01, 0.05, 4)).unwrap();
    assert_eq!(d.certificate.coverage, Coverage::CheckedOnAGrid);
}

#[test]
fn what_cannot_be_designed_says_why() {
    let nodes = step_nodes(0.01, 0.05, 3);
    // force alone says nothing about momentum
    let blind = SampledPlant {
        c: dmatrix![0.0, 1.0],
        output: vec![NoiseBlock::scalar(1, 0, FORCE)],
        e1: DMatrix::identity(2, 2),
        ..axis()
    };
    let error = design_sampled(&blind, 1.0, &nodes).unwrap_err();
    assert!(matches!(error, DesignError::Infeasible { .. }), "{error}");
    assert_eq!(design_sampled(&axis(), -1.0, &nodes), Err(DesignError::Rate(-1.0)));
    assert_eq!(design_sampled(&axis(), 1.0, &[]), Err(DesignError::Steps));
    assert_eq!(design_sampled(&axis(), 1.0, &[0.02, 0.01]), Err(DesignError::Steps));
    let misfit = SampledPlant { e1: dmatrix![1.0], ..axis() };
    assert!(matches!(design_sampled(&misfit, 1.0, &nodes), Err(DesignError::Plant(_))));
}
