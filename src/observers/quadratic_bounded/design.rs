use super::detect::unseen_motion;
use super::plant::{Plant, PlantError, factor, half_widths, over, projected, unit_ball, volume};
use super::riccati::stabilising;
use super::sampled::DesignError;
use super::tradeoff::{TradeOff, minimise};
use crate::sdp::{Affine, Outcome, Problem, Settings, verify};
use nalgebra::DMatrix;

/// Room asked for in the inequality (7), far above rounding and without visible cost in the bound.
const MARGIN: f64 = 1e-7;

/// Weight of tr P beside z's part of it: it settles the states that z leaves free, at no cost, since one P is largest
/// for all.
const OTHER_STATES: f64 = 0.01;

/// Rates at which a front is first computed, from this share of the fastest up to it.
const FRONT: usize = 60;
const SLOWEST: f64 = 1e-3;

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

    /// T with P₊ = (T·Tᵀ)⁻¹ of `riccati` at α.
    fn riccati(&self, alpha: f64) -> Option<DMatrix<f64>> {
        let n = self.plant.a.nrows();
        let a = -(self.plant.a.transpose() + DMatrix::identity(n, n) * (0.5 * alpha));
        let driven = &self.g1 * self.g1.transpose() / alpha;
        let seen = self.c.transpose() * &self.c * alpha;
        stabilising(&a, &driven, &seen)?.transpose().try_inverse()
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

    /// Solves (31) with (7) and (30) in the coordinates x = T·x̃; gives P and the time it took.
    ///
    /// Y is eliminated (see `riccati`), which leaves (7) as [−(A_αᵀP + PA_α) + α·CᵀR⁻¹C, PG₁; ·, αI] ⪰ 0. With the
    /// Riccati solution as T, and coordinates of z with E₁E₁ᵀ = I, the answer P̃ = I is expected. Then log det P_z is
    /// replaced by its tangent there, tr(E₁P̃E₁ᵀ): log det P_z is concave in P̃, so where the tangent is largest, it is.
    /// Without a reference the program is solved as it stands, with X.
    fn solve(&self, alpha: f64, coordinates: Option<&DMatrix<f64>>) -> Result<(DMatrix<f64>, f64), DesignError> {
        let n = self.plant.a.nrows();
        let t = coordinates.cloned().unwrap_or_else(|| DMatrix::identity(n, n));
        let singular = || DesignError::NotVerified { alpha, what: "the coordinates".into(), margin: 0.0 };
        let t_inv = t.clone().try_inverse().ok_or_else(singular)?;
        let a = &t_inv * &self.plant.a * &t + DMatrix::identity(n, n) * (0.5 * alpha);
        let (c, g1) = (&self.c * &t, &t_inv * &self.g1);
        let e1 = &self.plant.e1 * &t;
        let e1 = over(&e1.transpose(), &factor("E1", &(&e1 * e1.transpose()))?).transpose();
        let mut problem = Problem::new();
        let p = problem.symmetric(n);
        // divided by α, so that it says the same at every rate
        let decay = Affine::constant(c.transpose() * &c) - (1.0 / alpha) * (&p * &a).plus_transpose();
        let driven = (1.0 / alpha) * (&p * &g1).transpose();
        let seven = Affine::symmetric_block(&[vec![decay], vec![driven, Affine::identity(g1.ncols())]]);
        problem.positive_by("(7)", seven, MARGIN);
        if coordinates.is_some() {
            problem.maximize((&e1 * &p * &e1.transpose()).trace() + OTHER_STATES * p.trace());
        } else {
            let x = problem.symmetric(e1.nrows());
            problem.positive("P ⪰ E₁ᵀXE₁", &p - &e1.transpose() * &x * &e1);
            problem.maximize_log_det(1.0, &x);
        }
        let settings = Settings { scaling: coordinates.is_none(), ..Settings::default() };
        match problem.solve(&settings)? {
            Outcome::Optimal(s) => Ok((t_inv.transpose() * s.value(&p) * &t_inv, s.seconds)),
            other => Err(DesignError::refusal(&self.plant.a, &self.plant.c, alpha, other)),
        }
    }

    /// (α, volume) at `count` + 1 rates; they matter by their ratio, and the volume runs to infinity at zero.
    fn front(&self, fastest: f64, count: usize) -> Vec<(f64, f64)> {
        let rate = |k: usize| fastest * SLOWEST.powf(1.0 - k as f64 / count.max(1) as f64);
        (0..=count).filter_map(|k| Some((rate(k), self.best_volume(rate(k)).filter(|v| v.is_finite())?))).collect()
    }

    /// Volume of z's ellipsoid at the optimum, from the Riccati equation.
    fn best_volume(&self, alpha: f64) -> Option<f64> {
        let log_det = log_det_shadow(&self.plant.e1, &self.riccati(alpha)?)?;
        Some(unit_ball(self.plant.e1.nrows()) * (-0.5 * log_det).exp())
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
    let not_verified = |what: &str, margin| DesignError::NotVerified { alpha, what: what.into(), margin };
    // without a reference nothing stabilises this plant at this rate, and the program says why
    let reference = unit.riccati(alpha);
    let (p, solve_s) = unit.solve(alpha, reference.as_ref())?;
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

/// The smallest volume at each of `count` rates up to `fastest` (1/s), evenly spaced by their ratio: Fig. 4 of the paper.
/// Rates without an observer are left out.
///
/// # Errors
/// A plant that does not fit, or a rate that is not positive.
pub fn front(plant: &Plant, fastest: f64, count: usize) -> Result<Vec<(f64, f64)>, DesignError> {
    if !fastest.is_finite() || fastest <= 0.0 {
        return Err(DesignError::Rate(fastest));
    }
    let unit = Unit::of(plant)?;
    Ok(unit.front(fastest, count))
}

/// The smallest and the fastest design up to `fastest` (1/s), and for every μ the rate with the least J_μ (eq. 25).
///
/// # Errors
/// A plant that does not fit, a rate that is not positive, or no observer at any rate.
pub fn choose_rates(plant: &Plant, fastest: f64, mus: &[f64]) -> Result<(TradeOff, Vec<f64>), DesignError> {
    if !fastest.is_finite() || fastest <= 0.0 {
        return Err(DesignError::Rate(fastest));
    }
    let unit = Unit::of(plant)?;
    let volume = |alpha: f64| unit.best_volume(alpha).unwrap_or(f64::INFINITY);
    let mut front = unit.front(fastest, FRONT);
    let refine = |front: &[(f64, f64)], at: f64, cost: &dyn Fn((f64, f64)) -> f64| {
        let k = front.iter().position(|p| p.0 == at).unwrap_or(0);
        let (lo, hi) = (front[k.saturating_sub(1)].0, front[(k + 1).min(front.len() - 1)].0);
        let log = minimise(lo.ln(), hi.ln(), 1e-4, |x| cost((x.exp(), volume(x.exp()))));
        // at an end of the range the end itself may be best
        [(at, volume(at)), (log.exp(), volume(log.exp()))].into_iter().min_by(|a, b| cost(*a).total_cmp(&cost(*b)))
    };
    let coarse = TradeOff::of(&front).ok_or_else(|| DesignError::Infeasible {
        alpha: fastest,
        why: unseen_motion(&plant.a, &plant.c, fastest).unwrap_or_else(|| "no rate has a solution".into()),
    })?;
    front.extend(refine(&front, coarse.smallest.0, &|p| p.1));
    front.sort_by(|a, b| a.0.total_cmp(&b.0));
    let trade = TradeOff::of(&front).unwrap_or(coarse);
    let chosen = mus.iter().filter_map(|&mu| {
        let (at, _) = trade.choose(mu, &front)?;
        Some(refine(&front, at, &|p| trade.cost(mu, p))?.0)
    });
    Ok((trade, chosen.collect()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::observers::quadratic_bounded::paper::hummingbird;
    use nalgebra::dmatrix;

    #[test]
    fn published_volumes() {
        for (alpha, expected) in
            [(0.05, 0.0329), (0.1, 0.01032), (0.17, 0.00726), (1.0, 0.7596), (2.0, 14.14), (10.0, 2659.9)]
        {
            let d = design_continuous(&hummingbird(3), alpha).unwrap();
            println!("{alpha}: {} {} {} s", d.volume, d.margin, d.solve_s);
            assert!((d.volume / expected - 1.0).abs() < 1e-3, "α {alpha}: {}", d.volume);
            assert!(d.margin > 0.0);
        }
    }

    #[test]
    fn published_trade_offs() {
        let plant = hummingbird(3);
        let (trade, chosen) = choose_rates(&plant, 20.0, &[0.95, 0.2]).unwrap();
        println!("{trade:?} {chosen:?}");
        assert!((trade.smallest.0 - 0.173).abs() < 0.002);
        assert!((chosen[0] - 2.77).abs() < 0.02 * 2.77);
        assert!((design_continuous(&plant, chosen[0]).unwrap().volume / 45.8 - 1.0).abs() < 0.02);
        assert!(chosen[1] > 19.9);
    }

    /// The paper's experiment: 2 N steps of force, outputs at 100 Hz with errors uniform in Q₂'s ellipsoid.
    ///
    /// The continuous observer runs by the exact solution of its own equation under held outputs.
    #[test]
    fn the_papers_steps_are_followed() {
        use rand::{RngExt, SeedableRng, rngs::StdRng};
        let plant = hummingbird(3);
        let (n, dt) = (plant.a.nrows(), 0.01);
        let gain = design_continuous(&plant, 2.77).unwrap().gain;
        // exp([A+LC, L; 0, 0]·Δ) = [e^{(A+LC)Δ}, ∫e^{(A+LC)s}ds·L; 0, I]
        let mut joint = DMatrix::zeros(n + 9, n + 9);
        joint.view_mut((0, 0), (n, n)).copy_from(&(&plant.a + &gain * &plant.c));
        joint.view_mut((0, n), (n, 9)).copy_from(&gain);
        let joint = (joint * dt).exp();
        let (f, h) = (joint.view((0, 0), (n, n)).clone_owned(), joint.view((0, n), (n, 9)).clone_owned());
        let r = factor("Q2", &plant.q2).unwrap();
        let mut rng = StdRng::seed_from_u64(58);
        let mut normal = || {
            let (a, b): (f64, f64) = (rng.random_range(f64::MIN_POSITIVE..1.0), rng.random());
            (-2.0 * a.ln()).sqrt() * (std::f64::consts::TAU * b).cos()
        };
        // a point uniform in the unit ball of R⁹ is the first part of one uniform on the sphere of R¹¹
        let mut noise = || {
            let v = nalgebra::DVector::from_fn(11, |_, _| normal()).normalize();
            r.solve_upper_triangular(&DMatrix::from_column_slice(9, 1, &v.as_slice()[..9])).unwrap()
        };
        let (mut truth, mut estimate) = (DMatrix::<f64>::zeros(n, 1), DMatrix::<f64>::zeros(n, 1));
        let (mut sums, mut count) = ([0.0; 3], 0);
        for k in 0..2000 {
            let t = k as f64 * dt;
            // held from 5 to 15 s: up, down, off; each for 5 s
            let level = [0.0, 2.0, -2.0, 0.0][(t / 5.0) as usize];
            (0..3).for_each(|i| truth[(6 + i, 0)] = level);
            let error = noise();
            assert!((error.transpose() * &plant.q2 * &error)[(0, 0)] <= 1.0 + 1e-9);
            let y = &plant.c * &truth + error;
            estimate = &f * &estimate - &h * &y;
            // truth: p grows by d·Δ, the known input is taken out on both sides
            for i in 0..6 {
                truth[(i, 0)] += truth[(6 + i, 0)] * dt;
            }
            if t % 5.0 > 3.0 {
                (0..3).for_each(|i| sums[i] += (estimate[(6 + i, 0)] - level).powi(2));
                count += 1;
            }
        }
        let rmse = sums.map(|s: f64| (s / count as f64).sqrt());
        println!("force RMSE after settling: {rmse:.3?} N");
        assert!(rmse.iter().all(|r| *r <= 0.35));
    }

    /// One axis: (p, d), both measured.
    fn axis() -> Plant {
        Plant {
            a: dmatrix![0.0, 1.0; 0.0, 0.0],
            w1: dmatrix![0.0; 1.0],
            q1: dmatrix![0.04],
            c: dmatrix![1.0, 0.0; 0.0, 1.0],
            w2: DMatrix::identity(2, 2),
            q2: dmatrix![4.0, 0.0; 0.0, 1.0],
            e1: dmatrix![0.0, 1.0],
        }
    }

    #[test]
    fn the_program_as_it_stands_finds_what_the_riccati_equation_finds() {
        for alpha in [0.1, 1.0, 10.0] {
            let plant = axis();
            let unit = Unit::of(&plant).unwrap();
            let (p, _) = unit.solve(alpha, None).unwrap();
            let log_det = projected(&p, &plant.e1).unwrap()[(0, 0)].ln();
            let expected = log_det_shadow(&plant.e1, &unit.riccati(alpha).unwrap()).unwrap();
            assert!((log_det - expected).abs() < 1e-5, "{log_det} {expected}");
        }
    }

    #[test]
    fn units_do_not_matter() {
        let plant = axis();
        let reference = design_continuous(&plant, 2.0).unwrap();
        // momentum in µN·s, force in MN
        let d = dmatrix![1e6, 0.0; 0.0, 1e-6];
        let d_inv = dmatrix![1e-6, 0.0; 0.0, 1e6];
        let scaled = Plant {
            a: &d * &plant.a * &d_inv,
            w1: &d * &plant.w1,
            c: &plant.c * &d_inv,
            e1: &plant.e1 * &d_inv,
            ..plant
        };
        let other = design_continuous(&scaled, 2.0).unwrap();
        assert!((other.volume / reference.volume - 1.0).abs() < 1e-4);
        assert!((&d_inv * &other.gain - &reference.gain).amax() < 1e-3 * reference.gain.amax());
        // and where the program has no reference to lean on
        let (p, _) = Unit::of(&scaled).unwrap().solve(2.0, None).unwrap();
        assert!((projected(&p, &scaled.e1).unwrap()[(0, 0)].ln() - reference.log_det).abs() < 1e-4);
    }

    #[test]
    fn an_unobservable_drift_is_infeasible_and_says_so() {
        let plant = Plant { c: dmatrix![0.0, 1.0], w2: dmatrix![1.0], q2: dmatrix![1.0], ..axis() };
        let error = design_continuous(&plant, 0.5).unwrap_err();
        assert!(matches!(error, DesignError::Infeasible { .. }), "{error}");
        assert!(matches!(choose_rates(&plant, 20.0, &[0.5]), Err(DesignError::Infeasible { .. })));
    }

    #[test]
    fn wrong_rates_and_plants_are_refused() {
        assert_eq!(design_continuous(&axis(), 0.0), Err(DesignError::Rate(0.0)));
        assert!(matches!(design_continuous(&axis(), f64::NAN), Err(DesignError::Rate(_))));
        let plant = Plant { q2: -axis().q2, ..axis() };
        assert!(matches!(design_continuous(&plant, 1.0), Err(DesignError::Plant(_))));
        // an output without noise: R is singular
        let plant = Plant { w2: dmatrix![1.0, 0.0; 0.0, 0.0], ..axis() };
        assert!(matches!(design_continuous(&plant, 1.0), Err(DesignError::Plant(_))));
    }
}
