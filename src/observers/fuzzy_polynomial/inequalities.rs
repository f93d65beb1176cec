//! The polynomials of Theorem 1, (14)–(16), for one vertex of the model.

use super::plant::Plant;
use super::units::Units;
use crate::sdp::Affine;
use crate::sos::{Family, Monomial, Polynomial, Variables, bilinear, quadratic};
use nalgebra::DMatrix;

/// A vertex in scaled units, with variables
/// - ξ (6): scalarises the matrix inequalities, [a, bᵀ; b, P] ⪰ 0 ⇔ a + 2ξᵀb + ξᵀPξ ≥ 0 for all ξ;
/// - e (6): the error, η (3): the plant's speeds as shares of R_max;
/// - W (6): process disturbance w and measurement noise ν.
///
/// The matrix inequalities (14) and (15) are 7×7, not 12×12 as printed.
pub(super) struct Inequalities<'a> {
    plant: &'a Plant,
    units: &'a Units,
    /// Rotor momentum at the vertex.
    momentum: f64,
    pub(super) names: Variables,
    xi: Vec<Polynomial>,
    e: Vec<Polynomial>,
    eta: Vec<Polynomial>,
    w: Vec<Polynomial>,
    nu: Vec<Polynomial>,
}

/// H(x̂) = H₀ + Σ Hₖ·η̂ₖ, η̂ as shares of R_max.
pub(super) struct Gains {
    pub(super) constant: Affine,
    pub(super) by_speed: Vec<Affine>,
}

/// Rows of the state that are speeds.
const SPEEDS: [usize; 3] = [1, 3, 5];

impl<'a> Inequalities<'a> {
    pub(super) fn new(plant: &'a Plant, units: &'a Units, momentum: f64) -> Self {
        let mut names = Variables::new();
        Self {
            plant,
            units,
            momentum,
            xi: names.group("ξ", 6),
            e: names.group("e", 6),
            eta: names.group("η", 3),
            w: names.group("w", 3),
            nu: names.group("ν", 3),
            names,
        }
    }

    fn radius(&self) -> f64 {
        self.plant.radius2.sqrt()
    }

    /// Speeds of the error as shares of R_max.
    fn error_speeds(&self) -> Vec<Polynomial> {
        SPEEDS.iter().map(|&i| self.e[i].scaled(self.units.state[i] / self.radius())).collect()
    }

    /// 𝒜(x) − 𝒜(x̂): with e = x − x̂, ηᵢηⱼ − η̂ᵢη̂ⱼ = ηᵢeⱼ + ηⱼeᵢ − eᵢeⱼ.
    fn error_step(&self) -> Vec<Polynomial> {
        let a = self.units.matrix(&DMatrix::from_fn(6, 6, |i, j| self.plant.linear(self.momentum)[(i, j)]));
        let linear = |i: usize| (0..6).fold(Polynomial::zero(), |sum, j| &sum + &self.e[j].scaled(a[(i, j)]));
        let (r, s) = (self.radius(), self.error_speeds());
        let product = |i: usize, j: usize| &(&(&self.eta[i] * &s[j]) + &(&self.eta[j] * &s[i])) - &(&s[i] * &s[j]);
        let c = self.plant.coriolis();
        let mut step: Vec<Polynomial> = (0..6).map(linear).collect();
        for (axis, (i, j)) in [(1, 2), (0, 2), (0, 1)].into_iter().enumerate() {
            let row = SPEEDS[axis];
            // T·c·R²: speeds are shares of R_max
            let weight = self.plant.dt_s * c[axis] * r * r / self.units.state[row];
            step[row] = &step[row] + &product(i, j).scaled(weight);
        }
        step
    }

    /// ξᵀ or eᵀ times H(x̂)·v.
    fn gained(&self, left: &[Polynomial], h: &Gains, v: &[Polynomial]) -> Family {
        let errors = self.error_speeds();
        let mut out = bilinear(left, &h.constant, v);
        for ((h, eta), error) in h.by_speed.iter().zip(&self.eta).zip(&errors) {
            out = out + &bilinear(left, h, v) * &(eta - error);
        }
        out
    }

    /// C(x) − C(x̂).
    fn seen(&self) -> Vec<Polynomial> {
        let c = self.units.outputs();
        (0..3).map(|i| (0..6).fold(Polynomial::zero(), |sum, j| &sum + &self.e[j].scaled(c[(i, j)]))).collect()
    }

