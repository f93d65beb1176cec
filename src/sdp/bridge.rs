//! The only file that knows Clarabel: its sign, its triangle order, its √2, its cones and its words for an outcome.
//!
//! Clarabel minimises qᵀv subject to Av + s = b, s ∈ K. With v = (x̃, helpers), x = c·x̃:
//! - F(x) ⪰ margin: s is the packed upper triangle, column by column, of D·F(x)·D − margin·I, off-diagonal entries
//!   times √2 so that the inner product of packed vectors is that of the matrices. Hence A = −(coefficients),
//!   b = constant. A 1×1 block is a nonnegative number.
//! - log det X ≥ Σ log zᵢᵢ: for lower triangular Z, [DXD, Z; Zᵀ, diag Z] ⪰ 0 gives det DXD ≥ Π zᵢᵢ, with equality for
//!   the factor of DXD. Clarabel's exponential cone holds (a, b, c) with b·e^{a/b} ≤ c: (tᵢ, 1, zᵢᵢ) means
//!   tᵢ ≤ log zᵢᵢ. The power cone holds Π zᵢᵢ^{1/n} ≥ |t|.

use super::problem::{LogDet, Problem, ProblemError, Settings, packed};
use super::scaling::Scales;
use clarabel::algebra::CscMatrix;
use clarabel::solver::{
    DefaultSettingsBuilder, DefaultSolver, IPSolver, SolverStatus,
    SupportedConeT::{self, ExponentialConeT, GenPowerConeT, NonnegativeConeT, PSDTriangleConeT},
};
use nalgebra::DMatrix;
use std::f64::consts::{FRAC_1_SQRT_2, SQRT_2};

/// The solver's word for what it found.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Status {
    Solved,
    PrimalInfeasible,
    DualInfeasible,
    Stopped(String),
}

/// The solver's answer in the problem's own units.
#[derive(Debug, Clone)]
pub(super) struct Raw {
    pub(super) status: Status,
    pub(super) x: Vec<f64>,
    /// The multiplier of each block, in the order of [`Problem::blocks`].
    pub(super) duals: Vec<DMatrix<f64>>,
    /// What each block's margin takes from ⟨F(x), Z⟩: margin·tr Z in the scaled units in which it is asked for.
    pub(super) margin_pulls: Vec<f64>,
    /// The size that the scaling takes each unknown to have.
    pub(super) units: Vec<f64>,
    pub(super) iterations: u32,
    pub(super) seconds: f64,
}

/// Rows of A and b as they are written down.
#[derive(Default)]
struct Rows {
    row: Vec<usize>,
    col: Vec<usize>,
    val: Vec<f64>,
    b: Vec<f64>,
    cones: Vec<SupportedConeT<f64>>,
}

impl Rows {
    fn entry(&mut self, row: usize, col: usize, val: f64) {
        self.row.push(row);
        self.col.push(col);
        self.val.push(val);
    }

    /// Opens a PSD block of order n and gives its first row.
    fn open_block(&mut self, n: usize) -> usize {
        let first = self.b.len();
        self.b.resize(first + n * (n + 1) / 2, 0.0);
        self.cones.push(if n == 1 { NonnegativeConeT(1) } else { PSDTriangleConeT(n) });
        first
    }
}

/// Where a block's packed triangle starts, its order and its margin.
struct Start {
    first: usize,
    n: usize,
    margin: f64,
}

/// Weight of an entry in the packed triangle.
fn weight(i: usize, j: usize) -> f64 {
    if i == j { 1.0 } else { SQRT_2 }
}

