//! Proof that one step of the sampled observer keeps its promise at every step length, not only at the design's nodes.
//!
//! In coordinates R·e, with P = RᵀR, a step of length δ is e⁺ = F·e + M·Σxᵢ + L·Σvⱼ with M = I + L·C, F = M·e^{Aδ}, the xᵢ in
//! the ellipsoids of Sᵢ(δ), the vⱼ in those of VⱼVⱼᵀ. With weights g, τᵢ, σⱼ > 0,
//!
//! ```text
//! N(δ) = I − F·Fᵀ/g − Σ M·Sᵢ·Mᵀ/τᵢ − Σ L·VⱼVⱼᵀ·Lᵀ/σⱼ ⪰ 0   implies   V(e⁺) ≤ g·V(e) + Στᵢ + Σσⱼ:
//! ```
//!
//! stack F/√g, M·Gᵢ/√τᵢ, L·Vⱼ/√σⱼ to a matrix K; N ⪰ 0 says ‖K‖ ≤ 1, so |e⁺|² ≤ |(√g·e, √τᵢ·ζᵢ, √σⱼ·ξⱼ)|².
//!
//! Between two nodes the gain and the weights run linearly in δ, so N is smooth. For every unit vector z,
//! zᵀN(δ)z ≥ (its linear interpolation between the ends of a cell) − (width²/8)·sup|zᵀN″z|. `Jet` encloses N″ over the
//! cell, so a cell is proven when the smaller of the ends' smallest eigenvalues exceeds width²/8·‖N″‖; else it is
//! halved.

use super::flow::{Flow, Polynomials};
use super::jet::{Jet, JetMatrix};
use super::plant::over;
use crate::sdp::verify;
use crate::sets::Interval;
use nalgebra::DMatrix;

/// What rounding may cost outside the enclosures: in the coefficients of the polynomials, in R⁻¹, and in N at single
/// step lengths, all of whose terms are at most one.
const SLACK: f64 = 1e-10;

/// Cells smaller than this share of a node gap are given up.
const SMALLEST_CELL: f64 = 1.0 / 4096.0;

/// Points between two nodes at which a step without polynomials is checked.
const GRID: usize = 32;

/// How far a statement about all step lengths has been checked.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Coverage {
    /// Proven for every step length from the first node to the last.
    Proven,
    /// Checked at many step lengths between the nodes: A is not nilpotent, so there is no polynomial to enclose.
    CheckedOnAGrid,
}

/// How g depends on the step length between two nodes.
#[derive(Debug, Clone, Copy)]
pub(super) enum Growth {
    /// g = e^{−αδ}, and the weights are shares of 1 − e^{−αδ}.
    Decay { alpha: f64 },
    /// g and the weights run linearly between their values at the nodes.
    Linear,
}

/// A step at one node, in a frame's coordinates.
#[derive(Debug, Clone)]
pub(super) struct Node {
    pub(super) dt_s: f64,
    /// R·L.
    pub(super) gain: DMatrix<f64>,
    /// g at this node (unused for [`Growth::Decay`]).
    pub(super) growth: f64,
    /// τᵢ, then σⱼ; shares of λ for [`Growth::Decay`].
    pub(super) weights: Vec<f64>,
}

/// What a proof found.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Verdict {
    /// N ⪰ margin·I at every step length between the nodes.
    Proven { margin: f64 },
    /// N is not positive at this step length.
    Refuted { dt_s: f64 },
    /// Neither, within the smallest cell.
    Open { dt_s: f64 },
}

/// A plant in the coordinates R·e of an ellipsoid P = RᵀR.
#[derive(Debug)]
pub(super) struct Frame<'a> {
    flow: &'a Flow,
    process: &'a [DMatrix<f64>],
    output: &'a [DMatrix<f64>],
    r: DMatrix<f64>,
    r_inv: DMatrix<f64>,
    /// C·R⁻¹.
    c: DMatrix<f64>,
}

impl<'a> Frame<'a> {
    /// `None` when P is not positive definite.
    pub(super) fn new(
        p: &DMatrix<f64>,
        flow: &'a Flow,
        c: &DMatrix<f64>,
        process: &'a [DMatrix<f64>],
        output: &'a [DMatrix<f64>],
    ) -> Option<Self> {
        let r = p.clone().cholesky()?.l().transpose();
        let r_inv = over(&DMatrix::identity(p.nrows(), p.nrows()), &r);
        Some(Self { flow, process, output, c: c * &r_inv, r, r_inv })
    }

