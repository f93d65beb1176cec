use super::plant::Polytope;
use crate::observers::quadratic_bounded::unseen_motion;
use crate::sdp::{Affine, Outcome, Problem, ProblemError, Settings, verify};
use nalgebra::DMatrix;

/// Room asked for in the decay inequality, above the solver's tolerance.
const MARGIN: f64 = 1e-7;
/// Below this share of the largest a singular value counts as zero.
const RANK_TOLERANCE: f64 = 1e-9;
/// How closely the fastest decay is found, as a share.
const DECAY_TOLERANCE: f64 = 1e-3;

/// What a design makes best.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Objective {
    /// The smallest bound on every ‖Lᵢ‖ at which errors decay as e^{−decay·t} (1/s).
    SmallestGain { decay: f64 },
    /// The fastest decay with every ‖Lᵢ‖ at most this.
    FastestDecay { gain: f64 },
}

/// Why there is no observer.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum DesignError {
    #[error("the {what} is {value}; it must be positive and finite")]
    Parameter { what: &'static str, value: f64 },
    #[error("the plant's {what} is {}×{}, expected {}×{}", found.0, found.1, expected.0, expected.1)]
    Dimension { what: &'static str, found: (usize, usize), expected: (usize, usize) },
    /// Condition 1 of Theorem 1, for outputs that need no derivative beyond the first.
    #[error(
        "corner {corner}: rank(C·E) = {rank} but {inputs} unknown inputs: no measured output feels them at its first \
         derivative. Angles alone show a torque only at the second; send body rates too"
    )]
    NotDecoupled { corner: usize, rank: usize, inputs: usize },
    /// The derivative-free form needs one decoupling matrix for all corners.
    #[error("the decoupling matrix Q = E·(C·E)⁺ differs by {difference:.1e} between corners 0 and {corner}")]
    DecouplingVaries { corner: usize, difference: f64 },
    /// Condition 2 of Theorem 1.
    #[error("corners {i}, {j}: (A − Q·M, C) is not detectable at a decay of {decay} /s: {why}")]
    NotDetectable { i: usize, j: usize, decay: f64, why: String },
    #[error("no common Lyapunov function and gains exist: {0}")]
    Infeasible(String),
    #[error("corners {i}, {j}: the solver's answer does not satisfy (22): margin {margin:.1e}")]
    NotVerified { i: usize, j: usize, margin: f64 },
    #[error("the program is stated wrongly: {0}")]
    Problem(#[from] ProblemError),
}

/// Gains of the observer (10) in its derivative-free form, proven for the whole polytope.
#[derive(Debug, Clone, PartialEq)]
pub struct UnknownInputDesign {
    /// Q = E(CE)⁺ of Theorem 1, the same at every corner.
    pub q: DMatrix<f64>,
    /// M = C·A of (8b), one for each corner.
    pub m: Vec<DMatrix<f64>>,
    /// Γ = C·E of (9), one for each corner.
    pub gamma: Vec<DMatrix<f64>>,
    /// Lⱼ of (23), one for each corner.
    pub gains: Vec<DMatrix<f64>>,
    /// X of (19), scaled so that X ⪰ I.
    pub x: DMatrix<f64>,
    /// Errors decay at least as e^{−decay·t}, 1/s.
    pub decay: f64,
    /// Every ‖Lⱼ‖₂ is at most this.
    pub gain_bound: f64,
    /// Smallest [`verify::margin`] of (22) over all pairs of corners.
    pub margin: f64,
    pub solve_s: f64,
}

/// Designs the observer.
///
/// For every pair of corners, with X ⪰ I and Kⱼ = X·Lⱼ (23), the corrected (22):
/// ```text
/// (Aⱼ − QᵢMⱼ)ᵀX + X(Aⱼ − QᵢMⱼ) − CᵀKⱼᵀ − KⱼC + 2δX ≺ 0
/// ```
/// As printed, QM enters with both signs and drops out, and (21) has A where Aᵀ belongs and K = L·C for K = X·L. The
/// decay δ and the bound [κI, Kⱼ; Kⱼᵀ, κI] ⪰ 0, which with X ⪰ I gives ‖Lⱼ‖ ≤ κ, are additions.
///
/// # Errors
/// The condition of Theorem 1 that fails, with the corner and the reason; or an answer that did not survive its check.
pub fn design(plant: &Polytope, objective: Objective) -> Result<UnknownInputDesign, DesignError> {
    let decoupled = Decoupled::of(plant)?;
    match objective {
        Objective::SmallestGain { decay } => {
            positive("decay", decay)?;
            decoupled.detectable(decay)?;
            decoupled.certify(decoupled.solve(decay)?, decay)
        }
        Objective::FastestDecay { gain } => {
            positive("gain", gain)?;
            decoupled.fastest(gain)
        }
    }
}

