use super::jet::{Jet, JetMatrix};
use nalgebra::DMatrix;

/// The motion of ẋ = A·x + w·η between two samples.
#[derive(Debug, Clone)]
pub(super) enum Flow {
    /// A is nilpotent (chains of integrators): e^{Aδ} = Σ Aᵏδᵏ/k! ends, and everything is a polynomial in δ.
    Polynomial { terms: Vec<DMatrix<f64>> },
    /// Any A, by the matrix exponential.
    Exponential { a: DMatrix<f64> },
}

/// A matrix whose entries are polynomials: coefficient of δᵏ at index k.
type Coefficients = Vec<DMatrix<f64>>;

impl Flow {
    pub(super) fn new(a: &DMatrix<f64>) -> Self {
        let n = a.nrows();
        let mut terms = vec![DMatrix::identity(n, n)];
        for k in 1..=n {
            let next = &terms[k - 1] * a / k as f64;
            if next.amax() == 0.0 {
                return Self::Polynomial { terms };
            }
            terms.push(next);
        }
        Self::Exponential { a: a.clone() }
    }

    /// e^{Aδ}.
    pub(super) fn transition(&self, dt_s: f64) -> DMatrix<f64> {
        match self {
            Self::Polynomial { terms } => evaluate(terms, dt_s),
            Self::Exponential { a } => (a * dt_s).exp(),
        }
    }

    /// S(δ) = δ·∫₀^δ e^{As} w wᵀ e^{Aᵀs} ds.
    ///
    /// Whatever η(s) with |η(s)| ≤ 1 does inside the step, the state it adds, x_w = ∫ e^{A(δ−s)} w η(s) ds, satisfies
    /// x_w·x_wᵀ ⪯ S: for any z, (zᵀx_w)² ≤ δ·∫ (zᵀe^{A(δ−s)}w η)² ds ≤ zᵀSz by Cauchy and Schwarz. So x_w = G·ζ with
    /// S = G·Gᵀ, |ζ| ≤ 1.
    pub(super) fn spread(&self, w: &DMatrix<f64>, dt_s: f64) -> DMatrix<f64> {
        match self {
            Self::Polynomial { .. } => evaluate(&self.spread_coefficients(w), dt_s),
            Self::Exponential { a } => {
                // Van Loan: exp([−A wwᵀ; 0 Aᵀ]δ) = [· e^{−Aδ}∫e^{As}wwᵀe^{Aᵀs}ds; 0 e^{Aᵀδ}]
                let n = a.nrows();
                let mut m = DMatrix::zeros(2 * n, 2 * n);
                m.view_mut((0, 0), (n, n)).copy_from(&(-a));
                m.view_mut((0, n), (n, n)).copy_from(&(w * w.transpose()));
                m.view_mut((n, n), (n, n)).copy_from(&a.transpose());
                let e = (m * dt_s).exp();
                let s = e.view((n, n), (n, n)).transpose() * e.view((0, n), (n, n)) * dt_s;
                (&s + s.transpose()) * 0.5
            }
        }
    }

    fn spread_coefficients(&self, w: &DMatrix<f64>) -> Coefficients {
        let Self::Polynomial { terms } = self else { return Vec::new() };
        let n = w.nrows();
        let mut out = vec![DMatrix::zeros(n, n); 2 * terms.len() + 1];
        for (i, ai) in terms.iter().enumerate() {
            for (j, aj) in terms.iter().enumerate() {
                out[i + j + 2] += ai * w * w.transpose() * aj.transpose() / (i + j + 1) as f64;
            }
        }
        out
    }

    /// [`Self::transition`] and the [`Self::spread`] of each w as polynomials in the coordinates R·x; `None` when they
    /// are none.
    pub(super) fn polynomials(
        &self,
        r: &DMatrix<f64>,
        r_inv: &DMatrix<f64>,
        w: &[DMatrix<f64>],
    ) -> Option<Polynomials> {
        let Self::Polynomial { terms } = self else { return None };
        Some(Polynomials {
            transition: terms.iter().map(|t| r * t * r_inv).collect(),
            spreads: w
                .iter()
                .map(|w| self.spread_coefficients(w).iter().map(|s| r * s * r.transpose()).collect())
                .collect(),
        })
    }
}

/// A step's motion as polynomials of its length.
#[derive(Debug, Clone)]
pub(super) struct Polynomials {
    transition: Coefficients,
    spreads: Vec<Coefficients>,
}

impl Polynomials {
    pub(super) fn transition(&self, dt: Jet) -> JetMatrix {
        evaluate_jet(&self.transition, dt)
    }

