use super::conditions::{Breach, Conditions};
use super::norm::{HinfNorm, hinf_norm, spectral_abscissa};
use super::plant::{Extended, Plant, PlantError};
use crate::sdp::{Affine, Outcome, Problem, ProblemError, Settings, verify};
use nalgebra::DMatrix;

/// What a design is asked for.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Goal {
    /// ‖H‖∞ < γ (eq. 13): what Theorem 1 needs.
    pub gamma: f64,
    /// ‖G‖∞ ≤ γ_n: how much measurement noise may reach the estimates. Must leave room: the smallest possible value is
    /// approached by ever larger gains only.
    pub gamma_n: f64,
    pub region: PoleRegion,
}

impl Goal {
    pub fn new(gamma: f64, gamma_n: f64) -> Self {
        Self { gamma, gamma_n, region: PoleRegion::default() }
    }
}

/// Where the poles of 𝔄 − Kℭ must lie: an LMI region of Chilali and Gahinet (1996), by the same Lyapunov matrix.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct PoleRegion {
    /// Re s < −decay, 1/s.
    pub decay: Option<f64>,
    /// |s| < radius, rad/s.
    pub radius: Option<f64>,
    /// |arg(−s)| < angle, rad: damping ratio above its cosine.
    pub angle: Option<f64>,
}

/// Gains of the observer (9) for the extended system (8), checked.
#[derive(Debug, Clone, PartialEq)]
pub struct Design {
    pub goal: Goal,
    /// K = [K_w; K_z], rows by state, columns by output.
    pub gain: DMatrix<f64>,
    pub p: DMatrix<f64>,
    /// ‖H‖∞ from the rate of change that Σ₁ leaves unmodelled to the error of (w, z).
    pub h: HinfNorm,
    /// ‖G‖∞ from measurement noise to the same error.
    pub g: HinfNorm,
    /// Largest real part of the poles of 𝔄 − Kℭ, 1/s.
    pub abscissa: f64,
    /// Smallest [`verify::margin`] of the inequalities.
    pub margin: f64,
    pub conditions: Conditions,
    /// Time in the solver, s.
    pub solve_s: f64,
}

