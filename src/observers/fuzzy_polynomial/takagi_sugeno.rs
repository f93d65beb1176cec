//! Corollary 1: designs by linear matrix inequalities (20)–(23), on the linear and on the Takagi–Sugeno model.

use super::design::{Design, DesignError, Gain, Method};
use super::plant::{Change, HALF_TURN, MIRROR, Plant};
use super::units::Units;
use crate::sdp::{Affine, LogDet, Problem, Settings, verify};
use nalgebra::DMatrix;

/// Room asked for in each inequality: far above rounding, without visible cost in γ.
pub(super) const MARGIN: f64 = 1e-8;

/// The check below decides, so an answer that the solver calls almost solved is not refused unseen; and a value needs no
/// more digits than the paper prints.
pub(super) const SETTINGS: Settings =
    Settings { log_det: LogDet::Exponential, scaling: true, passes: 3, agreement: 1e-4, max_iterations: 200 };

/// Share of LM-D's γ that is given up. Near its optimum γ hardly depends on the gain, but what the analysis on the
/// polynomial model finds does: the gain in the middle of those that reach γ leaves it the most room.
const GIVEN_UP: f64 = 1e-4;

/// A vertex: rotor momentum u and premises (x₂, x₄) as signs.
type Signs = [f64; 3];

/// Two vertices from which the changes of sign reach all eight.
const SEEDS: [Signs; 2] = [[1.0, 1.0, 1.0], [1.0, 1.0, -1.0]];

const IDENTITY: Change = Change { axes: [1.0; 3] };

/// What is solved for at the optimum, in the plant's own units.
struct Found {
    p: DMatrix<f64>,
    gains: Vec<DMatrix<f64>>,
    gamma: f64,
    /// (τ₁, τ₂).
    multipliers: [f64; 2],
    solve_s: f64,
}

pub(super) fn design(plant: &Plant, method: Method, alpha: f64) -> Result<Design, DesignError> {
    let made = |found: Found| {
        let gains = all_gains(plant, method, &found);
        let margin = judge(plant, method, alpha, &found, &gains)?;
        Ok(Design { method, alpha, gain_bound: found.gamma.sqrt(), gains, p: found.p, margin, solve_s: found.solve_s })
    };
    if method != Method::LinearDesign {
        return made(solve(plant, method, alpha)?);
    }
    let best = solve_linear(plant, alpha, None)?;
    let roomy = solve_linear(plant, alpha, Some(best.gamma * (1.0 + GIVEN_UP)))
        .and_then(|found| made(Found { solve_s: found.solve_s + best.solve_s, ..found }));
    roomy.or_else(|_| made(best))
}

fn model(plant: &Plant, method: Method, [u, x2, x4]: Signs) -> DMatrix<f64> {
    let a = if method == Method::LinearDesign {
        plant.linear(0.0)
    } else {
        plant.takagi_sugeno(u, x2 * plant.premise_speed, x4 * plant.premise_speed)
    };
    DMatrix::from_fn(6, 6, |i, j| a[(i, j)])
}

/// A 6×6 unknown with a block per axis.
pub(super) fn block_diagonal(problem: &mut Problem) -> Affine {
    let blocks: Vec<Affine> = (0..3).map(|_| problem.symmetric(2)).collect();
    let rows: Vec<Vec<Affine>> = (0..3)
        .map(|i| (0..3).map(|j| if i == j { blocks[i].clone() } else { Affine::zeros(2, 2) }).collect())
        .collect();
    Affine::block(&rows)
}

/// A 6×3 unknown with a 2×1 block per axis.
fn block_gain(problem: &mut Problem) -> Affine {
    let blocks: Vec<Affine> = (0..3).map(|_| problem.matrix(2, 1)).collect();
    let rows: Vec<Vec<Affine>> = (0..3)
        .map(|i| (0..3).map(|j| if i == j { blocks[i].clone() } else { Affine::zeros(2, 1) }).collect())
        .collect();
    Affine::block(&rows)
}

