use super::expr::{Affine, ShapeError, Sparse};
use super::outcome::{Infeasible, Outcome, Solution, Unbounded};
use super::scaling::Scales;
use super::{bridge, verify};

/// A mistake in how a problem is stated, as opposed to an answer about it.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum ProblemError {
    #[error("`{name}`: {source}")]
    Shape { name: String, source: ShapeError },
    #[error("`{name}` must be a square matrix, not {rows}×{cols}")]
    NotSquare { name: String, rows: usize, cols: usize },
    #[error("`{name}` is not symmetric")]
    NotSymmetric { name: String },
    #[error("the objective must be a 1×1 expression, not {rows}×{cols}")]
    ObjectiveNotScalar { rows: usize, cols: usize },
    #[error("`{name}` uses an unknown of another problem")]
    ForeignUnknown { name: String },
    #[error("`{name}` holds a number that is not finite")]
    NotFinite { name: String },
    #[error("the weight of a log det must be positive, not {0}")]
    LogDetWeight(f64),
    #[error("the problem has no constraint")]
    Empty,
    #[error("the solver refused the problem: {0}")]
    Solver(String),
}

/// How log det X enters the cone program.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum LogDet {
    /// Σ log zᵢ by exponential cones.
    #[default]
    Exponential,
    /// (Π zᵢ)^{1/n} by a power cone: the same maximiser. Only when the objective is a single log det.
    GeometricMean,
}

/// How a problem is solved.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Settings {
    pub log_det: LogDet,
    /// Whether rows, columns and unknowns are rescaled before solving, and again at the solution found.
    pub scaling: bool,
    /// How often the problem may be solved, each time rescaled at the last answer, until two answers agree.
    pub passes: usize,
    /// How well two objectives must agree, as a share of their size.
    pub agreement: f64,
    pub max_iterations: u32,
}

impl Default for Settings {
    fn default() -> Self {
        Self { log_det: LogDet::default(), scaling: true, passes: 5, agreement: 1e-5, max_iterations: 200 }
    }
}

/// `expr ⪰ margin·D⁻²`, where D is the diagonal scaling that the solver chose for this block.
#[derive(Debug, Clone)]
pub(super) struct Constraint {
    pub(super) name: String,
    pub(super) expr: Affine,
    pub(super) margin: f64,
}

/// What is to be made large: `linear·x + Σ weight·log det X`, either of which may be absent.
#[derive(Debug, Clone, Default)]
pub(super) struct Objective {
    /// Coefficients of the unknowns, for maximisation.
    pub(super) linear: Sparse1,
    pub(super) constant: f64,
    /// The user asked for the smallest value: signs turn on the way out.
    pub(super) negated: bool,
    /// (weight > 0, X).
    pub(super) log_dets: Vec<(f64, Affine)>,
}

pub(super) type Sparse1 = std::collections::BTreeMap<usize, f64>;

/// A semidefinite program: unknown matrices, matrix inequalities that are affine in them, and something to maximise.
///
/// ```
/// use mavobserver::sdp::{Affine, Outcome, Problem, Settings};
/// use nalgebra::dmatrix;
///
/// // the largest t with [2 1; 1 2] − t·I ⪰ 0 is the smallest eigenvalue, 1
/// let mut p = Problem::new();
/// let t = p.scalar();
/// let identity = dmatrix![1.0; 0.0];
/// let shifted = Affine::block(&[
///     vec![Affine::constant(dmatrix![2.0]) - &t, Affine::constant(dmatrix![1.0])],
///     vec![Affine::constant(dmatrix![1.0]), Affine::constant(dmatrix![2.0]) - &t],
/// ]);
/// p.positive("shifted", shifted);
/// p.maximize(&t);
/// let Outcome::Optimal(s) = p.solve(&Settings::default()).unwrap() else { panic!() };
/// assert!((s.objective - 1.0).abs() < 1e-6);
/// # let _ = identity;
/// ```
#[derive(Debug, Clone, Default)]
pub struct Problem {
    unknowns: usize,
    constraints: Vec<Constraint>,
    objective: Objective,
    error: Option<ProblemError>,
}

