use super::certify::Verdict;
use super::flow::square_root;
use super::plant::{projected, volume};
use super::sampled::{Core, DesignError, PartialStep, Prepared, prove_decay, prove_partial};
use crate::sdp::{Affine, Outcome, Problem, Settings, Solution};
use nalgebra::DMatrix;

/// Weight of log det P beside log det X: what the bound on z may lose for the sake of the other states, which would
/// otherwise be free, even unbounded.
const OTHER_STATES: f64 = 0.01;

/// Factors by which an ellipsoid, or a bound, is enlarged in turn until it can be proven between the nodes too.
const ENLARGEMENTS: [f64; 6] = [1.001, 1.003, 1.01, 1.03, 1.06, 1.1];

/// Factors by which the error is made to contract faster than asked, in turn, until the rate asked for can be proven
/// between the nodes too: enlarging the ellipsoid makes no room where the contraction itself is at its limit.
const HASTE: [f64; 4] = [1.0, 1.02, 1.1, 1.3];

/// The numbers of a design whose every part can be proven, and the time in the solver.
pub(super) fn synthesise(prepared: &Prepared<'_>, nodes: &[f64]) -> Result<(Core, f64), DesignError> {
    let (mut core, mut seconds) = proven_decay(prepared, nodes)?;
    for outputs in prepared.subsets() {
        let step = partial_step(prepared, &core, outputs, &mut seconds)?;
        core.partial.push(step);
    }
    Ok((core, seconds))
}

fn proven_decay(prepared: &Prepared<'_>, nodes: &[f64]) -> Result<(Core, f64), DesignError> {
    let mut seconds = 0.0;
    let mut refused = None;
    for haste in HASTE {
        let (mut core, spent) = match decay(prepared, nodes, haste) {
            Ok(solved) => solved,
            // no faster observer exists: what was refused before stays refused
            Err(e) => return Err(refused.unwrap_or(e)),
        };
        seconds += spent;
        match enlarge_until_proven(prepared, &mut core) {
            Ok(()) => return Ok((core, seconds)),
            Err(e) => refused = Some(e),
        }
    }
    Err(refused.unwrap_or(DesignError::Steps))
}

/// Volume of z's ellipsoid at the solver's optimum, before anything is enlarged or proven: for comparing rates.
pub(super) fn volume_at(prepared: &Prepared<'_>, nodes: &[f64]) -> Result<f64, DesignError> {
    let (core, _) = decay(prepared, nodes, 1.0)?;
    let volume = projected(&core.p, &prepared.plant.e1).and_then(|z| volume(&z));
    let not_verified = || DesignError::NotVerified { alpha: prepared.alpha, what: "P_z".into(), margin: 0.0 };
    volume.map(|(volume, _)| volume).ok_or_else(not_verified)
}

