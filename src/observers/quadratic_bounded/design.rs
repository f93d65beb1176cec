use super::plant::{Plant, PlantError, factor, half_widths, over, projected, volume};
use super::riccati::stabilising;
use super::sampled::DesignError;
use crate::sdp::{Affine, Outcome, Problem, Settings, verify};
use nalgebra::DMatrix;

/// Room asked for in the inequality (7), far above rounding and without visible cost in the bound.
const MARGIN: f64 = 1e-7;

/// How well log det P_z from the semidefinite program and from the Riccati equation must agree.
const AGREEMENT: f64 = 1e-4;

/// The paper's observer at one convergence rate (eq. 31): x̂' = (A + LC)x̂ + … − Ly.
///
/// It is certified for continuous measurements: V = eᵀPe obeys V ≤ 1 + (V₀ − 1)e^{−αt} (eq. 18) while the disturbances
/// stay in Q. What runs on samples is [`SampledDesign`](super::SampledDesign).
#[derive(Debug, Clone, PartialEq)]
pub struct ContinuousDesign {
    /// 1/s.
    pub alpha: f64,
    /// L, n×p, with the paper's sign.
    pub gain: DMatrix<f64>,
    pub p: DMatrix<f64>,
    /// P_z of eq. (19).
    pub p_z: DMatrix<f64>,
    /// Volume of the ellipsoid of z (eq. 20), and log det P_z.
    pub volume: f64,
    pub log_det: f64,
    /// Half-width of each entry of z at V = 1.
    pub half_widths: Vec<f64>,
    /// [`verify::margin`] of the inequality (7) with this P and L: positive, else there is no design.
    pub margin: f64,
    /// Time in the solver, s.
    pub solve_s: f64,
}

/// A plant with unit disturbances: G·ζ with |ζ| ≤ 1, ζ common to state and outputs (eq. 2), and outputs divided by their
/// own noise, y' = N⁻¹·y with R = N·Nᵀ.
struct Unit<'a> {
    plant: &'a Plant,
    g1: DMatrix<f64>,
    g2: DMatrix<f64>,
    /// N⁻¹·C.
    c: DMatrix<f64>,
    /// R⁻¹·C.
    weighted_c: DMatrix<f64>,
}

impl<'a> Unit<'a> {
    fn of(plant: &'a Plant) -> Result<Self, PlantError> {
        plant.check()?;
        // Q = ½·blkdiag(Q₁, Q₂) (eq. 59): each factor grows by √2
        let unit = |w, name, q| Ok::<_, PlantError>(over(w, &factor(name, q)?) * std::f64::consts::SQRT_2);
        let (g1, g2) = (unit(&plant.w1, "Q1", &plant.q1)?, unit(&plant.w2, "Q2", &plant.q2)?);
        // `factor` gives Nᵀ, and refuses outputs without noise
        let noise = factor("W2·W2ᵀ", &(&g2 * g2.transpose()))?;
        let c = over(&plant.c.transpose(), &noise).transpose();
        // N⁻ᵀ·(N⁻¹C); a Cholesky factor has no zero on its diagonal
        let weighted_c = noise.solve_upper_triangular(&c).unwrap_or_else(|| c.clone());
        Ok(Self { plant, g1, g2, c, weighted_c })
    }

    /// T with S₊ = T·Tᵀ of `riccati` at α.
    fn riccati(&self, alpha: f64) -> Option<DMatrix<f64>> {
        let n = self.plant.a.nrows();
        let a = &self.plant.a + DMatrix::identity(n, n) * (0.5 * alpha);
        stabilising(&a, &(self.c.transpose() * &self.c * alpha), &(&self.g1 * self.g1.transpose() / alpha))
    }

    /// Y = −α·CᵀR⁻¹, the best Y for every P.
    fn best_y(&self, alpha: f64) -> DMatrix<f64> {
        self.weighted_c.transpose() * -alpha
    }

    /// The negative of the left side of (7), −[Ψ + αP, PG₁, YG₂; ·, −αI, 0; ·, 0, −αI], for given P and Y.
    fn seven(&self, alpha: f64, p: &DMatrix<f64>, y: &DMatrix<f64>) -> DMatrix<f64> {
        let (n, l1, l2) = (p.nrows(), self.g1.ncols(), self.g2.ncols());
        let psi = p * &self.plant.a + y * &self.plant.c;
        let mut m = DMatrix::identity(n + l1 + l2, n + l1 + l2) * alpha;
        m.view_mut((0, 0), (n, n)).copy_from(&-(&psi + psi.transpose() + p * alpha));
        for (at, block) in [(n, p * &self.g1), (n + l1, y * &self.g2)] {
            m.view_mut((0, at), block.shape()).copy_from(&-&block);
            m.view_mut((at, 0), (block.ncols(), n)).copy_from(&-block.transpose());
        }
        m
    }