impl Problem {
    pub fn new() -> Self {
        Self::default()
    }

    /// An unknown symmetric n×n matrix.
    pub fn symmetric(&mut self, n: usize) -> Affine {
        let first = self.take(n * (n + 1) / 2);
        Affine::unknowns(n, n, |i, j| first + packed(i.min(j), i.max(j)))
    }

    /// An unknown matrix.
    pub fn matrix(&mut self, rows: usize, cols: usize) -> Affine {
        let first = self.take(rows * cols);
        Affine::unknowns(rows, cols, |i, j| first + j * rows + i)
    }

    /// An unknown number, as a 1×1 matrix.
    pub fn scalar(&mut self) -> Affine {
        self.matrix(1, 1)
    }

    fn take(&mut self, count: usize) -> usize {
        let first = self.unknowns;
        self.unknowns += count;
        first
    }

    /// Requires `expr ⪰ 0`.
    pub fn positive(&mut self, name: impl Into<String>, expr: impl Into<Affine>) {
        self.positive_by(name, expr, 0.0);
    }

    /// Requires `expr ⪯ 0`.
    pub fn negative(&mut self, name: impl Into<String>, expr: impl Into<Affine>) {
        self.positive_by(name, -expr.into(), 0.0);
    }

    /// Requires `expr ≻ 0` with room: `D·expr·D ⪰ margin·I`, where D is the diagonal scaling that brings the terms on
    /// the block's diagonal to unit size at the solution. So the margin has no unit, [`verify::margin`] of the solved
    /// block is at least as large, and 1e−8 is above the solver's own tolerance.
    pub fn positive_by(&mut self, name: impl Into<String>, expr: impl Into<Affine>, margin: f64) {
        let (name, expr) = (name.into(), expr.into());
        if let Err(e) = self.check_symmetric(&name, &expr) {
            self.error.get_or_insert(e);
        }
        self.constraints.push(Constraint { name, expr, margin });
    }

    /// Adds a 1×1 expression to what is maximised.
    pub fn maximize(&mut self, expr: impl Into<Affine>) {
        self.set_linear(expr.into(), 1.0);
    }

    /// Minimises a 1×1 expression.
    pub fn minimize(&mut self, expr: impl Into<Affine>) {
        self.set_linear(expr.into(), -1.0);
        self.objective.negated = true;
    }

    /// Adds `weight`·log det of a symmetric expression, which is thereby required to be positive definite, to what is
    /// maximised. The weight must be positive.
    pub fn maximize_log_det(&mut self, weight: f64, expr: impl Into<Affine>) {
        let expr = expr.into();
        if let Err(e) = self.check_symmetric("log det", &expr) {
            self.error.get_or_insert(e);
        } else if !(weight > 0.0 && weight.is_finite()) {
            self.error.get_or_insert(ProblemError::LogDetWeight(weight));
        }
        self.objective.log_dets.push((weight, expr));
    }

    fn set_linear(&mut self, expr: Affine, sign: f64) {
        let (rows, cols) = expr.shape();
        if let Err(e) = self.check("objective", &expr) {
            self.error.get_or_insert(e);
        } else if (rows, cols) != (1, 1) {
            self.error.get_or_insert(ProblemError::ObjectiveNotScalar { rows, cols });
        } else {
            self.objective.constant = sign * expr.constant_part()[(0, 0)];
            self.objective.linear = expr.terms().iter().map(|(&k, f)| (k, sign * f.values().sum::<f64>())).collect();
        }
    }

    fn check(&self, name: &str, expr: &Affine) -> Result<(), ProblemError> {
        let name = || name.to_owned();
        if let Some(source) = expr.fault() {
            return Err(ProblemError::Shape { name: name(), source: source.clone() });
        }
        if expr.terms().keys().any(|&k| k >= self.unknowns) {
            return Err(ProblemError::ForeignUnknown { name: name() });
        }
        let mut numbers = expr.constant_part().iter().chain(expr.terms().values().flat_map(Sparse::values));
        if numbers.any(|x| !x.is_finite()) {
            return Err(ProblemError::NotFinite { name: name() });
        }
        Ok(())
    }