/// Largest det X with X ⪯ P_z subject to the step inequality at every node, with one P for all.
///
/// At a node with λ = 1 − e^{−αδ}, Y = PL, Gᵢ from [`Flow::spread`](super::flow::Flow::spread), and multipliers
/// τᵢ, σⱼ ≥ 0 with Στ + Σσ ≤ λ (the S-procedure with one ellipsoid per block):
/// ```text
/// [ (1−λ)P        0           0          ((P+YC)A_d)ᵀ ]
/// [   0         τᵢ·I          0          ((P+YC)Gᵢ)ᵀ  ]  ⪰ 0
/// [   0           0         σⱼ·I           (YVⱼ)ᵀ     ]
/// [ (P+YC)A_d  (P+YC)Gᵢ      YVⱼ             P        ]
/// ```
fn decay(prepared: &Prepared<'_>, nodes: &[f64], haste: f64) -> Result<(Core, f64), DesignError> {
    let alpha = prepared.alpha;
    let (n, outputs) = (prepared.plant.a.nrows(), prepared.plant.c.nrows());
    let e1 = &prepared.plant.e1;
    let mut problem = Problem::new();
    let p = problem.symmetric(n);
    let x = problem.symmetric(e1.nrows());
    problem.positive("P ⪰ E₁ᵀXE₁", &p - &e1.transpose() * &x * e1);
    problem.maximize_log_det(1.0, &x);
    problem.maximize_log_det(OTHER_STATES, &p);
    let mut unknowns = Vec::new();
    for &dt in nodes {
        let lambda = -(-alpha * dt).exp_m1();
        let y = problem.matrix(n, outputs);
        let corrected = &p + &y * &prepared.plant.c;
        let contracted = (-alpha * haste * dt).exp() * &p;
        let mut step = StepInequality::new(&corrected * &prepared.flow.transition(dt), contracted);
        for w in &prepared.process {
            step.add(&mut problem, &corrected * &square_root(&prepared.flow.spread(w, dt)));
        }
        for v in &prepared.output {
            step.add(&mut problem, &y * v);
        }
        let room = Affine::constant(DMatrix::from_element(1, 1, lambda)) - step.weight_sum();
        problem.positive(format!("step of {dt} s"), step.matrix(&p));
        problem.positive(format!("weights at {dt} s"), room);
        unknowns.push((y, step.weights, lambda));
    }
    let solution = match problem.solve(&Settings::default())? {
        Outcome::Optimal(s) => s,
        other => return Err(prepared.refusal(other)),
    };
    let p = solution.value(&p);
    // whatever the solver gave, `frame` refuses a P that is not positive
    let factor = p.clone().cholesky().ok_or(DesignError::NotVerified { alpha, what: "P".into(), margin: 0.0 })?;
    let shares = |weights: &[Affine], lambda: f64| -> Vec<f64> {
        let raw: Vec<f64> = numbers(&solution, weights).map(|w| (w / lambda).max(1e-12)).collect();
        let sum: f64 = raw.iter().sum();
        raw.iter().map(|s| s / sum).collect()
    };
    let core = Core {
        nodes: nodes.to_vec(),
        gains: unknowns.iter().map(|(y, _, _)| factor.solve(&solution.value(y))).collect(),
        shares: unknowns.iter().map(|(_, w, lambda)| shares(w, *lambda)).collect(),
        p,
        partial: Vec::new(),
    };
    Ok((core, solution.seconds))
}

fn numbers<'a>(solution: &'a Solution, scalars: &'a [Affine]) -> impl Iterator<Item = f64> + 'a {
    scalars.iter().map(|w| solution.value(w)[(0, 0)])
}

/// The step inequality while it is put together: one column of blocks for the error and one for each disturbance.
struct StepInequality {
    /// (what the block does to the error, what stands on the diagonal for it).
    columns: Vec<(Affine, Affine)>,
    weights: Vec<Affine>,
}

impl StepInequality {
    fn new(transition: Affine, contracted: Affine) -> Self {
        Self { columns: vec![(transition, contracted)], weights: Vec::new() }
    }

    fn add(&mut self, problem: &mut Problem, effect: Affine) {
        let weight = problem.scalar();
        let size = effect.shape().1;
        self.columns.push((effect, weight.times_identity(size)));
        self.weights.push(weight);
    }

    fn weight_sum(&self) -> Affine {
        self.weights.iter().fold(Affine::zeros(1, 1), |s, w| s + w)
    }

    fn matrix(&self, corner: &Affine) -> Affine {
        let size = |k: usize| self.columns[k].1.shape().0;
        let mut rows: Vec<Vec<Affine>> = Vec::new();
        for (i, (_, diagonal)) in self.columns.iter().enumerate() {
            let left = (0..i).map(|j| Affine::zeros(size(i), size(j)));
            rows.push(left.chain([diagonal.clone()]).collect());
        }
        rows.push(self.columns.iter().map(|(effect, _)| effect.clone()).chain([corner.clone()]).collect());
        Affine::symmetric_block(&rows)
    }
}