/// The plant's matrices in scaled units, or those of one axis.
struct Scaled {
    c: DMatrix<f64>,
    /// D.
    weights: DMatrix<f64>,
    /// T·Q.
    driven: DMatrix<f64>,
    /// σ²·T², with T the units of the state.
    mismatch: Option<DMatrix<f64>>,
    units2: DMatrix<f64>,
    /// e^{−2αT}.
    contracted: f64,
}

impl Scaled {
    fn of(plant: &Plant, units: &Units, alpha: f64, mismatch: bool) -> Self {
        let units2 = units.t() * units.t();
        Self {
            c: units.outputs(),
            weights: units.weights(plant),
            driven: units.rows_from_state(&plant.driven()),
            mismatch: (mismatch && plant.mismatch > 0.0).then(|| &units2 * plant.mismatch.powi(2)),
            units2,
            contracted: (-2.0 * alpha * plant.dt_s).exp(),
        }
    }

    /// The rows and columns of one axis.
    fn axis(&self, axis: usize) -> Self {
        let part = |m: &DMatrix<f64>, at, size| m.view(at, size).into_owned();
        let at = 2 * axis;
        Self {
            c: part(&self.c, (axis, at), (1, 2)),
            weights: part(&self.weights, (at, at), (2, 2)),
            driven: part(&self.driven, (at, axis), (2, 1)),
            mismatch: self.mismatch.as_ref().map(|m| part(m, (at, at), (2, 2))),
            units2: part(&self.units2, (at, at), (2, 2)),
            contracted: self.contracted,
        }
    }

    /// (21), (22) and (23) for a vertex A with H = PL.
    fn require(
        &self,
        problem: &mut Problem,
        a: &DMatrix<f64>,
        p: &Affine,
        h: &Affine,
        gamma: &Affine,
        tau: &[Affine; 2],
    ) {
        let (n, w, v) = (a.nrows(), self.driven.ncols(), self.c.nrows());
        let step = p * a - h * &self.c;
        let kept =
            |corner: Affine, tau: &Affine| self.mismatch.as_ref().map_or(corner.clone(), |m| corner - tau.times(m));
        let mut dissipation = vec![
            vec![kept(p - self.weights.transpose() * &self.weights, &tau[0])],
            vec![step.clone(), p.clone()],
            vec![Affine::zeros(w, n), (p * &self.driven).transpose(), gamma.times_identity(w)],
            vec![Affine::zeros(v, n), -h.transpose(), Affine::zeros(v, w), gamma.times_identity(v)],
        ];
        let mut decay = vec![vec![kept(self.contracted * p, &tau[1])], vec![step.clone(), p.clone()]];
        if self.mismatch.is_some() {
            // the mismatch enters each state in its own unit
            let (none_w, none_v) = (Affine::zeros(n, w), Affine::zeros(n, v));
            dissipation.push(vec![Affine::zeros(n, n), p.clone(), none_w, none_v, tau[0].times(&self.units2)]);
            decay.push(vec![Affine::zeros(n, n), p.clone(), tau[1].times(&self.units2)]);
        }
        problem.positive_by("(21)", Affine::symmetric_block(&dissipation), MARGIN);
        problem.positive_by("(22)", Affine::symmetric_block(&decay), MARGIN);
        problem.positive_by("(23)", step.plus_transpose(), MARGIN);
    }
}

/// L̃ = P̃⁻¹·H̃.
fn gain_of(method: Method, alpha: f64, p: &DMatrix<f64>, h: &DMatrix<f64>) -> Result<DMatrix<f64>, DesignError> {
    let not_verified =
        || DesignError::NotVerified { method: method.name(), alpha, what: "P", margin: verify::margin(p) };
    Ok(p.clone().cholesky().ok_or_else(not_verified)?.solve(h))
}