    pub(super) fn c(&self) -> &DMatrix<f64> {
        &self.c
    }

    /// R·m: a gain, or what drives the state, in these coordinates.
    pub(super) fn gain(&self, m: &DMatrix<f64>) -> DMatrix<f64> {
        &self.r * m
    }

    pub(super) fn gain_back(&self, m: &DMatrix<f64>) -> DMatrix<f64> {
        &self.r_inv * m
    }

    pub(super) fn transition(&self, dt_s: f64) -> DMatrix<f64> {
        &self.r * self.flow.transition(dt_s) * &self.r_inv
    }

    pub(super) fn p_inverse(&self) -> DMatrix<f64> {
        &self.r_inv * self.r_inv.transpose()
    }

    /// Proves N ⪰ 0 from the first node to the last, or says where it fails.
    pub(super) fn prove(&self, nodes: &[Node], growth: Growth) -> (Coverage, Verdict) {
        match self.flow.polynomials(&self.r, &self.r_inv, self.process) {
            Some(motion) => (Coverage::Proven, Enclosures { frame: self, motion, growth }.prove(nodes)),
            None => (Coverage::CheckedOnAGrid, self.check_on_grid(nodes, growth)),
        }
    }

    fn check_on_grid(&self, nodes: &[Node], growth: Growth) -> Verdict {
        let mut margin = f64::INFINITY;
        for (a, b) in pairs(nodes) {
            for k in 0..=GRID {
                let s = k as f64 / GRID as f64;
                let dt_s = a.dt_s + s * (b.dt_s - a.dt_s);
                let lowest = verify::smallest_eigenvalue(&self.at(a, b, s, dt_s, growth)) - SLACK;
                if lowest.is_nan() || lowest <= 0.0 {
                    return Verdict::Refuted { dt_s };
                }
                margin = margin.min(lowest);
            }
        }
        Verdict::Proven { margin }
    }

    /// N at one step length, in plain arithmetic.
    fn at(&self, a: &Node, b: &Node, s: f64, dt_s: f64, growth: Growth) -> DMatrix<f64> {
        let n = self.r.nrows();
        let gain = &a.gain * (1.0 - s) + &b.gain * s;
        let m = DMatrix::identity(n, n) + &gain * &self.c;
        let f = &m * self.transition(dt_s);
        let (g, unit) = match growth {
            Growth::Decay { alpha } => ((-alpha * dt_s).exp(), -(-alpha * dt_s).exp_m1()),
            Growth::Linear => (a.growth * (1.0 - s) + b.growth * s, 1.0),
        };
        let mut out = DMatrix::identity(n, n) - &f * f.transpose() / g;
        for (i, (x, y)) in a.weights.iter().zip(&b.weights).enumerate() {
            let weight = (x * (1.0 - s) + y * s) * unit;
            let term = match i.checked_sub(self.process.len()) {
                None => {
                    let mr = &m * &self.r;
                    &mr * self.flow.spread(&self.process[i], dt_s) * mr.transpose()
                }
                Some(j) => {
                    let lv = &gain * &self.output[j];
                    &lv * lv.transpose()
                }
            };
            out -= term / weight;
        }
        out
    }
}

/// Neighbouring nodes; a single node is a range of its own.
fn pairs(nodes: &[Node]) -> Vec<(&Node, &Node)> {
    match nodes {
        [only] => vec![(only, only)],
        _ => nodes.windows(2).map(|w| (&w[0], &w[1])).collect(),
    }
}

/// N(δ) in interval arithmetic.
struct Enclosures<'a> {
    frame: &'a Frame<'a>,
    motion: Polynomials,
    growth: Growth,
}