fn positive(what: &'static str, value: f64) -> Result<(), DesignError> {
    if value.is_finite() && value > 0.0 { Ok(()) } else { Err(DesignError::Parameter { what, value }) }
}

/// What the program gives: X, the Kⱼ, the bound κ, and the solver's time.
struct Solved {
    x: DMatrix<f64>,
    k: Vec<DMatrix<f64>>,
    gain_bound: f64,
    solve_s: f64,
}

/// The plant with its unknown input taken out: A − Q·M, for every pair of corners.
struct Decoupled<'a> {
    plant: &'a Polytope,
    q: DMatrix<f64>,
    m: Vec<DMatrix<f64>>,
    gamma: Vec<DMatrix<f64>>,
}

impl<'a> Decoupled<'a> {
    fn of(plant: &'a Polytope) -> Result<Self, DesignError> {
        let n = plant.c.ncols();
        let shape = |what, found, expected| match found == expected {
            true => Ok(()),
            false => Err(DesignError::Dimension { what, found, expected }),
        };
        let inputs = plant.vertices.first().map_or(0, |v| v.e.ncols());
        let (mut q, mut m, mut gamma) = (None, Vec::new(), Vec::new());
        for (corner, v) in plant.vertices.iter().enumerate() {
            shape("A", v.a.shape(), (n, n))?;
            shape("E", v.e.shape(), (n, inputs))?;
            let seen = &plant.c * &v.e;
            let svd = seen.clone().svd(true, true);
            let largest = svd.singular_values.iter().copied().fold(0.0, f64::max);
            let rank = svd.singular_values.iter().filter(|s| **s > RANK_TOLERANCE * largest.max(1e-300)).count();
            if rank < inputs || inputs == 0 {
                return Err(DesignError::NotDecoupled { corner, rank, inputs });
            }
            // of full column rank, so the pseudo-inverse exists; its tolerance lies below the smallest singular value
            let inverse = svd.pseudo_inverse(0.0).map_err(|_| DesignError::NotDecoupled { corner, rank, inputs })?;
            let own = &v.e * inverse;
            let first = q.get_or_insert_with(|| own.clone());
            let difference = (&own - &*first).amax();
            if difference > 1e-9 * (1.0 + first.amax()) {
                return Err(DesignError::DecouplingVaries { corner, difference });
            }
            m.push(&plant.c * &v.a);
            gamma.push(seen);
        }
        let q = q.ok_or(DesignError::NotDecoupled { corner: 0, rank: 0, inputs })?;
        Ok(Self { plant, q, m, gamma })
    }

    /// Aⱼ − Q·Mⱼ; Q is the same for all i.
    fn drift(&self, j: usize) -> DMatrix<f64> {
        &self.plant.vertices[j].a - &self.q * &self.m[j]
    }

    fn corners(&self) -> std::ops::Range<usize> {
        0..self.plant.vertices.len()
    }

    /// The corners with different drifts, and for every corner the place among these.
    fn distinct(&self) -> (Vec<usize>, Vec<usize>) {
        let (mut distinct, mut place): (Vec<usize>, Vec<usize>) = (Vec::new(), Vec::new());
        for j in self.corners() {
            let own = self.drift(j);
            let same = distinct.iter().position(|&i| (self.drift(i) - &own).amax() <= 1e-12 * (1.0 + own.amax()));
            place.push(same.unwrap_or(distinct.len()));
            if same.is_none() {
                distinct.push(j);
            }
        }
        (distinct, place)
    }

    fn detectable(&self, decay: f64) -> Result<(), DesignError> {
        for j in self.corners() {
            if let Some(why) = unseen_motion(&self.drift(j), &self.plant.c, 2.0 * decay) {
                return Err(DesignError::NotDetectable { i: j, j, decay, why });
            }
        }
        Ok(())
    }