pub(super) fn solve(problem: &Problem, scales: &Scales, settings: &Settings) -> Result<Raw, ProblemError> {
    #[cfg(not(feature = "system-openblas"))]
    super::lapack::keep_linked();

    let objective = problem.objective();
    let unknowns = problem.unknown_count();
    let c = &scales.unknowns;
    let mut rows = Rows::default();
    let mut starts = Vec::new();

    for (k, (_, expr)) in problem.blocks().enumerate() {
        let n = expr.shape().0;
        let d = &scales.blocks[k];
        let constraint = problem.constraints().get(k);
        let margin = constraint.map_or(0.0, |c| c.margin);
        // a log det's block holds twice the rows; its upper left corner is packed in the same places
        let first = rows.open_block(if constraint.is_some() { n } else { 2 * n });
        starts.push(Start { first, n, margin });
        for j in 0..n {
            for i in 0..=j {
                let shift = if i == j { margin } else { 0.0 };
                // the mean of the two sides: they may differ by rounding
                let v = 0.5 * (expr.constant_part()[(i, j)] + expr.constant_part()[(j, i)]);
                rows.b[first + packed(i, j)] = weight(i, j) * (v * d[i] * d[j] - shift);
            }
        }
        for (&u, f) in expr.terms() {
            for (&(i, j), &v) in f {
                if i <= j {
                    rows.entry(first + packed(i, j), u, -weight(i, j) * v * d[i] * d[j] * c[u]);
                }
            }
        }
    }

    let mut q = vec![0.0; unknowns];
    for (&k, v) in &objective.linear {
        q[k] = -v * c[k];
    }
    let single = objective.linear.is_empty() && objective.log_dets.len() == 1;
    for ((log_weight, _), &Start { first, n, .. }) in
        objective.log_dets.iter().zip(&starts[problem.constraints().len()..])
    {
        let helpers = q.len();
        let z = |i: usize, j: usize| helpers + packed(j, i); // i ≥ j
        let t = helpers + n * (n + 1) / 2;
        q.resize(t, 0.0);
        for i in 0..n {
            for j in 0..=i {
                rows.entry(first + packed(i, n + j), z(i, j), -SQRT_2);
            }
            rows.entry(first + packed(n + i, n + i), z(i, i), -1.0);
        }
        let next = rows.b.len();
        if settings.log_det == LogDet::GeometricMean && single {
            q.push(-1.0);
            for i in 0..n {
                rows.entry(next + i, z(i, i), -1.0);
            }
            rows.entry(next + n, t, -1.0);
            rows.b.resize(next + n + 1, 0.0);
            rows.cones.push(GenPowerConeT(vec![1.0 / n as f64; n], 1));
        } else {
            q.resize(t + n, -log_weight);
            for i in 0..n {
                rows.entry(next + 3 * i, t + i, -1.0);
                rows.entry(next + 3 * i + 2, z(i, i), -1.0);
                rows.b.extend([0.0, 1.0, 0.0]);
                rows.cones.push(ExponentialConeT());
            }
        }
    }
    // the solver's gap has an absolute tolerance: the objective must not be tiny in its eyes
    let largest = q.iter().fold(0.0, |m: f64, v| m.max(v.abs()));
    if largest > 0.0 {
        q.iter_mut().for_each(|v| *v /= largest);
    }
    run(q, rows, scales, &starts, settings)
}

fn run(q: Vec<f64>, rows: Rows, scales: &Scales, starts: &[Start], settings: &Settings) -> Result<Raw, ProblemError> {
    let refused = |e: &dyn std::fmt::Display| ProblemError::Solver(e.to_string());
    let (m, n) = (rows.b.len(), q.len());
    let a = CscMatrix::new_from_triplets(m, n, rows.row, rows.col, rows.val);
    let p = CscMatrix::zeros((n, n));
    let options = DefaultSettingsBuilder::default()
        .verbose(false)
        .presolve_enable(false)
        .chordal_decomposition_enable(false)
        .max_iter(settings.max_iterations)
        .build()
        .map_err(|e| refused(&e))?;
    let mut solver = DefaultSolver::new(&p, &q, &a, &rows.b, &rows.cones, options).map_err(|e| refused(&e))?;
    // Clarabel panics when a factorisation meets a number that is not finite: that is an answer, not a crash
    let ended = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| solver.solve()));
    let status = match (ended, solver.solution.status) {
        (Err(_), _) => Status::Stopped("numerical breakdown".into()),
        (_, SolverStatus::Solved) => Status::Solved,
        (_, SolverStatus::PrimalInfeasible) => Status::PrimalInfeasible,
        (_, SolverStatus::DualInfeasible) => Status::DualInfeasible,
        (_, other) => Status::Stopped(format!("{other:?}")),
    };
    let x = scales.unknowns.iter().zip(&solver.solution.x).map(|(c, x)| c * x).collect();
    let dual = |at: usize| solver.solution.z.get(at).copied().unwrap_or(0.0);
    let duals = starts
        .iter()
        .zip(&scales.blocks)
        .map(|(&Start { first, n, .. }, d)| {
            DMatrix::from_fn(n, n, |i, j| {
                dual(first + packed(i.min(j), i.max(j))) * d[i] * d[j] * if i == j { 1.0 } else { FRAC_1_SQRT_2 }
            })
        })
        .collect();
    let trace = |s: &Start| (0..s.n).map(|i| dual(s.first + packed(i, i))).sum::<f64>();
    let margin_pulls = starts.iter().map(|s| s.margin * trace(s)).collect();
    Ok(Raw {
        status,
        x,
        duals,
        margin_pulls,
        units: scales.unknowns.clone(),
        iterations: solver.solution.iterations,
        seconds: solver.solution.solve_time,
    })
}
