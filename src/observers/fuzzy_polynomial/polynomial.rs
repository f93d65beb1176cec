//! Theorem 1: designs by sums of squares on the polynomial model, and analyses of gains designed otherwise.

use super::design::{Design, DesignError, Gain, Method, Options};
use super::inequalities::{Gains, Inequalities, Kind};
use super::plant::{HALF_TURN, MIRROR, Plant};
use super::takagi_sugeno::{MARGIN, SETTINGS, block_diagonal};
use super::units::Units;
use crate::sdp::{Affine, Outcome, Problem, Solution, verify};
use crate::sos::{Certificate, Family, Local, Monomial, Polynomial, positive_on};
use nalgebra::DMatrix;

/// Units of speed in which a program is tried in turn, as factors: none is good for every plant and rate.
const SPEED_FACTORS: [f64; 4] = [1.0, 4.0, 0.5, 12.0];
/// Shares of γ that may be given up for room, in turn.
const GIVEN_UP: [f64; 3] = [1e-3, 5e-3, 0.02];

/// SOS-2G: minimises γ over (13)–(16) with a gain for each vertex.
///
/// Both vertices are mirror images (see [`MIRROR`]): the program holds one of them.
pub(super) fn design(plant: &Plant, alpha: f64, options: Options) -> Result<Proven, DesignError> {
    let polynomial_gains = options.polynomial_gains;
    solve(plant, Method::SumsOfSquares, alpha, polynomial_gains, |problem, _, _| Gains {
        constant: gain(problem, None),
        by_speed: if polynomial_gains { (0..3).map(|k| gain(problem, Some(k))).collect() } else { Vec::new() },
    })
}

/// The design that these numbers are, if they prove it.
pub(super) fn prove(plant: &Plant, alpha: f64, options: Options, numbers: &Numbers) -> Result<Design, DesignError> {
    plant.check()?;
    let units = Units::of(plant, alpha, numbers.speed_factor);
    let polynomial_gains = options.polynomial_gains;
    Program { plant, units: &units, method: Method::SumsOfSquares, alpha, polynomial_gains }.prove(numbers, 0.0)
}

/// LM-A and TS-1GA: minimises γ over (13)–(15) with the single gain of another design.
pub(super) fn analyse(plant: &Plant, method: Method, of: &Design) -> Result<Design, DesignError> {
    let gain = &of.gains[0].constant;
    let judged = solve(plant, method, of.alpha, false, |_, units, p| Gains {
        constant: p * &units.gain(gain),
        by_speed: Vec::new(),
    })?;
    Ok(Design { solve_s: judged.design.solve_s + of.solve_s, ..judged.design })
}

/// Minimises γ, in one unit of speed after the other until the numbers survive their check.
///
/// Where the optimum lies so close to the border that they fail in each, γ is given up a little and any point inside is
/// taken: the inequalities then have room.
fn solve(
    plant: &Plant,
    method: Method,
    alpha: f64,
    polynomial_gains: bool,
    gains: impl Fn(&mut Problem, &Units, &Affine) -> Gains,
) -> Result<Proven, DesignError> {
    let mut refused = None;
    let mut best: Option<f64> = None;
    let attempt = |factor: f64, given: Option<f64>| {
        let units = Units::of(plant, alpha, factor);
        let program = Program { plant, units: &units, method, alpha, polynomial_gains };
        program.attempt(factor, |problem, p| gains(problem, &units, p), given)
    };
    for factor in SPEED_FACTORS {
        match attempt(factor, None) {
            (Ok(proven), _) => return Ok(proven),
            (Err(e), gamma) => {
                best = gamma.filter(|g| *g > 0.0).map(|g| best.map_or(g, |b| b.max(g))).or(best);
                refused.get_or_insert(e);
            }
        }
    }
    for given_up in best.into_iter().flat_map(|g| GIVEN_UP.map(|share| g * (1.0 + share))) {
        if let Some(proven) = SPEED_FACTORS.iter().find_map(|&factor| attempt(factor, Some(given_up)).0.ok()) {
            return Ok(proven);
        }
    }
    Err(refused.unwrap_or(DesignError::Rate(alpha)))
}

