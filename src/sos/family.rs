use super::monomial::Monomial;
use super::polynomial::Polynomial;
use crate::sdp::{Affine, Solution};
use std::collections::BTreeMap;
use std::ops::{Add, Mul, Neg, Sub};

/// A polynomial whose coefficients are affine in the unknowns of a problem: 1×1 expressions.
///
/// A coefficient of another shape is a fault that the problem reports when the polynomial is used.
#[derive(Debug, Clone, Default)]
pub struct Family {
    terms: BTreeMap<Monomial, Affine>,
}

impl Family {
    pub fn zero() -> Self {
        Self::default()
    }

    /// One unknown number times a polynomial.
    pub fn new(coefficient: &Affine, p: &Polynomial) -> Self {
        Self { terms: p.terms().map(|(m, c)| (m.clone(), coefficient.scaled(c))).collect() }
    }

    /// Every monomial that may occur, with its coefficient.
    pub fn terms(&self) -> impl Iterator<Item = (&Monomial, &Affine)> {
        self.terms.iter()
    }

    pub fn coefficient(&self, m: &Monomial) -> Affine {
        self.terms.get(m).cloned().unwrap_or_else(|| Affine::zeros(1, 1))
    }

    /// The polynomial at a solution.
    pub fn value(&self, solution: &Solution) -> Polynomial {
        self.terms.iter().fold(Polynomial::zero(), |sum, (m, c)| sum.plus_term(m, solution.value(c)[(0, 0)]))
    }

    /// The polynomial with every unknown at zero: the whole of it when it was written with numbers.
    pub fn constant_part(&self) -> Polynomial {
        self.terms.iter().fold(Polynomial::zero(), |sum, (m, c)| sum.plus_term(m, c.value(&[])[(0, 0)]))
    }

    fn plus_term(&mut self, m: &Monomial, c: &Affine) {
        match self.terms.get_mut(m) {
            Some(sum) => *sum = &*sum + c,
            None => {
                self.terms.insert(m.clone(), c.clone());
            }
        }
    }
}

/// leftᵀ · matrix · right, with polynomials left and right.
///
/// A length that does not fit the matrix leaves the entries beyond it out.
pub fn bilinear(left: &[Polynomial], matrix: &Affine, right: &[Polynomial]) -> Family {
    let mut out = Family::zero();
    for (i, j, entry) in matrix.entries_that_occur() {
        if let (Some(l), Some(r)) = (left.get(i), right.get(j)) {
            for (m, c) in (l * r).terms() {
                out.plus_term(m, &entry.scaled(c));
            }
        }
    }
    out
}

/// vᵀ · matrix · v.
pub fn quadratic(v: &[Polynomial], matrix: &Affine) -> Family {
    bilinear(v, matrix, v)
}

impl From<&Polynomial> for Family {
    fn from(p: &Polynomial) -> Self {
        Self::new(&Affine::identity(1), p)
    }
}

impl Add<&Family> for Family {
    type Output = Family;
    fn add(mut self, other: &Family) -> Family {
        other.terms.iter().for_each(|(m, c)| self.plus_term(m, c));
        self
    }
}

impl Add for Family {
    type Output = Family;
    fn add(self, other: Family) -> Family {
        self + &other
    }
}

impl Neg for &Family {
    type Output = Family;
    fn neg(self) -> Family {
        Family { terms: self.terms.iter().map(|(m, c)| (m.clone(), -c)).collect() }
    }
}

impl Sub for Family {
    type Output = Family;
    fn sub(self, other: Family) -> Family {
        self + &-&other
    }
}

impl Mul<&Polynomial> for &Family {
    type Output = Family;
    fn mul(self, p: &Polynomial) -> Family {
        let mut out = Family::zero();
        for (m, c) in &self.terms {
            for (n, d) in p.terms() {
                out.plus_term(&(m * n), &c.scaled(d));
            }
        }
        out
    }
}
