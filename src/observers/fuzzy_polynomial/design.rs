//! The six strategies of section 5 and what a design is.

use super::plant::{Plant, PlantError};
use super::{polynomial, takagi_sugeno};
use crate::sdp::{Outcome, ProblemError};
use crate::sos::SosError;
use nalgebra::DMatrix;

/// A strategy of the paper, in the order of Table 2.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Method {
    /// Linear model, Corollary 1 with σ = 0.
    LinearDesign,
    /// The gain of [`LinearDesign`](Self::LinearDesign) judged on the polynomial model by Theorem 1.
    LinearAnalysis,
    /// Takagi–Sugeno model with a gain for each of 8 vertices, Corollary 1.
    EightGains,
    /// The same with one gain for all vertices.
    OneGain,
    /// The gain of [`OneGain`](Self::OneGain) judged on the polynomial model by Theorem 1.
    OneGainAnalysis,
    /// Polynomial model with a gain for each of 2 vertices, Theorem 1.
    SumsOfSquares,
}

impl Method {
    pub const ALL: [Self; 6] = [
        Self::LinearDesign,
        Self::LinearAnalysis,
        Self::EightGains,
        Self::OneGain,
        Self::OneGainAnalysis,
        Self::SumsOfSquares,
    ];

    /// The paper's name.
    pub fn name(self) -> &'static str {
        match self {
            Self::LinearDesign => "LM-D",
            Self::LinearAnalysis => "LM-A",
            Self::EightGains => "TS-8GD",
            Self::OneGain => "TS-1GD",
            Self::OneGainAnalysis => "TS-1GA",
            Self::SumsOfSquares => "SOS-2G",
        }
    }

    pub fn of_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|m| m.name().eq_ignore_ascii_case(name))
    }

    /// The strategy whose gains this one takes: itself, unless it is an analysis.
    pub fn designed_by(self) -> Self {
        match self {
            Self::LinearAnalysis => Self::LinearDesign,
            Self::OneGainAnalysis => Self::OneGain,
            other => other,
        }
    }

    /// Whether the bound holds for the nonlinear plant, not only for its linear or Takagi–Sugeno model.
    pub fn is_judged_on_the_plant(self) -> bool {
        matches!(self, Self::LinearAnalysis | Self::OneGainAnalysis | Self::SumsOfSquares)
    }
}

/// Why there is no design.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum DesignError {
    #[error(transparent)]
    Plant(#[from] PlantError),
    #[error(transparent)]
    Problem(#[from] ProblemError),
    #[error(transparent)]
    Polynomial(#[from] SosError),
    #[error("the decay rate must be positive and finite, not {0} 1/s")]
    Rate(f64),
    #[error("no {method} observer decays at α = {alpha} 1/s: {why}")]
    Infeasible { method: &'static str, alpha: f64, why: String },
    #[error("the solver gave no trustworthy {method} design at α = {alpha} 1/s: {why}")]
    Inaccurate { method: &'static str, alpha: f64, why: String },
    #[error("the {method} design at α = {alpha} 1/s failed its check: {what} has margin {margin:.1e}")]
    NotVerified { method: &'static str, alpha: f64, what: &'static str, margin: f64 },
}

impl DesignError {
    pub(super) fn refusal(method: Method, alpha: f64, outcome: &Outcome) -> Self {
        let method = method.name();
        match outcome {
            Outcome::Infeasible(why) => Self::Infeasible { method, alpha, why: why.to_string() },
            Outcome::Unbounded(why) => Self::Inaccurate { method, alpha, why: why.to_string() },
            Outcome::Inaccurate { reason, .. } => Self::Inaccurate { method, alpha, why: reason.clone() },
            Outcome::Optimal(_) => Self::Inaccurate { method, alpha, why: "an optimum was refused".into() },
        }
    }
}

/// A vertex of the model and its gain: x̂⁺ = Σ μᵢ(𝒜ᵢ(x̂) + Lᵢ(x̂)·(y − Cx̂)) + B(u).
#[derive(Debug, Clone, PartialEq)]
pub struct Gain {
    /// The rotors' momentum at the vertex, −1 or 1 as a share of the largest; 0 where it is not told apart.
    pub momentum: f64,
    /// Premises x₂, x₄ at the vertex, rad/s; Takagi–Sugeno designs only.
    pub premises: Option<[f64; 2]>,
    /// L, 6×3.
    pub constant: DMatrix<f64>,
    /// What each estimated speed (x̂₂, x̂₄, x̂₆, rad/s) adds per unit; empty for constant gains.
    pub by_speed: Vec<DMatrix<f64>>,
}

/// One observer of the front.
#[derive(Debug, Clone, PartialEq)]
pub struct Design {
    pub method: Method,
    /// 1/s, in the units of continuous time: V falls by e^{−2αT} a sample.
    pub alpha: f64,
    /// The bound √γ of (17): |De|₂ ≤ √γ·|(w, ν)|₂ from e₀ = 0.
    pub gain_bound: f64,
    pub gains: Vec<Gain>,
    /// V = eᵀPe.
    pub p: DMatrix<f64>,
    /// The smallest margin of any inequality of the theorem, by eigenvalues outside the solver and, for polynomials, with
    /// every coefficient of the identity compared: positive, else there is no design.
    pub margin: f64,
    /// Time in the solver, s; for analyses that of the design is in it.
    pub solve_s: f64,
}

impl Design {
    /// 1000·√γ: the unit of Table 2.
    pub fn table_value(&self) -> f64 {
        1000.0 * self.gain_bound
    }

    /// The weighted gain at rotor momentum u ∈ [−1, 1] and estimated speeds (rad/s), premises within ±`premise_speed`:
    /// Σ μᵢLᵢ.
    pub fn gain_at(&self, u: f64, speeds: [f64; 3], premise_speed: f64) -> DMatrix<f64> {
        let mut sum = DMatrix::zeros(6, 3);
        for g in &self.gains {
            let share =
                |at: f64, vertex: f64, largest: f64| 0.5 * (1.0 + (at / largest).clamp(-1.0, 1.0) * vertex.signum());
            let mut mu = if g.momentum == 0.0 { 1.0 } else { share(u, g.momentum, 1.0) };
            if let Some([x2, x4]) = g.premises {
                mu *= share(speeds[0], x2, premise_speed) * share(speeds[1], x4, premise_speed);
            }
            sum += &g.constant * mu;
            for (l, speed) in g.by_speed.iter().zip(speeds) {
                sum += l * (mu * speed);
            }
        }
        sum
    }
}

/// How a design may differ from the paper's.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Options {
    /// Whether the gains of SOS-2G may depend linearly on the estimated speeds. The paper found no use for it.
    pub polynomial_gains: bool,
}

/// Designs an observer by one of the strategies at decay rate α (1/s).
///
/// # Errors
/// A plant that does not fit, a rate that no observer reaches, or a result that did not survive its check.
pub fn design(plant: &Plant, method: Method, alpha: f64, options: Options) -> Result<Design, DesignError> {
    plant.check()?;
    if !(alpha > 0.0 && alpha.is_finite()) {
        return Err(DesignError::Rate(alpha));
    }
    let by = method.designed_by();
    let made = match by {
        Method::SumsOfSquares => polynomial::design(plant, alpha, options)?.design,
        _ => takagi_sugeno::design(plant, by, alpha)?,
    };
    if by == method { Ok(made) } else { polynomial::analyse(plant, method, &made) }
}