/// LM-D: nothing couples the axes of the linear model, so each has a program of its own: it minimises γ, or takes the
/// analytic centre at a given one. γ is the largest of three.
fn solve_linear(plant: &Plant, alpha: f64, given: Option<f64>) -> Result<Found, DesignError> {
    let method = Method::LinearDesign;
    let units = Units::of(plant, alpha, 1.0);
    let all = Scaled::of(plant, &units, alpha, false);
    let a = units.matrix(&model(plant, method, [0.0; 3]));
    let d2 = units.weight * units.weight;
    let (mut p, mut l) = (DMatrix::zeros(6, 6), DMatrix::zeros(6, 3));
    let (mut gamma, mut solve_s) = (0.0_f64, 0.0);
    for axis in 0..3 {
        let at = 2 * axis;
        let a = a.view((at, at), (2, 2)).into_owned();
        let mut problem = Problem::new();
        let (p_axis, h) = (problem.symmetric(2), problem.matrix(2, 1));
        let g = given.map_or_else(|| problem.scalar(), |g| Affine::constant(DMatrix::from_element(1, 1, g / d2)));
        let none = [Affine::zeros(1, 1), Affine::zeros(1, 1)];
        all.axis(axis).require(&mut problem, &a, &p_axis, &h, &g, &none);
        let outcome = if given.is_some() {
            problem.centre(&SETTINGS)?
        } else {
            problem.minimize(&g);
            problem.solve(&SETTINGS)?
        };
        let s = outcome.best().map_err(|e| DesignError::refusal(method, alpha, &e))?;
        let found = s.value(&p_axis);
        l.view_mut((at, axis), (2, 1)).copy_from(&gain_of(method, alpha, &found, &s.value(&h))?);
        p.view_mut((at, at), (2, 2)).copy_from(&found);
        gamma = gamma.max(s.value(&g)[(0, 0)]);
        solve_s += s.seconds;
    }
    let gains = vec![units.gain_back(&l)];
    Ok(Found { gains, p: units.lyapunov_back(&p), gamma: gamma * d2, multipliers: [0.0; 2], solve_s })
}

/// TS-8GD, TS-1GD: minimises γ over (20)–(23) at the seeds; the changes of sign give the other vertices.
fn solve(plant: &Plant, method: Method, alpha: f64) -> Result<Found, DesignError> {
    let units = Units::of(plant, alpha, 1.0);
    let scaled = Scaled::of(plant, &units, alpha, true);
    let mut problem = Problem::new();
    let p = block_diagonal(&mut problem);
    let gamma = problem.scalar();
    let tau = match scaled.mismatch {
        Some(_) => [problem.scalar(), problem.scalar()],
        None => [Affine::zeros(1, 1), Affine::zeros(1, 1)],
    };
    let common = (method == Method::OneGain).then(|| block_gain(&mut problem));
    let mut hs = Vec::new();
    for seed in SEEDS {
        let h = common.clone().unwrap_or_else(|| problem.matrix(6, 3));
        scaled.require(&mut problem, &units.matrix(&model(plant, method, seed)), &p, &h, &gamma, &tau);
        hs.push(h);
    }
    problem.minimize(&gamma);
    let s = problem.solve(&SETTINGS)?.best().map_err(|e| DesignError::refusal(method, alpha, &e))?;
    let scaled_p = s.value(&p);
    let gain = |h: &Affine| Ok(units.gain_back(&gain_of(method, alpha, &scaled_p, &s.value(h))?));
    let d2 = units.weight * units.weight;
    Ok(Found {
        gains: hs.iter().map(gain).collect::<Result<_, DesignError>>()?,
        p: units.lyapunov_back(&scaled_p),
        gamma: s.value(&gamma)[(0, 0)] * d2,
        multipliers: tau.map(|t| s.value(&t)[(0, 0)] * d2),
        solve_s: s.seconds,
    })
}