/// An unknown 6×3 H, for the constant part or for what one speed adds, with the entries that a half turn about yaw
/// allows.
fn gain(problem: &mut Problem, speed: Option<usize>) -> Affine {
    let sign = speed.map_or(1.0, |k| HALF_TURN.axes[k]);
    let entries = (0..6).flat_map(|i| (0..3).map(move |j| (i, j)));
    let allowed = entries.filter(|(i, j)| HALF_TURN.axes[i / 2] * HALF_TURN.axes[*j] * sign > 0.0);
    let unknowns: Vec<_> = allowed.map(|at| (at, problem.scalar())).collect();
    Affine::from_entries(6, 3, unknowns)
}

/// The inequalities for one vertex, and what is known about them.
struct Program<'a> {
    plant: &'a Plant,
    units: &'a Units,
    method: Method,
    alpha: f64,
    polynomial_gains: bool,
}

impl Program<'_> {
    /// (16) is a demand on designs only.
    fn kinds(&self) -> &'static [Kind] {
        if self.method == Method::SumsOfSquares {
            &[Kind::Dissipation, Kind::Decay, Kind::Smooth]
        } else {
            &[Kind::Dissipation, Kind::Decay]
        }
    }

    fn family(&self, v: &Inequalities<'_>, kind: Kind, p: &Affine, h: &Gains, gamma: &Affine) -> Family {
        match kind {
            Kind::Dissipation => v.dissipation(p, h, gamma),
            Kind::Decay => v.decay(p, h, self.alpha),
            Kind::Smooth => v.smooth(p, h),
        }
    }

    fn region(&self, v: &Inequalities<'_>, kind: Kind) -> Vec<(Polynomial, Vec<Monomial>)> {
        v.region(self.polynomial_gains, kind == Kind::Dissipation)
    }

    /// A design with γ minimised or given, and the γ at which the solver ended.
    fn attempt(
        &self,
        speed_factor: f64,
        gains: impl FnOnce(&mut Problem, &Affine) -> Gains,
        given: Option<f64>,
    ) -> (Result<Proven, DesignError>, Option<f64>) {
        let vertex = Inequalities::new(self.plant, self.units, 1.0);
        let mut problem = Problem::new();
        let p = block_diagonal(&mut problem);
        let gamma = given.map_or_else(
            || problem.scalar(),
            |g| Affine::constant(DMatrix::from_element(1, 1, g / self.units.weight.powi(2))),
        );
        let h = gains(&mut problem, &p);
        let mut locals = Vec::new();
        for &kind in self.kinds() {
            let family = self.family(&vertex, kind, &p, &h, &gamma);
            let basis = vertex.basis(self.polynomial_gains, kind);
            let region = self.region(&vertex, kind);
            match positive_on(&mut problem, &vertex.names, title(kind), &family, &region, &basis, MARGIN) {
                Ok(local) => locals.push(local),
                Err(e) => return (Err(e.into()), None),
            }
        }
        if given.is_none() {
            problem.minimize(&gamma);
        }
        let s = match problem.solve(&SETTINGS).map(Outcome::best) {
            Ok(Ok(s)) => s,
            Ok(Err(outcome)) => return (Err(DesignError::refusal(self.method, self.alpha, &outcome)), None),
            Err(e) => return (Err(e.into()), None),
        };
        let gamma = s.value(&gamma)[(0, 0)] * self.units.weight.powi(2);
        let proven = self.numbers(&s, &p, &h, gamma, &locals).and_then(|numbers| {
            let numbers = Numbers { speed_factor, ..numbers };
            let design = self.prove(&numbers, s.seconds)?;
            Ok(Proven { numbers, design })
        });
        (proven, Some(gamma))
    }

    /// What is published, from a solution.
    fn numbers(
        &self,
        s: &Solution,
        p: &Affine,
        h: &Gains,
        gamma: f64,
        locals: &[Local],
    ) -> Result<Numbers, DesignError> {
        let p = s.value(p);
        let factor = p.clone().cholesky().ok_or_else(|| self.not_verified("P", verify::margin(&p)))?;
        let gain = |h: &Affine| self.units.gain_back(&factor.solve(&s.value(h)));
        Ok(Numbers {
            constant: gain(&h.constant),
            // per rad/s of an estimated speed
            by_speed: h.by_speed.iter().map(|h| gain(h) / self.plant.radius2.sqrt()).collect(),
            gamma,
            speed_factor: 1.0,
            p: self.units.lyapunov_back(&p),
            certificates: locals.iter().map(|l| l.certificate(s)).collect(),
        })
    }

    fn not_verified(&self, what: &'static str, margin: f64) -> DesignError {
        DesignError::NotVerified { method: self.method.name(), alpha: self.alpha, what, margin }
    }

    /// The inequalities written down anew from what is published (P, L, γ), each compared with its certificate; the
    /// second vertex as the mirror image of the first.
    fn prove(&self, numbers: &Numbers, solve_s: f64) -> Result<Design, DesignError> {
        let p = self.units.lyapunov(&numbers.p);
        let mut worst = verify::margin(&p) - verify::rounding(6);
        let scaled = |l: &DMatrix<f64>| Affine::constant(&p * self.units.gain(l));
        let gamma = Affine::constant(DMatrix::from_element(1, 1, numbers.gamma / self.units.weight.powi(2)));
        let mirror = Inequalities::signs(MIRROR.axes);
        if numbers.certificates.len() != self.kinds().len() || worst <= 0.0 {
            return Err(self.not_verified("P", worst));
        }
        for (&kind, certificate) in self.kinds().iter().zip(&numbers.certificates) {
            let written = |momentum: f64, l0: &DMatrix<f64>, by_speed: &[DMatrix<f64>]| {
                let vertex = Inequalities::new(self.plant, self.units, momentum);
                let shares = by_speed.iter().map(|l| scaled(&(l * self.plant.radius2.sqrt())));
                let h = Gains { constant: scaled(l0), by_speed: shares.collect() };
                let family = self.family(&vertex, kind, &Affine::constant(p.clone()), &h, &gamma);
                let region: Vec<Polynomial> = self.region(&vertex, kind).into_iter().map(|r| r.0).collect();
                (family.constant_part(), region)
            };
            let (first, region) = written(1.0, &numbers.constant, &numbers.by_speed);
            let (l0, by_speed) = numbers.mirrored();
            // the regions are spheres, which the mirror leaves as they are
            let second = written(-1.0, &l0, &by_speed).0.with_signs(&mirror);
            for polynomial in [&first, &second] {
                let check = certificate.check(polynomial, &region);
                if check.margin.is_nan() || check.margin <= 0.0 {
                    return Err(self.not_verified(title(kind), check.margin));
                }
                worst = worst.min(check.margin);
            }
        }
        Ok(Design {
            method: self.method,
            alpha: self.alpha,
            gain_bound: numbers.gamma.sqrt(),
            gains: numbers.gains(),
            p: numbers.p.clone(),
            margin: worst,
            solve_s,
        })
    }
}

