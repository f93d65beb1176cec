use super::plant::Plant;
use nalgebra::DMatrix;

/// Momentum coordinates: linear (3) and spin (3).
const MOMENTA: usize = 6;
/// Outputs of eq. (54): the momenta and the force.
const OUTPUTS: usize = 9;

/// Upper triangle of the printed Q₂ (eq. 58), row by row.
const Q2: [&[f64]; OUTPUTS] = [
    &[1.5, -0.3, 0.3, 8.3, -3.2, -3.1, -0.2, -0.02, -0.1],
    &[0.7, -0.1, -10.5, 9.3, -6.2, 0.04, -0.03, -0.01],
    &[0.9, 3.30, 3.7, -3.9, 0.02, -0.02, -0.09],
    &[2903.0, 111.7, -277.8, -2.4, -0.6, -0.2],
    &[4281.0, 242.1, 0.6, 2.5, -1.5],
    &[951.2, -1.6, 1.6, 1.05],
    &[0.2, -0.01, -0.01],
    &[0.1, -0.01],
    &[0.1],
];

/// Order of the disturbance model in the paper's section 4.
pub const PAPER_ORDER: usize = 3;

/// How the paper's text differs from what its model follows from.
pub const CORRECTIONS: &[&str] = &[
    "(33) prints q₀ for q₀².",
    "(54) prints the body's velocity and a wrong sign: the force measurement is R(m·a_b − f_a).",
    "F is 6r×6r, G 6r×6, H 6×6r, and C = (I₉, 0_{9×(6r−3)}).",
    "The certificate is for continuous measurements; what runs on samples is designed for samples.",
];

/// The rigid body in momentum form with a disturbance that is a chain of `order` integrators (eqs. 41–57).
///
/// State (p, d, ḋ, …, d^(r−1)) ∈ R^(6+6r), p = (m·v, R·J·ω) in the world frame, d the force and torque that act beside
/// gravity and rotors; outputs the momenta and the force. The disturbance's r-th derivative and the outputs' errors
/// are bounded by Q₁ and Q₂; E₁ selects d (eq. 60). Corrected against the print: F is 6r×6r, G 6r×6, H 6×6r, and
/// C = (I₉, 0_{9×(6r−3)}).
pub fn momentum_plant(order: usize, q1: DMatrix<f64>, q2: DMatrix<f64>) -> Plant {
    let n = MOMENTA * (order + 1);
    let shifted = |rows, offset| DMatrix::from_fn(rows, n, |i, j| if j == i + offset { 1.0 } else { 0.0 });
    // every block of six is the derivative of the one before it; the last is driven by η₁
    let a = shifted(n, MOMENTA);
    let w1 = DMatrix::from_fn(n, MOMENTA, |i, j| if i == j + MOMENTA * order { 1.0 } else { 0.0 });
    Plant {
        a,
        w1,
        q1,
        c: shifted(OUTPUTS, 0),
        w2: DMatrix::identity(OUTPUTS, OUTPUTS),
        q2,
        e1: shifted(MOMENTA, MOMENTA),
    }
}

/// The printed Q₂ (eq. 58).
pub fn printed_q2() -> DMatrix<f64> {
    DMatrix::from_fn(OUTPUTS, OUTPUTS, |i, j| Q2[i.min(j)][i.max(j) - i.min(j)])
}

/// The plant of the paper's section 4 (an AscTec Hummingbird, m = 1.023 kg): Q₁ = 10⁶·I₆ and the printed Q₂.
///
/// Mass and inertia do not enter: in momentum form they are in the input and the outputs.
pub fn hummingbird(order: usize) -> Plant {
    momentum_plant(order, DMatrix::identity(MOMENTA, MOMENTA) * 1e6, printed_q2())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sdp::verify;

    #[test]
    fn the_printed_q2_is_positive_definite() {
        let q2 = printed_q2();
        assert_eq!(q2[(3, 5)], -277.8);
        assert_eq!(q2, q2.transpose());
        assert!(verify::is_positive(&q2));
    }

    #[test]
    fn the_plant_is_a_chain_that_ends_in_the_disturbance() {
        for order in 1..=4 {
            let plant = hummingbird(order);
            plant.check().unwrap();
            assert_eq!(plant.a.nrows(), 6 + 6 * order);
            // E₁·A^(order−1)·W₁: the last derivative reaches d after order − 1 integrations, unscaled
            let reach = (0..order - 1).fold(plant.w1.clone(), |x, _| &plant.a * x);
            assert_eq!(&plant.e1 * reach, DMatrix::identity(6, 6));
            // the force output sees d's first half
            assert_eq!(plant.c.row(6).iter().position(|x| *x != 0.0), Some(6));
        }
    }
}