/// Every vertex with its gain.
fn all_gains(plant: &Plant, method: Method, found: &Found) -> Vec<Gain> {
    let gain = |momentum, premises, constant| Gain { momentum, premises, constant, by_speed: Vec::new() };
    if method != Method::EightGains {
        return vec![gain(0.0, None, found.gains[0].clone())];
    }
    let both = Change { axes: [1.0, -1.0, -1.0] };
    let mut all = Vec::new();
    for (&[u, x2, x4], l) in SEEDS.iter().zip(&found.gains) {
        // how each change moves (u, x₂, x₄)
        let images =
            [(IDENTITY, [u, x2, x4]), (HALF_TURN, [u, -x2, -x4]), (MIRROR, [-u, -x2, x4]), (both, [-u, x2, -x4])];
        for (change, [u, x2, x4]) in images {
            let premises = [x2 * plant.premise_speed, x4 * plant.premise_speed];
            all.push(gain(u, Some(premises), change.gain(l)));
        }
    }
    all
}

/// The smallest margin of (20)–(23) over all vertices, in the plant's own units.
fn judge(plant: &Plant, method: Method, alpha: f64, found: &Found, gains: &[Gain]) -> Result<f64, DesignError> {
    let (p, gamma) = (&found.p, found.gamma);
    let [tau1, tau2] = found.multipliers;
    let sigma2 = plant.mismatch * plant.mismatch;
    let (c, d) = (Plant::outputs(), plant.weights());
    let (driven, noise) = (plant.driven(), plant.noise());
    let mut worst = f64::INFINITY;
    let mut see = |what, m: &DMatrix<f64>| {
        let margin = verify::margin(m) - verify::rounding(m.nrows());
        worst = worst.min(margin);
        if margin > 0.0 { Ok(()) } else { Err(DesignError::NotVerified { method: method.name(), alpha, what, margin }) }
    };
    see("(20)", p)?;
    let all: Vec<Signs> = match method {
        Method::LinearDesign => vec![[0.0; 3]],
        _ => (0..8).map(|k| [0, 1, 2].map(|bit| if k >> bit & 1 == 0 { 1.0 } else { -1.0 })).collect(),
    };
    for signs in all {
        let of_vertex = |g: &&Gain| g.premises.is_none_or(|x| [g.momentum, x[0].signum(), x[1].signum()] == signs);
        let missing = || DesignError::NotVerified { method: method.name(), alpha, what: "a vertex", margin: f64::NAN };
        let h = p * &gains.iter().find(of_vertex).ok_or_else(missing)?.constant;
        let step = p * model(plant, method, signs) - &h * &c;
        let mut dissipation = DMatrix::zeros(24, 24);
        let put = |m: &mut DMatrix<f64>, at: (usize, usize), block: &DMatrix<f64>| {
            m.view_mut(at, block.shape()).copy_from(block);
            m.view_mut((at.1, at.0), (block.ncols(), block.nrows())).copy_from(&block.transpose());
        };
        let identity = |n: usize, by: f64| DMatrix::<f64>::identity(n, n) * by;
        put(&mut dissipation, (0, 0), &(p - d.transpose() * &d - identity(6, tau1 * sigma2)));
        put(&mut dissipation, (6, 0), &step);
        put(&mut dissipation, (6, 6), p);
        put(&mut dissipation, (12, 6), &(driven.transpose() * p));
        put(&mut dissipation, (15, 6), &(-noise.transpose() * h.transpose()));
        put(&mut dissipation, (12, 12), &identity(6, gamma));
        put(&mut dissipation, (18, 6), p);
        put(&mut dissipation, (18, 18), &identity(6, tau1));
        let mut decay = DMatrix::zeros(18, 18);
        put(&mut decay, (0, 0), &(p * (-2.0 * alpha * plant.dt_s).exp() - identity(6, tau2 * sigma2)));
        put(&mut decay, (6, 0), &step);
        put(&mut decay, (6, 6), p);
        put(&mut decay, (12, 6), p);
        put(&mut decay, (12, 12), &identity(6, tau2));
        if method == Method::LinearDesign || sigma2 == 0.0 {
            // no mismatch: the last block is not there
            dissipation = dissipation.view((0, 0), (18, 18)).into_owned();
            decay = decay.view((0, 0), (12, 12)).into_owned();
        }
        see("(21)", &dissipation)?;
        see("(22)", &decay)?;
        see("(23)", &(&step + step.transpose()))?;
    }
    Ok(worst)
}