fn title(kind: Kind) -> &'static str {
    match kind {
        Kind::Dissipation => "(14)",
        Kind::Decay => "(15)",
        Kind::Smooth => "(16)",
    }
}

/// What is published, in the plant's own units, and what proves it, in scaled ones.
#[derive(Debug, Clone)]
pub(super) struct Numbers {
    pub(super) constant: DMatrix<f64>,
    pub(super) by_speed: Vec<DMatrix<f64>>,
    pub(super) gamma: f64,
    pub(super) p: DMatrix<f64>,
    /// Unit of speed in which the certificates are written, see [`Units::of`].
    pub(super) speed_factor: f64,
    /// One for each inequality.
    pub(super) certificates: Vec<Certificate>,
}

/// A design with its proof.
pub(super) struct Proven {
    pub(super) numbers: Numbers,
    pub(super) design: Design,
}

impl Numbers {
    /// The gains of the mirrored vertex: L(x̂) becomes S·L(S·x̂)·S_y.
    fn mirrored(&self) -> (DMatrix<f64>, Vec<DMatrix<f64>>) {
        let by_speed = self.by_speed.iter().zip(MIRROR.axes).map(|(l, sign)| MIRROR.gain(l) * sign).collect();
        (MIRROR.gain(&self.constant), by_speed)
    }

    fn gains(&self) -> Vec<Gain> {
        let gain = |momentum, (constant, by_speed)| Gain { momentum, premises: None, constant, by_speed };
        vec![gain(1.0, (self.constant.clone(), self.by_speed.clone())), gain(-1.0, self.mirrored())]
    }
}