    /// The largest P in the coordinates x = T·x̃, as T⁻ᵀ·P̃·T⁻¹, and the time it took.
    ///
    /// (7) with Y eliminated: [−(A_αᵀP + PA_α) + α·CᵀR⁻¹C, PG₁; ·, αI] ⪰ 0.
    fn solve(&self, alpha: f64, t: &DMatrix<f64>, settings: &Settings) -> Result<(DMatrix<f64>, f64), DesignError> {
        let failed = |what: &str| DesignError::NotVerified { alpha, what: what.into(), margin: 0.0 };
        let t_inv = t.clone().try_inverse().ok_or_else(|| failed("the coordinates"))?;
        let n = t.nrows();
        let a = &t_inv * &self.plant.a * t + DMatrix::identity(n, n) * (0.5 * alpha);
        let (c, g1) = (&self.c * t, &t_inv * &self.g1);
        // z in coordinates in which it spans as much as x̃ does
        let e1 = &self.plant.e1 * t;
        let e1 = over(&e1.transpose(), &factor("E1", &(&e1 * e1.transpose()))?).transpose();
        let mut problem = Problem::new();
        let p = problem.symmetric(n);
        let x = problem.symmetric(e1.nrows());
        // divided by α, so that it says the same at every rate
        let decay = Affine::constant(c.transpose() * &c) - (&p * &a).plus_transpose().scaled(1.0 / alpha);
        let driven = (&p * &g1).transpose().scaled(1.0 / alpha);
        let seven = Affine::symmetric_block(&[vec![decay], vec![driven, Affine::identity(g1.ncols())]]);
        problem.positive_by("(7)", seven, MARGIN);
        problem.positive("P ⪰ E₁ᵀXE₁", &p - &e1.transpose() * &x * &e1);
        let q = e1.nrows();
        let row = |i: usize| DMatrix::from_fn(1, q, |_, j| if i == j { 1.0 } else { 0.0 });
        if settings.scaling {
        problem.maximize_log_det(1.0, &x);} else {
        problem.maximize((0..q).fold(Affine::zeros(1, 1), |sum, i| sum + &row(i) * &x * &row(i).transpose()));}
        match problem.solve(settings)? {
            Outcome::Optimal(s) => {println!("iterations {} {}", s.iterations, s.seconds); Ok((t_inv.transpose() * s.value(&p) * &t_inv, s.seconds))}
            other => Err(DesignError::refusal(alpha, other)),
        }
    }
}

/// Designs the paper's observer at α (1/s): max log det X subject to (7) and P − E₁ᵀXE₁ ⪰ 0 (eqs. 30, 31).
///
/// # Errors
/// A plant that does not fit, no observer at this rate, or a result that did not survive its checks: (7) by
/// eigenvalues, and the optimum by the Riccati equation.
pub fn design_continuous(plant: &Plant, alpha: f64) -> Result<ContinuousDesign, DesignError> {
    if !alpha.is_finite() || alpha <= 0.0 {
        return Err(DesignError::Rate(alpha));
    }
    let unit = Unit::of(plant)?;
    let n = plant.a.nrows();
    let not_verified = |what: &str, margin| DesignError::NotVerified { alpha, what: what.into(), margin };
    let reference = unit.riccati(alpha);
    let (p, solve_s) = match &reference {
        Some(t) => unit.solve(alpha, t, &Settings { scaling: false, ..Settings::default() })?,
        // nothing stabilises this plant at this rate: the program says why
        None => unit.solve(alpha, &DMatrix::identity(n, n), &Settings::default())?,
    };
    let p = (&p + p.transpose()) * 0.5;
    let y = unit.best_y(alpha);
    let gain = p.clone().cholesky().ok_or_else(|| not_verified("P", verify::margin(&p)))?.solve(&y);
    // judged with L itself: what is published is what is checked
    let checked = unit.seven(alpha, &p, &(&p * &gain));
    let margin = verify::margin(&checked);
    if margin <= verify::rounding(checked.nrows()) {
        return Err(not_verified("(7)", margin));
    }
    let p_z = projected(&p, &plant.e1).ok_or_else(|| not_verified("P_z", 0.0))?;
    let (volume, log_det) = volume(&p_z).ok_or_else(|| not_verified("P_z", 0.0))?;
    if let Some(t) = &reference {
        let best = log_det_shadow(&plant.e1, t).ok_or_else(|| not_verified("P_z", 0.0))?;
        if (best - log_det).abs() > AGREEMENT {
            return Err(not_verified("the optimum against the Riccati equation", log_det - best));
        }
    }
    let spread = p_z.clone().cholesky().ok_or_else(|| not_verified("P_z", 0.0))?.inverse();
    Ok(ContinuousDesign { alpha, gain, half_widths: half_widths(&spread), p, p_z, volume, log_det, margin, solve_s })
}

/// log det P_z for P = (T·Tᵀ)⁻¹.
fn log_det_shadow(e1: &DMatrix<f64>, t: &DMatrix<f64>) -> Option<f64> {
    let spread = e1 * t * t.transpose() * e1.transpose();
    Some(-spread.cholesky()?.l_dirty().diagonal().iter().map(|d| 2.0 * d.ln()).sum::<f64>())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::observers::quadratic_bounded::paper::hummingbird;

    #[test]
    fn explore() {
        for (alpha, expected) in
            [(0.05, 0.0329), (0.1, 0.01032), (0.17, 0.00726), (1.0, 0.7596), (2.0, 14.14), (2.77, 45.8), (10.0, 2659.9), (20.0, 0.0)]
        {
            let t = std::time::Instant::now();
            match design_continuous(&hummingbird(3), alpha) {
                Ok(d) => println!("{alpha}: {} vs {expected} ratio {:.5} margin {:.2e} solve {:.3} all {:?}", d.volume, d.volume / expected, d.margin, d.solve_s, t.elapsed()),
                Err(e) => println!("{alpha}: {e} {:?}", t.elapsed()),
            }
        }
    }
}
