use super::expr::Affine;
use super::problem::Problem;
use super::verify;
use nalgebra::DMatrix;
use std::fmt;

/// What solving a problem answered. Each is an answer; mistakes in the statement are errors.
#[derive(Debug, Clone)]
pub enum Outcome {
    Optimal(Solution),
    /// No point satisfies all constraints, and here is why.
    Infeasible(Infeasible),
    /// The objective has no largest value, and here is a direction along which it grows.
    Unbounded(Unbounded),
    /// The solver stopped short, or its answer did not survive a check.
    Inaccurate {
        reason: String,
        best: Option<Solution>,
    },
}

impl Outcome {
    /// The optimum, or else the last point before the solver stopped short: for callers who judge it themselves.
    ///
    /// # Errors
    /// The outcome itself, when it holds no point.
    pub fn best(self) -> Result<Solution, Self> {
        match self {
            Self::Optimal(s) | Self::Inaccurate { best: Some(s), .. } => Ok(s),
            other => Err(other),
        }
    }

    pub(super) fn with_seconds(mut self, seconds: f64) -> Self {
        if let Self::Optimal(s) = &mut self {
            s.seconds = seconds;
        }
        self
    }
}

/// Values of the unknowns, with what was found when they were put into the constraints.
#[derive(Debug, Clone)]
pub struct Solution {
    /// As stated: the smallest value for `minimize`, else the largest. A log det is recomputed from the values.
    pub objective: f64,
    /// Constraint by constraint, [`verify::margin`](super::verify::margin) of its matrix at the values.
    pub margins: Vec<(String, f64)>,
    pub iterations: u32,
    /// Time in the solver, all passes together.
    pub seconds: f64,
    pub(super) x: Vec<f64>,
}

impl Solution {
    /// The value of any expression of the problem.
    pub fn value(&self, expr: &Affine) -> DMatrix<f64> {
        expr.value(&self.x)
    }
}

/// Multipliers Zᵢ ⪰ 0, one per constraint Fᵢ(x) = Fᵢ₀ + Σ xₖ Fᵢₖ ⪰ 0, whose weighted sum Σᵢ⟨Fᵢ(x), Zᵢ⟩ is negative for all
/// x within reach. Since ⟨F, Z⟩ ≥ 0 for F, Z ⪰ 0, no such x can satisfy all constraints at once.
#[derive(Debug, Clone)]
pub struct Infeasible {
    /// Zᵢ by constraint name.
    pub multipliers: Vec<(String, DMatrix<f64>)>,
    /// Σ⟨Fᵢ₀, Zᵢ⟩, less what margins ask for, as a share of the sum of its terms' sizes: negative.
    pub gap: f64,
    /// Up to which |xₖ| the sum stays negative, in units of the size cₖ that scaling takes each unknown to have:
    /// |Σ⟨Fᵢ₀, Zᵢ⟩| / Σₖ cₖ|Σ⟨Fᵢₖ, Zᵢ⟩|. Without bound but for rounding.
    pub reach: f64,
    /// The smallest eigenvalue of any Zᵢ, as a share of its norm.
    pub positivity: f64,
}

impl Infeasible {
    /// `units` holds c.
    pub(super) fn new(problem: &Problem, duals: Vec<DMatrix<f64>>, margin_pulls: &[f64], units: &[f64]) -> Self {
        let (mut constant, mut size) = (0.0, 0.0);
        let mut slopes = vec![0.0; problem.unknown_count()];
        let mut positivity = f64::INFINITY;
        let mut multipliers = Vec::new();
        for (((name, expr), z), pull) in problem.blocks().zip(duals).zip(margin_pulls) {
            let norm = z.norm();
            if norm > 0.0 {
                positivity = positivity.min(verify::smallest_eigenvalue(&z) / norm);
            }
            constant += expr.constant_part().dot(&z) - pull;
            size += expr.constant_part().component_mul(&z).abs().sum() + pull.abs();
            for (&k, f) in expr.terms() {
                slopes[k] += f.iter().map(|(&at, v)| v * z[at]).sum::<f64>();
            }
            multipliers.push((name.to_owned(), z));
        }
        let left: f64 = slopes.iter().zip(units).map(|(slope, c)| (slope * c).abs()).sum();
        Self {
            multipliers,
            gap: if size > 0.0 { constant / size } else { 0.0 },
            reach: constant.abs() / left,
            positivity,
        }
    }

    pub(super) fn holds(&self) -> bool {
        self.gap < -1e-9 && self.reach > 1e3 && self.positivity > -1e-7
    }

    /// The constraints that carry the contradiction, heaviest first.
    pub fn culprits(&self) -> Vec<&str> {
        let mut by_weight: Vec<_> = self.multipliers.iter().map(|(n, z)| (n.as_str(), z.norm())).collect();
        let heaviest = by_weight.iter().map(|p| p.1).fold(0.0, f64::max);
        by_weight.retain(|p| p.1 > 1e-6 * heaviest);
        by_weight.sort_by(|a, b| b.1.total_cmp(&a.1));
        by_weight.into_iter().map(|p| p.0).collect()
    }
}

impl fmt::Display for Infeasible {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "the constraints {} contradict each other (weighted sum {:.1e} < 0 up to {:.0e} times the unknowns' sizes)",
            self.culprits().join(", "),
            self.gap,
            self.reach
        )
    }
}

/// A direction d in the unknowns along which every constraint only gains (Σ dₖ Fᵢₖ ⪰ 0) and the objective grows without
/// end.
#[derive(Debug, Clone)]
pub struct Unbounded {
    x: Vec<f64>,
    /// The smallest eigenvalue of any Σ dₖ Fᵢₖ, as a share of its norm.
    pub positivity: f64,
    improving: bool,
}

impl Unbounded {
    pub(super) fn new(problem: &Problem, x: Vec<f64>) -> Self {
        let positivity = problem
            .blocks()
            .map(|(_, e)| e.slope(&x))
            .filter(|m| m.norm() > 0.0)
            .map(|m| verify::smallest_eigenvalue(&m) / m.norm())
            .fold(f64::INFINITY, f64::min);
        let improving = problem.is_improving(&x);
        Self { x, positivity, improving }
    }

    pub(super) fn holds(&self) -> bool {
        self.improving && self.positivity > -1e-6
    }

    /// The direction of an expression (its constant left out).
    pub fn direction(&self, expr: &Affine) -> DMatrix<f64> {
        expr.slope(&self.x)
    }
}

impl fmt::Display for Unbounded {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "the objective grows without end along a direction that every constraint allows")?;
        write!(f, " (smallest relative eigenvalue {:.1e})", self.positivity)
    }
}
