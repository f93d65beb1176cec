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

use super::flow::Polynomials;
use super::jet::{Jet, JetMatrix};
use crate::sdp::verify;
use crate::sets::Interval;
use nalgebra::DMatrix;

/// What rounding outside the enclosures may cost: the coefficients of the polynomials and R⁻¹ are rounded once.
const SLACK: f64 = 1e-10;

/// Cells smaller than this share of a node gap are given up.
const SMALLEST_CELL: f64 = 1.0 / 4096.0;

/// How g depends on the step length between two nodes.
#[derive(Debug, Clone, Copy)]
pub(super) enum Growth {
    /// g = e^{−αδ}, and the weights are shares of 1 − e^{−αδ}.
    Decay { alpha: f64 },
    /// g and the weights run linearly between their values at the nodes.
    Linear,
}

/// A step at one node.
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

/// The step between nodes, in coordinates R·e.
pub(super) struct StepLaw<'a> {
    pub(super) motion: &'a Polynomials,
    /// C·R⁻¹.
    pub(super) c: &'a DMatrix<f64>,
    /// Measurement factors Vⱼ.
    pub(super) measurement: &'a [DMatrix<f64>],
    pub(super) process_blocks: usize,
    pub(super) growth: Growth,
    /// Every weight may be this much larger; for [`Growth::Linear`] g too.
    pub(super) slack: f64,
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

impl StepLaw<'_> {
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
            Growth::Linear => {
                let g = between(a.growth, b.growth).times(Jet::constant(self.slack));
                (g.reciprocal(), Jet::constant(1.0))
            }
        };
        let n = self.c.ncols();
        let m = JetMatrix::constant(&DMatrix::identity(n, n)).plus(&gain.times(&JetMatrix::constant(self.c)));
        let f = m.times(&self.motion.transition(dt));
        let mut sum = f.times(&f.transpose()).scaled(growth_inverse);
        for (i, (x, y)) in a.weights.iter().zip(&b.weights).enumerate() {
            let weight = between(*x, *y).times(unit).times(Jet::constant(self.slack)).reciprocal();
            let term = match i.checked_sub(self.process_blocks) {
                None => m.times(&self.motion.spread(i, dt)).times(&m.transpose()),
                Some(j) => {
                    let lv = gain.times(&JetMatrix::constant(&self.measurement[j]));
                    lv.times(&lv.transpose())
                }
            };
            sum = sum.plus(&term.scaled(weight));
        }
        JetMatrix::constant(&DMatrix::identity(n, n)).plus(&sum.scaled(Jet::constant(-1.0)))
    }

    /// A lower bound on the smallest eigenvalue of N at one step length.
    fn smallest(&self, a: &Node, b: &Node, dt_s: f64) -> f64 {
        let (middle, deviation) = self.enclosure(a, b, Interval::point(dt_s)).value();
        verify::smallest_eigenvalue(&middle) - deviation - SLACK
    }

    /// Proves N ⪰ 0 from the first node to the last, or says where it fails.
    pub(super) fn prove(&self, nodes: &[Node]) -> Verdict {
        let mut margin = f64::INFINITY;
        // a single node is a range of its own
        let pairs: Vec<(&Node, &Node)> = match nodes {
            [only] => vec![(only, only)],
            _ => nodes.windows(2).map(|w| (&w[0], &w[1])).collect(),
        };
        for (a, b) in pairs {
            let mut open = vec![(a.dt_s, self.smallest(a, b, a.dt_s), b.dt_s, self.smallest(a, b, b.dt_s))];
            while let Some((lo, at_lo, hi, at_hi)) = open.pop() {
                for (dt_s, value) in [(lo, at_lo), (hi, at_hi)] {
                    // NaN counts as failure
                    if value.is_nan() || value <= 0.0 {
                        return Verdict::Refuted { dt_s };
                    }
                }
                let sag = (hi - lo).powi(2) / 8.0 * self.enclosure(a, b, Interval::new(lo, hi)).second_norm();
                let left = at_lo.min(at_hi) - sag;
                if left > 0.0 {
                    margin = margin.min(left);
                } else if hi - lo < SMALLEST_CELL * (b.dt_s - a.dt_s) {
                    return Verdict::Open { dt_s: lo };
                } else {
                    let middle = 0.5 * (lo + hi);
                    let at_middle = self.smallest(a, b, middle);
                    open.push((lo, at_lo, middle, at_middle));
                    open.push((middle, at_middle, hi, at_hi));
                }
            }
        }
        Verdict::Proven { margin }
    }
}