/// Why there is no design.
#[derive(Debug, Clone, thiserror::Error)]
pub enum DesignError {
    #[error(transparent)]
    Plant(#[from] PlantError),
    #[error("{name} must be a positive number, not {value}")]
    Goal { name: &'static str, value: f64 },
    #[error("Assumption 4 fails: {}", list(.0))]
    Assumption(Vec<Breach>),
    #[error("no gain gives ‖H‖ < {gamma} and ‖G‖ ≤ {gamma_n} together: {reason}; try a larger γ or γ_n")]
    Infeasible { gamma: f64, gamma_n: f64, reason: String },
    #[error("the solver stopped short: {0}")]
    Inaccurate(String),
    #[error("the gains found do not pass the check outside the solver: {what}")]
    NotVerified { what: String },
    #[error(transparent)]
    Problem(#[from] ProblemError),
}

fn list(breaches: &[Breach]) -> String {
    breaches.iter().map(ToString::to_string).collect::<Vec<_>>().join("; ")
}

/// The largest γ for which Theorem 1 promises global exponential stability of a cascade, from the constants of
/// Assumptions 1 to 3.
pub fn cascade_gamma(alpha_3: f64, alpha_4: f64, l_1: f64, l_2: f64) -> f64 {
    4.0 * alpha_3 / (4.0 * l_2 * l_2 + alpha_4 * alpha_4 * l_1 * l_1)
}

/// The same for feedback-interconnected systems (Theorem 1'): the largest γ, to a billionth, with γ < α₃/L₂² and
/// γ < 4(α₃ − γL₂²)(1 − γ²L₂²)/(α₄²L₁²), as its proof asks.
pub fn feedback_gamma(alpha_3: f64, alpha_4: f64, l_1: f64, l_2: f64) -> f64 {
    let l2 = l_2 * l_2;
    let holds = |g: f64| g * alpha_4 * alpha_4 * l_1 * l_1 < 4.0 * (alpha_3 - g * l2) * (1.0 - g * g * l2);
    // both factors on the right are positive and fall up to here
    let (mut lo, mut hi) = (0.0, (alpha_3 / l2).min(1.0 / l_2));
    for _ in 0..60 {
        let middle = 0.5 * (lo + hi);
        if holds(middle) { lo = middle } else { hi = middle }
    }
    lo
}

/// Gains for a plant (§3.2): the analytic centre of the inequalities (14) at γ and (15) at γ_n, and those of the pole
/// region.
///
/// The paper minimises γ_n. Where a measured quantity enters the state directly, that infimum (1, for N = I) is not
/// attained and the gains grow without end on the way to it; so γ_n is given, a little above, and of the gains that
/// satisfy the inequalities those in their middle are taken.
pub fn design(plant: &Plant, goal: &Goal) -> Result<Design, DesignError> {
    plant.check()?;
    for (name, value) in [("gamma", Some(goal.gamma)), ("gamma_n", Some(goal.gamma_n)), ("decay", goal.region.decay)]
        .into_iter()
        .chain([("radius", goal.region.radius), ("angle", goal.region.angle)])
    {
        if let Some(value) = value.filter(|x| !(*x > 0.0 && x.is_finite())) {
            return Err(DesignError::Goal { name, value });
        }
    }
    let conditions = Conditions::of(plant);
    if !conditions.breaches.is_empty() {
        return Err(DesignError::Assumption(conditions.breaches));
    }
    let extended = plant.extended();
    let (n, outputs) = (extended.a.nrows(), extended.c.nrows());

    let mut problem = Problem::new();
    let p = problem.symmetric(n);
    let x = problem.matrix(n, outputs);
    let blocks = inequalities(&extended, &plant.n, goal, &p, &x);
    for (_, block) in &blocks {
        problem.maximize_log_det(1.0, block);
    }
    let solution = match problem.solve(&Settings::default())? {
        Outcome::Optimal(s) => s,
        Outcome::Infeasible(why) => return Err(infeasible(goal, why.to_string())),
        Outcome::Unbounded(why) => return Err(infeasible(goal, why.to_string())),
        Outcome::Inaccurate { reason, .. } => return Err(DesignError::Inaccurate(reason)),
    };
    let margin = blocks.iter().map(|(_, b)| verify::margin(&solution.value(b))).fold(f64::INFINITY, f64::min);
    let (p, x) = (solution.value(&p), solution.value(&x));
    let refused = |what: &str| DesignError::NotVerified { what: what.to_owned() };
    let gain = p.clone().cholesky().ok_or_else(|| refused("P is not positive"))?.solve(&x);
    if !blocks.iter().all(|(_, b)| verify::is_positive(&solution.value(b))) {
        return Err(DesignError::NotVerified { what: format!("margin {margin:.1e} of the inequalities") });
    }
    let closed = &extended.a - &gain * &extended.c;
    let abscissa = spectral_abscissa(&closed).ok_or_else(|| refused("the poles cannot be computed"))?;
    let h = hinf_norm(&closed, &extended.b_d).ok_or_else(|| refused("𝔄 − Kℭ is not Hurwitz"))?;
    let g = hinf_norm(&closed, &(-&gain * &plant.n)).ok_or_else(|| refused("𝔄 − Kℭ is not Hurwitz"))?;
    for (name, norm, limit) in [("H", h, goal.gamma), ("G", g, goal.gamma_n)] {
        if norm.upper > limit * (1.0 + 1e-6) {
            return Err(DesignError::NotVerified { what: format!("‖{name}‖ = {:.6} exceeds {limit}", norm.lower) });
        }
    }
    Ok(Design { goal: *goal, gain, p, h, g, abscissa, margin, conditions, solve_s: solution.seconds })
}

fn infeasible(goal: &Goal, reason: String) -> DesignError {
    DesignError::Infeasible { gamma: goal.gamma, gamma_n: goal.gamma_n, reason }
}

/// Every matrix that must be positive, with its name; `p` and `x` = PK are unknowns or values.
fn inequalities(
    e: &Extended,
    noise: &DMatrix<f64>,
    goal: &Goal,
    p: &Affine,
    x: &Affine,
) -> Vec<(&'static str, Affine)> {
    let (n, p_z, p_n) = (e.a.nrows(), e.b_d.ncols(), noise.ncols());
    // P·(𝔄 − Kℭ)
    let closed = p * &e.a - x * &e.c;
    let decay = -(closed.plus_transpose() + Affine::identity(n));
    let pb = p * &e.b_d;
    let xn = x * noise;
    let bounded = |input: &Affine, size: usize, gamma: f64| {
        Affine::symmetric_block(&[
            vec![decay.clone()],
            vec![-input.transpose(), Affine::identity(size).scaled(gamma * gamma)],
        ])
    };
    let mut blocks =
        vec![("P", p.clone()), ("(14)", bounded(&pb, p_z, goal.gamma)), ("(15)", bounded(&-&xn, p_n, goal.gamma_n))];
    if let Some(rate) = goal.region.decay {
        blocks.push(("decay", -(closed.plus_transpose() + p.scaled(2.0 * rate))));
    }
    if let Some(radius) = goal.region.radius {
        let disk = Affine::symmetric_block(&[vec![p.scaled(radius)], vec![closed.clone(), p.scaled(radius)]]);
        blocks.push(("radius", disk));
    }
    if let Some(angle) = goal.region.angle {
        let (s, c) = angle.sin_cos();
        let sum = closed.plus_transpose().scaled(-s);
        let difference = (&closed - closed.transpose()).scaled(c);
        blocks.push(("angle", Affine::symmetric_block(&[vec![sum.clone()], vec![difference, sum]])));
    }
    blocks
}

#[cfg(test)]
mod tests {
    use super::super::norm::eigenvalues;
    use super::super::plant::Measures;
    use super::*;
    use nalgebra::dmatrix;

    /// §5.2: the gains published for γ = 50 are one solver's stopping point on the way to γ_n = 1.
    #[test]
    fn the_published_gains() {
        let d = design(&Plant::axis(1.0, Some(1.0)), &Goal::new(50.0, 1.002)).unwrap();
        assert!(d.h.upper < 50.0 && d.g.upper <= 1.002 * (1.0 + 1e-6), "{d:?}");
        let published = dmatrix![128.9, 17.5; 15.7, 2.4; 1.3, 0.2];
        for (ours, theirs) in d.gain.iter().zip(published.iter()) {
            assert!((ours - theirs).abs() <= 0.2 * theirs, "{} against {published}", d.gain);
        }
    }

    #[test]
    fn the_whole_plant_is_three_axes() {
        let axis = design(&Plant::axis(1.0, None), &Goal::new(50.0, 2.0)).unwrap();
        let whole = design(&Plant::navigation(Measures::Position), &Goal::new(50.0, 2.0)).unwrap();
        for i in 0..3 {
            for j in 0..3 {
                for r in 0..3 {
                    let want = if i == j { axis.gain[(r, 0)] } else { 0.0 };
                    let got = whole.gain[(3 * r + i, j)];
                    assert!((got - want).abs() < 1e-3 * axis.gain.amax(), "{got} {want}");
                }
            }
        }
    }

    #[test]
    fn position_alone_needs_more_room_for_noise() {
        let d = design(&Plant::axis(1.0, None), &Goal::new(50.0, 2.0)).unwrap();
        assert!(d.h.upper < 50.0 && d.g.upper < 2.0 && d.abscissa < 0.0, "{d:?}");
        let tight = design(&Plant::axis(1.0, None), &Goal::new(1e-3, 1.01));
        assert!(matches!(tight, Err(DesignError::Infeasible { .. })), "{tight:?}");
    }

    #[test]
    fn poles_stay_in_their_region() {
        let region = PoleRegion { decay: Some(0.1), radius: Some(8.0), angle: Some(1.0) };
        let d = design(&Plant::axis(1.0, Some(1.0)), &Goal { region, ..Goal::new(50.0, 2.0) }).unwrap();
        let e = Plant::axis(1.0, Some(1.0)).extended();
        for pole in eigenvalues(&(&e.a - &d.gain * &e.c)).unwrap() {
            assert!(pole.re < -0.1 && pole.norm() < 8.0, "{pole}");
            assert!(pole.im.abs() <= -pole.re * 1.0_f64.tan(), "{pole}");
        }
    }

    #[test]
    fn example_1_is_solved_by_its_own_means() {
        for gamma in [10.0, 0.5] {
            let d = design(&Plant::example_1(), &Goal::new(gamma, 100.0)).unwrap();
            assert!(d.h.upper < gamma && d.conditions.minimum_phase, "{d:?}");
        }
    }

    #[test]
    fn a_plant_that_breaks_the_assumption_is_refused_with_its_reason() {
        let mut p = Plant::axis(1.0, None);
        p.c = dmatrix![0.0, 1.0];
        let refused = design(&p, &Goal::new(50.0, 2.0)).unwrap_err();
        assert!(refused.to_string().contains("not detectable"), "{refused}");
        assert!(matches!(design(&p, &Goal::new(-1.0, 2.0)), Err(DesignError::Goal { name: "gamma", .. })));
    }

    #[test]
    fn theorem_1_and_its_feedback_form() {
        assert_eq!(cascade_gamma(1.0, 2.0, 0.0, 1.0), 1.0);
        let g = feedback_gamma(1.0, 1.0, 1.0, 1.0);
        assert!(g < 4.0 * (1.0 - g) * (1.0 - g * g) && g > 0.5, "{g}");
        assert!(feedback_gamma(1.0, 2.0, 1.0, 0.5) <= cascade_gamma(1.0, 2.0, 1.0, 0.5));
    }
}