    /// ξᵀPξ + 2ξᵀ(P·(𝒜(x) − 𝒜(x̂)) − H·(C(x) − C(x̂))): what (14) and (15) share.
    fn step(&self, p: &Affine, h: &Gains) -> Family {
        let two = Polynomial::constant(2.0);
        let moved = bilinear(&self.xi, p, &self.error_step()) - self.gained(&self.xi, h, &self.seen());
        quadratic(&self.xi, p) + &moved * &two
    }

    /// (14) without its multipliers: the error's gain is at most √γ.
    pub(super) fn dissipation(&self, p: &Affine, h: &Gains, gamma: &Affine) -> Family {
        let d = self.units.weights(self.plant);
        let driven = p * &self.units.rows_from_state(&self.plant.driven());
        let two = Polynomial::constant(2.0);
        // ν counts measurement errors in units of R, as the outputs do
        let disturbed = bilinear(&self.xi, &driven, &self.w) - self.gained(&self.xi, h, &self.nu);
        let size = &Polynomial::sum_of_squares(&self.w) + &Polynomial::sum_of_squares(&self.nu);
        self.step(p, h) + &disturbed * &two + quadratic(&self.e, &(p - d.transpose() * &d)) + Family::new(gamma, &size)
    }

    /// (15) without its multipliers: V falls by e^{−2αT}.
    pub(super) fn decay(&self, p: &Affine, h: &Gains, alpha: f64) -> Family {
        let kept = (-2.0 * alpha * self.plant.dt_s).exp();
        self.step(p, h) + quadratic(&self.e, &p.scaled(kept))
    }

    /// (16) without its multipliers: no oscillation from sample to sample.
    pub(super) fn smooth(&self, p: &Affine, h: &Gains) -> Family {
        let moved = bilinear(&self.e, p, &self.error_step()) - self.gained(&self.e, h, &self.seen());
        &moved * &Polynomial::constant(2.0)
    }

    /// The regions (7) and (11), each with the basis of its multiplier, which must vanish where the inequality has no
    /// room: at e_s = 0, and with polynomial gains wherever all of what they multiply is zero.
    pub(super) fn region(&self, polynomial_gains: bool, noise: bool) -> Vec<(Polynomial, Vec<Monomial>)> {
        let one = Polynomial::constant(1.0);
        let basis = if polynomial_gains {
            let noise: &[Polynomial] = if noise { &self.nu } else { &[] };
            monomials_of(self.e.iter().chain(noise))
        } else {
            monomials_of(SPEEDS.iter().map(|&i| &self.e[i]))
        };
        vec![
            (&one - &Polynomial::sum_of_squares(&self.eta), basis.clone()),
            (&one - &Polynomial::sum_of_squares(&self.error_speeds()), basis),
        ]
    }

    /// Gram bases of (14), (15), (16) with multipliers as in [`region`](Self::region): what stands in the inequality,
    /// and the multipliers' bases times the regions' variables.
    pub(super) fn basis(&self, polynomial_gains: bool, kind: Kind) -> Vec<Monomial> {
        let mut linear: Vec<&Polynomial> = self.e.iter().collect();
        if kind != Kind::Smooth {
            linear.extend(&self.xi);
        }
        if kind == Kind::Dissipation {
            linear.extend(self.w.iter().chain(&self.nu));
        }
        let mut basis = monomials_of(linear.iter().copied());
        let speeds = || SPEEDS.iter().map(|&i| &self.e[i]);
        for (_, multiplier) in self.region(polynomial_gains, kind == Kind::Dissipation).iter().take(1) {
            for m in multiplier {
                basis.extend(monomials_of(self.eta.iter().chain(speeds())).iter().map(|v| m * v));
            }
        }
        basis.sort();
        basis.dedup();
        basis
    }

    /// The sign that a change of signs of the axes gives each variable, in the order of `names`.
    pub(super) fn signs(axes: [f64; 3]) -> Vec<f64> {
        let by_state = || (0..6).map(move |i| axes[i / 2]);
        by_state().chain(by_state()).chain(axes).chain(axes).chain(axes).collect()
    }
}

/// Which inequality of Theorem 1.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Kind {
    Dissipation,
    Decay,
    Smooth,
}

/// The monomials of polynomials that are single variables.
fn monomials_of<'a>(variables: impl Iterator<Item = &'a Polynomial>) -> Vec<Monomial> {
    variables.flat_map(|p| p.terms().map(|t| t.0.clone())).collect()
}