impl Enclosures<'_> {
    /// N over an interval of step lengths between two nodes.
    fn enclosure(&self, a: &Node, b: &Node, over: Interval) -> JetMatrix {
        let dt = Jet::variable(over);
        let span = b.dt_s - a.dt_s;
        // 0 at a, 1 at b; a single node stands for itself
        let s = if span > 0.0 {
            dt.plus(Jet::constant(-a.dt_s)).times(Jet::constant(1.0 / span))
        } else {
            Jet::constant(0.0)
        };
        let between = |x: f64, y: f64| Jet::constant(x).plus(s.times(Jet::constant(y - x)));
        let gain = JetMatrix::constant(&a.gain).plus(&JetMatrix::constant(&(&b.gain - &a.gain)).scaled(s));
        let (growth_inverse, unit) = match self.growth {
            Growth::Decay { alpha } => {
                let lambda = Jet::constant(1.0).plus(dt.exp_of(-alpha).times(Jet::constant(-1.0)));
                (dt.exp_of(alpha), lambda)
            }
            Growth::Linear => (between(a.growth, b.growth).reciprocal(), Jet::constant(1.0)),
        };
        let c = &self.frame.c;
        let n = c.ncols();
        let m = JetMatrix::constant(&DMatrix::identity(n, n)).plus(&gain.times(&JetMatrix::constant(c)));
        let f = m.times(&self.motion.transition(dt));
        let mut sum = f.times(&f.transpose()).scaled(growth_inverse);
        for (i, (x, y)) in a.weights.iter().zip(&b.weights).enumerate() {
            let weight = between(*x, *y).times(unit).reciprocal();
            let term = match i.checked_sub(self.frame.process.len()) {
                None => m.times(&self.motion.spread(i, dt)).times(&m.transpose()),
                Some(j) => {
                    let lv = gain.times(&JetMatrix::constant(&self.frame.output[j]));
                    lv.times(&lv.transpose())
                }
            };
            sum = sum.plus(&term.scaled(weight));
        }
        JetMatrix::constant(&DMatrix::identity(n, n)).plus(&sum.scaled(Jet::constant(-1.0)))
    }

    /// A lower bound on the smallest eigenvalue of N at one step length.
    fn smallest(&self, a: &Node, b: &Node, dt_s: f64) -> f64 {
        let span = b.dt_s - a.dt_s;
        let s = if span > 0.0 { (dt_s - a.dt_s) / span } else { 0.0 };
        verify::smallest_eigenvalue(&self.frame.at(a, b, s, dt_s, self.growth)) - SLACK
    }

    fn prove(&self, nodes: &[Node]) -> Verdict {
        let mut margin = f64::INFINITY;
        for (a, b) in pairs(nodes) {
            let curvature = |lo, hi| self.enclosure(a, b, Interval::new(lo, hi)).second_norm();
            let end = |dt_s| (dt_s, self.smallest(a, b, dt_s));
            let whole = Cell { lo: end(a.dt_s), hi: end(b.dt_s), curvature: curvature(a.dt_s, b.dt_s), age: 0 };
            let mut open = vec![whole];
            while let Some(mut cell) = open.pop() {
                // NaN counts as failure
                if let Some((dt_s, _)) =
                    [cell.lo, cell.hi].into_iter().find(|(_, value)| value.is_nan() || *value <= 0.0)
                {
                    return Verdict::Refuted { dt_s };
                }
                if cell.least() <= 0.0 && cell.age == RENEWED_AFTER {
                    (cell.curvature, cell.age) = (curvature(cell.lo.0, cell.hi.0), 0);
                }
                let width = cell.hi.0 - cell.lo.0;
                if cell.least() > 0.0 {
                    margin = margin.min(cell.least());
                } else if width < SMALLEST_CELL * (b.dt_s - a.dt_s) {
                    return Verdict::Open { dt_s: cell.lo.0 };
                } else {
                    let middle = end(0.5 * (cell.lo.0 + cell.hi.0));
                    open.push(Cell { hi: middle, age: cell.age + 1, ..cell });
                    open.push(Cell { lo: middle, age: cell.age + 1, ..cell });
                }
            }
        }
        Verdict::Proven { margin }
    }
}

/// Halvings after which a cell's curvature is enclosed anew: it costs as much as dozens of single step lengths.
const RENEWED_AFTER: u32 = 3;

/// A range of step lengths with the smallest eigenvalue of N at its ends and a bound on ‖N″‖ within.
#[derive(Clone, Copy)]
struct Cell {
    lo: (f64, f64),
    hi: (f64, f64),
    curvature: f64,
    /// Halvings since the curvature was enclosed.
    age: u32,
}

impl Cell {
    /// A lower bound on the smallest eigenvalue of N over the cell.
    fn least(&self) -> f64 {
        let sag = (self.hi.0 - self.lo.0).powi(2) / 8.0 * self.curvature;
        let least = self.lo.1.min(self.hi.1) - sag;
        if least.is_nan() { f64::NEG_INFINITY } else { least }
    }
}