    fn solve(&self, decay: f64) -> Result<Solved, DesignError> {
        let (n, p) = (self.plant.c.ncols(), self.plant.c.nrows());
        let mut problem = Problem::new();
        let (x, kappa) = (problem.symmetric(n), problem.scalar());
        problem.positive("X ⪰ I", &x - Affine::identity(n));
        let mut gains = Vec::new();
        // corners that differ in what Q takes out alone, as those of an attitude, share their gain
        let (distinct, place) = self.distinct();
        for j in distinct {
            let k = problem.matrix(n, p);
            let moved = &x * &(self.drift(j) + DMatrix::identity(n, n) * decay) - &k * &self.plant.c;
            // divided by the decay, so that it says the same at every rate
            problem.positive_by(format!("(22), corner {j}"), -(1.0 / decay) * moved.plus_transpose(), MARGIN);
            let round = |size: usize| diagonal(&kappa, size);
            problem.positive(
                format!("‖K{j}‖ ≤ κ"),
                Affine::symmetric_block(&[vec![round(n)], vec![k.transpose(), round(p)]]),
            );
            gains.push(k);
        }
        problem.minimize(&kappa);
        match problem.solve(&Settings::default())? {
            Outcome::Optimal(s) => {
                let k = place.iter().map(|&at| s.value(&gains[at])).collect();
                Ok(Solved { x: s.value(&x), k, gain_bound: s.value(&kappa)[(0, 0)], solve_s: s.seconds })
            }
            Outcome::Infeasible(certificate) => Err(DesignError::Infeasible(certificate.to_string())),
            Outcome::Unbounded(ray) => Err(DesignError::Infeasible(ray.to_string())),
            Outcome::Inaccurate { reason, .. } => Err(DesignError::Infeasible(reason)),
        }
    }

    fn certify(&self, solved: Solved, decay: f64) -> Result<UnknownInputDesign, DesignError> {
        let Solved { x, k, gain_bound, solve_s } = solved;
        let x = (&x + x.transpose()) * 0.5;
        let refuse = |j, margin| DesignError::NotVerified { i: j, j, margin };
        let factor = x.clone().cholesky().ok_or_else(|| refuse(0, verify::margin(&x)))?;
        let gains: Vec<DMatrix<f64>> = k.iter().map(|k| factor.solve(k)).collect();
        let mut margin = f64::INFINITY;
        for (j, gain) in gains.iter().enumerate() {
            // judged with L itself: what runs is what is checked
            let n = x.nrows();
            let closed = self.drift(j) - gain * &self.plant.c + DMatrix::identity(n, n) * decay;
            let left = -(closed.transpose() * &x + &x * closed);
            let own = verify::margin(&left);
            if own <= verify::rounding(n) {
                return Err(refuse(j, own));
            }
            margin = margin.min(own);
        }
        let largest = gains.iter().map(|l| l.clone().svd(false, false).singular_values.max()).fold(0.0, f64::max);
        Ok(UnknownInputDesign {
            q: self.q.clone(),
            m: self.m.clone(),
            gamma: self.gamma.clone(),
            gains,
            x,
            decay,
            gain_bound: gain_bound.max(largest),
            margin,
            solve_s,
        })
    }

    /// The gain needed grows with the decay: bisection on it.
    fn fastest(&self, gain: f64) -> Result<UnknownInputDesign, DesignError> {
        let at = |decay: f64| -> Result<UnknownInputDesign, DesignError> {
            self.detectable(decay)?;
            self.certify(self.solve(decay)?, decay)
        };
        let fits = |d: &Result<UnknownInputDesign, DesignError>| d.as_ref().is_ok_and(|d| d.gain_bound <= gain);
        // no gain of size κ moves a pole of the decoupled plant by more than about κ
        let (mut lo, mut hi) = (1e-3 * gain, 2.0 * gain);
        let mut best = at(lo);
        if !fits(&best) {
            return best
                .and(Err(DesignError::Infeasible(format!("no decay above {lo:.2e} /s with gains up to {gain}"))));
        }
        while hi / lo > 1.0 + DECAY_TOLERANCE {
            let middle = (lo * hi).sqrt();
            let tried = at(middle);
            if fits(&tried) {
                (lo, best) = (middle, tried);
            } else {
                hi = middle;
            }
        }
        best
    }
}

/// κ·I of a size.
fn diagonal(kappa: &Affine, size: usize) -> Affine {
    let rows: Vec<Vec<Affine>> = (0..size)
        .map(|i| (0..size).map(|j| if i == j { kappa.clone() } else { Affine::zeros(1, 1) }).collect())
        .collect();
    Affine::block(&rows)
}