/// Enlarges the ellipsoid S = P⁻¹ step by step until the decay law holds at every step length.
///
/// Enlarging S by κ leaves the contraction part of the inequality as it is and shrinks the noise part by κ; so it
/// makes room wherever noise acts.
fn enlarge_until_proven(prepared: &Prepared<'_>, core: &mut Core) -> Result<(), DesignError> {
    let solved = core.p.clone();
    let mut failed_at = 0.0;
    for enlarged in ENLARGEMENTS {
        core.p = &solved / enlarged;
        match prove_decay(prepared, &prepared.frame(&core.p)?, core) {
            (_, Verdict::Proven { .. }) => return Ok(()),
            (_, Verdict::Refuted { dt_s } | Verdict::Open { dt_s }) => failed_at = dt_s,
        }
    }
    Err(DesignError::BetweenNodes { alpha: prepared.alpha, dt_s: failed_at })
}

/// The best step with the outputs of a bit mask: for the given P, the gain that makes the bound at V = 1,
/// growth + offset, smallest at every node.
fn partial_step(
    prepared: &Prepared<'_>,
    core: &Core,
    outputs: u32,
    seconds: &mut f64,
) -> Result<PartialStep, DesignError> {
    let frame = prepared.frame(&core.p)?;
    let (n, all) = (core.p.nrows(), prepared.plant.c.nrows());
    let used: Vec<usize> = (0..all).filter(|j| outputs & (1 << j) != 0).collect();
    let mut best = PartialStep { outputs, gains: vec![], growth: vec![], offset: vec![], weights: vec![] };
    for &dt in &core.nodes {
        // in the frame's coordinates, where P is the identity
        let mut problem = Problem::new();
        let growth = problem.scalar();
        let mut gain = Affine::zeros(n, all);
        if !used.is_empty() {
            let place = DMatrix::from_fn(used.len(), all, |i, j| if used[i] == j { 1.0 } else { 0.0 });
            gain = problem.matrix(n, used.len()) * &place;
        }
        let corrected = Affine::identity(n) + &gain * frame.c();
        let mut step = StepInequality::new(&corrected * &frame.transition(dt), growth.times_identity(n));
        for w in &prepared.process {
            step.add(&mut problem, &corrected * &frame.gain(&square_root(&prepared.flow.spread(w, dt))));
        }
        for v in &prepared.output {
            step.add(&mut problem, &gain * v);
        }
        problem.positive(format!("step of {dt} s"), step.matrix(&Affine::identity(n)));
        problem.minimize(step.weight_sum() + &growth);
        // near-optimal is enough here: the proof below decides
        let solution = match problem.solve(&Settings { passes: 1, ..Settings::default() })? {
            Outcome::Optimal(s) | Outcome::Inaccurate { best: Some(s), .. } => s,
            other => return Err(prepared.refusal(other)),
        };
        *seconds += solution.seconds;
        best.gains.push(frame.gain_back(&solution.value(&gain)));
        best.growth.push(solution.value(&growth)[(0, 0)]);
        best.weights.push(numbers(&solution, &step.weights).map(|w| w.max(1e-12)).collect());
    }
    let mut failed_at = 0.0;
    for enlarged in ENLARGEMENTS {
        let by = |v: &[f64]| v.iter().map(|x| x * enlarged).collect::<Vec<f64>>();
        let weights: Vec<Vec<f64>> = best.weights.iter().map(|w| by(w)).collect();
        let candidate = PartialStep {
            growth: by(&best.growth),
            offset: weights.iter().map(|w| w.iter().sum()).collect(),
            weights,
            ..best.clone()
        };
        match prove_partial(&frame, &core.nodes, &candidate) {
            (_, Verdict::Proven { .. }) => return Ok(candidate),
            (_, Verdict::Refuted { dt_s } | Verdict::Open { dt_s }) => failed_at = dt_s,
        }
    }
    Err(DesignError::BetweenNodes { alpha: prepared.alpha, dt_s: failed_at })
}