    fn check_symmetric(&self, name: &str, expr: &Affine) -> Result<(), ProblemError> {
        self.check(name, expr)?;
        let (rows, cols) = expr.shape();
        if rows != cols || rows == 0 {
            return Err(ProblemError::NotSquare { name: name.to_owned(), rows, cols });
        }
        // products of constants round differently on the two sides of the diagonal
        let close = |a: f64, b: f64, scale: f64| (a - b).abs() <= 1e-9 * scale;
        let f0 = expr.constant_part();
        let symmetric = close((f0 - f0.transpose()).amax(), 0.0, f0.amax())
            && expr.terms().values().all(|f| {
                let scale = f.values().fold(0.0, |m: f64, v| m.max(v.abs()));
                f.iter().all(|(&(i, j), &v)| close(v, f.get(&(j, i)).copied().unwrap_or(0.0), scale))
            });
        if symmetric { Ok(()) } else { Err(ProblemError::NotSymmetric { name: name.to_owned() }) }
    }

    pub(super) fn unknown_count(&self) -> usize {
        self.unknowns
    }

    pub(super) fn constraints(&self) -> &[Constraint] {
        &self.constraints
    }

    pub(super) fn objective(&self) -> &Objective {
        &self.objective
    }

    /// Solves, checks the answer, and says what kind of answer it is.
    ///
    /// With scaling on, the problem is solved again with every block brought to a unit diagonal at the last answer,
    /// until two differently scaled solves agree: one badly scaled solve can report an optimum that is several times
    /// off. Infeasibility and unboundedness are reported only with a certificate that holds by itself.
    ///
    /// # Errors
    /// Only for a problem that is stated wrongly.
    pub fn solve(&self, settings: &Settings) -> Result<Outcome, ProblemError> {
        if let Some(e) = &self.error {
            return Err(e.clone());
        }
        if self.constraints.is_empty() && self.objective.log_dets.is_empty() {
            return Err(ProblemError::Empty);
        }
        if !settings.scaling {
            let raw = bridge::solve(self, &Scales::none(self), settings)?;
            return Ok(self.judge(raw));
        }
        let mut scales = Scales::from_coefficients(self);
        let unit = scales.objective_unit(self);
        let mut last: Option<Solution> = None;
        let mut seconds = 0.0;
        let mut outcome = None;
        for _ in 0..settings.passes.max(1) {
            let raw = bridge::solve(self, &scales, settings)?;
            seconds += raw.seconds;
            let point = raw.x.clone();
            let judged = self.judge(raw).with_seconds(seconds);
            match &judged {
                Outcome::Infeasible(_) | Outcome::Unbounded(_) => return Ok(judged),
                Outcome::Optimal(s) => {
                    if last.as_ref().is_some_and(|l| self.agree(l, s, settings.agreement, unit)) {
                        return Ok(judged);
                    }
                    last = Some(s.clone());
                }
                Outcome::Inaccurate { .. } => last = None,
            }
            let next = scales.at_point(self, &point);
            outcome = Some(judged);
            match next {
                Some(next) => scales = next,
                None => break,
            }
        }
        Ok(match outcome {
            Some(Outcome::Optimal(best)) if settings.passes > 1 => Outcome::Inaccurate {
                reason: "the objective keeps changing when the problem is rescaled".into(),
                best: Some(best),
            },
            Some(other) => other,
            None => Outcome::Inaccurate { reason: "not solved".into(), best: None },
        })
    }

    /// Whether two answers tell the same, to a share of the objective's size; near zero that is `unit`.
    fn agree(&self, a: &Solution, b: &Solution, tolerance: f64, unit: f64) -> bool {
        let logs = if self.objective.log_dets.is_empty() { 0.0 } else { 1.0 };
        let size = a.objective.abs().max(b.objective.abs()).max(unit).max(logs);
        (a.objective - b.objective).abs() <= tolerance * size
    }