#[cfg(test)]
mod tests {
    use super::super::plant::{Vertex, paper_roll_pitch, paper_yaw};
    use super::*;
    use nalgebra::dmatrix;

    #[test]
    fn the_papers_subsystems_are_designed_at_the_decay_asked_for() {
        for plant in [paper_roll_pitch(), paper_yaw()] {
            let d = design(&plant, Objective::SmallestGain { decay: 5.0 }).unwrap();
            let n = plant.c.ncols();
            // eq. (40), (50): [0 I; 0 0] whatever the parameters
            for (v, m) in plant.vertices.iter().zip(&d.m) {
                let drift = &v.a - &d.q * m;
                let mut expected = DMatrix::zeros(n, n);
                expected.view_mut((0, n / 2), (n / 2, n / 2)).fill_with_identity();
                assert!((drift - expected).amax() < 1e-9);
            }
            for (v, (m, l)) in plant.vertices.iter().zip(d.m.iter().zip(&d.gains)) {
                let closed = &v.a - &d.q * m - l * &plant.c;
                let eigen = closed.complex_eigenvalues();
                assert!(eigen.iter().all(|e| e.re < -5.0 * (1.0 - 1e-6)), "{eigen}");
                assert!(l.clone().svd(false, false).singular_values.max() <= d.gain_bound);
            }
            assert!(d.margin > 0.0 && d.gain_bound < 50.0, "{d:?}");
        }
    }

    #[test]
    fn a_larger_gain_buys_a_faster_decay() {
        let plant = paper_yaw();
        let [slow, fast] = [3.0, 12.0].map(|gain| design(&plant, Objective::FastestDecay { gain }).unwrap());
        assert!(fast.decay > 1.5 * slow.decay, "{} {}", slow.decay, fast.decay);
        assert!(slow.gain_bound <= 3.0 && fast.gain_bound <= 12.0);
    }

    #[test]
    fn angles_alone_are_refused_with_the_reason() {
        let plant = Polytope { c: dmatrix![1.0, 0.0], ..paper_yaw() };
        let e = design(&plant, Objective::SmallestGain { decay: 5.0 }).unwrap_err();
        assert!(matches!(e, DesignError::NotDecoupled { corner: 0, rank: 0, inputs: 1 }), "{e}");
        assert!(e.to_string().contains("body rates"));
    }

    #[test]
    fn rates_alone_leave_the_angle_unseen() {
        let plant = Polytope { c: dmatrix![0.0, 1.0], ..paper_yaw() };
        let e = design(&plant, Objective::SmallestGain { decay: 5.0 }).unwrap_err();
        assert!(matches!(e, DesignError::NotDetectable { .. }), "{e}");
    }

    #[test]
    fn what_does_not_fit_is_named() {
        let mut plant = paper_yaw();
        plant.vertices.push(Vertex { a: DMatrix::zeros(3, 3), e: dmatrix![0.0; 1.0] });
        let e = design(&plant, Objective::SmallestGain { decay: 5.0 }).unwrap_err();
        assert!(matches!(e, DesignError::Dimension { what: "A", .. }), "{e}");
        let e = design(&paper_yaw(), Objective::SmallestGain { decay: f64::NAN }).unwrap_err();
        assert!(matches!(e, DesignError::Parameter { .. }), "{e}");
        // an input that turns with the parameters cannot be decoupled by one matrix
        let mut plant = paper_yaw();
        plant.c = dmatrix![1.0, 0.0; 0.0, 1.0];
        plant.vertices[1].e = dmatrix![1.0; 1.0];
        let e = design(&plant, Objective::SmallestGain { decay: 5.0 }).unwrap_err();
        assert!(matches!(e, DesignError::DecouplingVaries { .. }), "{e}");
    }

    #[test]
    fn units_do_not_matter() {
        // angles in µrad, rates in Mrad/s
        let t = dmatrix![1e6, 0.0; 0.0, 1e-6];
        let t_inv = dmatrix![1e-6, 0.0; 0.0, 1e6];
        let plant = paper_yaw();
        let scaled = Polytope {
            vertices: plant.vertices.iter().map(|v| Vertex { a: &t * &v.a * &t_inv, e: &t * &v.e }).collect(),
            c: plant.c.clone() * &t_inv,
        };
        let d = design(&scaled, Objective::SmallestGain { decay: 5.0 });
        // the gain's size depends on the units; that there is one, and that it is proven, does not
        assert!(d.is_ok_and(|d| d.margin > 0.0));
    }
}
