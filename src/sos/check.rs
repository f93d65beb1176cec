use super::monomial::Monomial;
use super::polynomial::Polynomial;
use crate::sdp::verify;
use nalgebra::DMatrix;
use std::collections::BTreeMap;

/// What came of comparing a polynomial with its Gram matrices.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Check {
    /// Smallest eigenvalue of any Gram matrix with its diagonal scaled to one, less what the identity misses and
    /// rounding may hide. Positive: the polynomial *is* a sum of squares.
    pub margin: f64,
    /// The largest coefficient by which the two sides of the identity differ, relative to the diagonal.
    pub residual: f64,
}

/// Gram matrices block by block, each with its basis.
pub type Blocks = Vec<(Vec<Monomial>, DMatrix<f64>)>;

/// Numbers that prove p ≥ 0 where all g of a region are ≥ 0: Gram matrices of the multipliers and of p − Σ sₖ·gₖ.
#[derive(Debug, Clone, PartialEq)]
pub struct Certificate {
    pub rest: Blocks,
    pub multipliers: Vec<Blocks>,
}

impl Certificate {
    /// Checks it for a polynomial with numbers for coefficients, written down anew: every multiplier and the rest
    /// positive by eigenvalues, the identity coefficient by coefficient.
    ///
    /// A region with more inequalities than multipliers makes the statement stronger, not weaker: those are not used.
    pub fn check(&self, p: &Polynomial, region: &[Polynomial]) -> Check {
        let mut rest = p.clone();
        let mut margin = if self.multipliers.len() > region.len() { f64::NEG_INFINITY } else { f64::INFINITY };
        for (s, g) in self.multipliers.iter().zip(region) {
            for (b, m) in s {
                margin = margin.min(verify::margin(m) - verify::rounding(b.len()));
                rest = &rest - &(&form(b, m) * g);
            }
        }
        let identity = check(&self.rest, &rest);
        Check { margin: identity.margin.min(margin), ..identity }
    }
}

/// bᵀ·m·b with the coefficients as numbers.
pub fn form(b: &[Monomial], m: &DMatrix<f64>) -> Polynomial {
    let mut out = Polynomial::zero();
    for (i, row) in m.row_iter().enumerate() {
        for (j, v) in row.iter().enumerate() {
            out = out.plus_term(&(&b[i] * &b[j]), *v);
        }
    }
    out
}

/// Compares p with Σ bᵀGb, coefficient by coefficient, and the matrices with zero.
///
/// What the identity misses is put back where it belongs: a coefficient r that is missing at bᵢ·bⱼ changes the entry
/// (i, j), and with it no eigenvalue by more than |r|. So G stays positive, and the identity becomes exact, when the
/// smallest eigenvalue exceeds the sum of all |r|.
pub fn check(gram: &[(Vec<Monomial>, DMatrix<f64>)], p: &Polynomial) -> Check {
    let mut margin = f64::INFINITY;
    let mut rest = p.clone();
    // the heaviest place of every monomial: √(Gᵢᵢ·Gⱼⱼ)
    let mut weights: BTreeMap<Monomial, f64> = BTreeMap::new();
    let mut size = 0;
    for (b, g) in gram {
        size += b.len();
        margin = margin.min(verify::margin(g));
        rest = &rest - &form(b, g);
        for j in 0..b.len() {
            for i in 0..=j {
                let weight = (g[(i, i)] * g[(j, j)]).max(0.0).sqrt();
                let best = weights.entry(&b[i] * &b[j]).or_insert(0.0);
                *best = best.max(weight);
            }
        }
    }
    let (mut total, mut residual) = (0.0, 0.0_f64);
    for (m, r) in rest.terms() {
        let share = match weights.get(m) {
            Some(w) if *w > 0.0 => r.abs() / w,
            _ => f64::INFINITY,
        };
        total += share;
        residual = residual.max(share);
    }
    Check { margin: margin - total - verify::rounding(size), residual }
}