    /// The analytic centre: the point with the largest Σ log det of all constraints' matrices, whatever the objective.
    ///
    /// A well-conditioned choice among the feasible points where no best one exists or where the best lies on the
    /// border. Constraints that leave a direction open have no centre, which the outcome says.
    ///
    /// # Errors
    /// Only for a problem that is stated wrongly.
    pub fn centre(&self, settings: &Settings) -> Result<Outcome, ProblemError> {
        let mut problem = self.clone();
        problem.objective = Objective {
            log_dets: self.constraints.iter().map(|c| (1.0, c.expr.clone())).collect(),
            ..Objective::default()
        };
        // a matrix in a log det is positive anyway; what asks for room still gets it
        problem.constraints.retain(|c| c.margin > 0.0);
        problem.solve(settings)
    }

    /// The objective at a point, as the user stated it; `None` when the log det's matrix is not positive there.
    pub(super) fn objective_at(&self, x: &[f64]) -> Option<f64> {
        let linear: f64 = self.objective.linear.iter().map(|(&k, q)| q * x.get(k).copied().unwrap_or(0.0)).sum();
        let mut sum = linear + self.objective.constant;
        for (weight, e) in &self.objective.log_dets {
            let v = e.value(x);
            let l = ((&v + v.transpose()) * 0.5).cholesky()?;
            sum += weight * l.l_dirty().diagonal().iter().map(|d| 2.0 * d.ln()).sum::<f64>();
        }
        Some(if self.objective.negated { -sum } else { sum })
    }

    fn judge(&self, raw: bridge::Raw) -> Outcome {
        match raw.status {
            bridge::Status::Solved => match self.objective_at(&raw.x) {
                Some(objective) => Outcome::Optimal(Solution {
                    objective,
                    margins: self.margins(&raw.x),
                    x: raw.x,
                    iterations: raw.iterations,
                    seconds: raw.seconds,
                }),
                None => Outcome::Inaccurate { reason: "the log det's matrix is not positive".into(), best: None },
            },
            bridge::Status::PrimalInfeasible => {
                let certificate = Infeasible::new(self, raw.duals, &raw.margin_pulls, &raw.units);
                if certificate.holds() {
                    Outcome::Infeasible(certificate)
                } else {
                    Outcome::Inaccurate {
                        reason: format!("called infeasible, but its certificate does not hold: {certificate}"),
                        best: None,
                    }
                }
            }
            bridge::Status::DualInfeasible => {
                let ray = Unbounded::new(self, raw.x);
                if ray.holds() {
                    Outcome::Unbounded(ray)
                } else {
                    Outcome::Inaccurate {
                        reason: format!("called unbounded, but its direction does not hold: {ray}"),
                        best: None,
                    }
                }
            }
            bridge::Status::Stopped(reason) => {
                let best = self.objective_at(&raw.x).map(|objective| Solution {
                    objective,
                    margins: self.margins(&raw.x),
                    x: raw.x,
                    iterations: raw.iterations,
                    seconds: raw.seconds,
                });
                Outcome::Inaccurate { reason, best }
            }
        }
    }

    /// The margin of every constraint at a point, by eigenvalues computed outside the solver.
    fn margins(&self, x: &[f64]) -> Vec<(String, f64)> {
        self.constraints.iter().map(|c| (c.name.clone(), verify::margin(&c.expr.value(x)))).collect()
    }

    /// Every matrix that must be positive, with a name: the constraints, then the log dets.
    pub(super) fn blocks(&self) -> impl Iterator<Item = (&str, &Affine)> {
        let log_dets = self.objective.log_dets.iter().map(|(_, e)| ("log det", e));
        self.constraints.iter().map(|c| (c.name.as_str(), &c.expr)).chain(log_dets)
    }

    /// Whether the objective grows without end along a direction that all blocks allow.
    pub(super) fn is_improving(&self, d: &[f64]) -> bool {
        let rate: f64 = self.objective.linear.iter().map(|(&k, q)| q * d.get(k).copied().unwrap_or(0.0)).sum();
        rate > 0.0 || rate == 0.0 && self.objective.log_dets.iter().any(|(_, e)| e.slope(d).trace() > 0.0)
    }
}

/// Index of entry (i ≤ j) in a triangle packed column by column.
pub(super) fn packed(i: usize, j: usize) -> usize {
    j * (j + 1) / 2 + i
}