    pub(super) fn spread(&self, i: usize, dt: Jet) -> JetMatrix {
        evaluate_jet(&self.spreads[i], dt)
    }
}

fn evaluate(c: &Coefficients, x: f64) -> DMatrix<f64> {
    let mut sum = c[c.len() - 1].clone();
    for m in c.iter().rev().skip(1) {
        sum = sum * x + m;
    }
    sum
}

fn evaluate_jet(c: &Coefficients, x: Jet) -> JetMatrix {
    let mut sum = JetMatrix::constant(&c[c.len() - 1]);
    for m in c.iter().rev().skip(1) {
        sum = sum.scaled(x).plus(&JetMatrix::constant(m));
    }
    sum
}

/// G with S = G·Gᵀ for a positive semidefinite S, with as many columns as S has rank.
pub(super) fn square_root(s: &DMatrix<f64>) -> DMatrix<f64> {
    let n = s.nrows();
    // normalise first: entries span powers of δ
    let d: Vec<f64> = s.diagonal().iter().map(|x| x.max(0.0).sqrt()).collect();
    let correlation = DMatrix::from_fn(n, n, |i, j| {
        let scale = d[i] * d[j];
        if scale > 0.0 { s[(i, j)] / scale } else { 0.0 }
    });
    let eigen = correlation.symmetric_eigen();
    let kept: Vec<usize> = (0..n).filter(|&k| eigen.eigenvalues[k] > 1e-13 * n as f64).collect();
    DMatrix::from_fn(n, kept.len(), |i, k| d[i] * eigen.eigenvectors[(i, kept[k])] * eigen.eigenvalues[kept[k]].sqrt())
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::dmatrix;
    use proptest::prelude::*;

    fn chain() -> DMatrix<f64> {
        dmatrix![0.0, 1.0, 0.0; 0.0, 0.0, 1.0; 0.0, 0.0, 0.0]
    }

    proptest! {
        #[test]
        fn polynomials_and_exponentials_agree(dt in 0.001..0.5_f64, w in prop::array::uniform3(-2.0..2.0_f64)) {
            let w = DMatrix::from_column_slice(3, 1, &w);
            let (exact, general) = (Flow::new(&chain()), Flow::Exponential { a: chain() });
            let nilpotent = matches!(exact, Flow::Polynomial { .. });
            prop_assert!(nilpotent);
            prop_assert!((exact.transition(dt) - general.transition(dt)).amax() < 1e-12);
            prop_assert!((exact.spread(&w, dt) - general.spread(&w, dt)).amax() < 1e-12);
        }

        #[test]
        fn what_a_disturbance_adds_stays_in_its_spread(
            dt in 0.01..0.3_f64, switches in prop::collection::vec(-1.0..1.0_f64, 1..12),
            z in prop::array::uniform3(-1.0..1.0_f64),
        ) {
            // η piecewise constant over equal parts of the step, each part integrated exactly
            let flow = Flow::new(&chain());
            let w = dmatrix![0.3; 0.0; 2.0];
            let h = dt / switches.len() as f64;
            let mut x = DMatrix::<f64>::zeros(3, 1);
            for eta in &switches {
                // ∫₀^h e^{As} w ds for the chain
                let gained = dmatrix![
                    0.3 * h + 2.0 * h.powi(3) / 6.0; 2.0 * h * h / 2.0; 2.0 * h
                ];
                x = flow.transition(h) * x + gained * *eta;
            }
            let z = DMatrix::from_column_slice(3, 1, &z);
            let reach = (z.transpose() * flow.spread(&w, dt) * &z)[(0, 0)];
            let got = (z.transpose() * x)[(0, 0)].powi(2);
            prop_assert!(got <= reach * (1.0 + 1e-9) + 1e-15, "{got} > {reach}");
        }
    }

    #[test]
    fn the_root_of_a_spread_gives_it_back() {
        let flow = Flow::new(&chain());
        for (w, rank) in [(dmatrix![1.0; 0.0; 0.0], 1), (dmatrix![0.0; 1.0; 0.0], 2), (dmatrix![0.0; 0.0; 5.0], 3)] {
            let s = flow.spread(&w, 0.004);
            let g = square_root(&s);
            assert_eq!(g.ncols(), rank);
            let back = &g * g.transpose();
            assert!((0..3).all(|i| {
                (0..3).all(|j| (back[(i, j)] - s[(i, j)]).abs() <= 1e-11 * (s[(i, i)] * s[(j, j)]).sqrt())
            }));
        }
    }
}
