use super::monomial::{Monomial, Variables};
use std::collections::BTreeMap;
use std::ops::{Add, Mul, Neg, Sub};

/// A polynomial with real coefficients.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Polynomial {
    /// No coefficient is zero.
    terms: BTreeMap<Monomial, f64>,
}

impl Polynomial {
    pub fn zero() -> Self {
        Self::default()
    }

    pub fn constant(value: f64) -> Self {
        Self::zero().plus_term(&Monomial::one(), value)
    }

    /// Every monomial with its coefficient, by rising degree.
    pub fn terms(&self) -> impl Iterator<Item = (&Monomial, f64)> {
        self.terms.iter().map(|(m, c)| (m, *c))
    }

    pub fn coefficient(&self, m: &Monomial) -> f64 {
        self.terms.get(m).copied().unwrap_or(0.0)
    }

    pub fn at(&self, point: &[f64]) -> f64 {
        self.terms().map(|(m, c)| c * m.at(point)).sum()
    }

    pub fn scaled(&self, by: f64) -> Self {
        self.terms().fold(Self::zero(), |sum, (m, c)| sum.plus_term(m, c * by))
    }

    /// p(s₁z₁, s₂z₂, …) for signs s, one per variable.
    pub fn with_signs(&self, signs: &[f64]) -> Self {
        self.terms().fold(Self::zero(), |sum, (m, c)| sum.plus_term(m, c * m.at(signs)))
    }

    /// Σ pᵢ².
    pub fn sum_of_squares(of: &[Polynomial]) -> Self {
        of.iter().fold(Self::zero(), |sum, p| &sum + &(p * p))
    }

    pub(super) fn plus_term(mut self, m: &Monomial, c: f64) -> Self {
        let sum = self.coefficient(m) + c;
        if sum == 0.0 {
            self.terms.remove(m);
        } else {
            self.terms.insert(m.clone(), sum);
        }
        self
    }

    /// The polynomial in readable names.
    pub fn write(&self, names: &Variables) -> String {
        let term = |(m, c): (&Monomial, f64)| format!("{c}·{}", names.write(m));
        if self.terms.is_empty() { "0".into() } else { self.terms().map(term).collect::<Vec<_>>().join(" + ") }
    }
}

impl From<Monomial> for Polynomial {
    fn from(m: Monomial) -> Self {
        Self { terms: BTreeMap::from([(m, 1.0)]) }
    }
}

impl Add for &Polynomial {
    type Output = Polynomial;
    fn add(self, other: &Polynomial) -> Polynomial {
        other.terms().fold(self.clone(), |sum, (m, c)| sum.plus_term(m, c))
    }
}

impl Sub for &Polynomial {
    type Output = Polynomial;
    fn sub(self, other: &Polynomial) -> Polynomial {
        self + &-other
    }
}

impl Neg for &Polynomial {
    type Output = Polynomial;
    fn neg(self) -> Polynomial {
        self.scaled(-1.0)
    }
}

impl Mul for &Polynomial {
    type Output = Polynomial;
    fn mul(self, other: &Polynomial) -> Polynomial {
        self.terms().fold(Polynomial::zero(), |sum, (m, c)| {
            other.terms().fold(sum, |sum, (n, d)| sum.plus_term(&(m * n), c * d))
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn polynomial() -> impl Strategy<Value = Polynomial> {
        prop::collection::vec((0usize..3, 0usize..3, -2.0..2.0_f64), 0..6).prop_map(|terms| {
            terms.iter().fold(Polynomial::zero(), |sum, &(i, j, c)| {
                sum.plus_term(&(&Monomial::variable(i) * &Monomial::variable(j)), c)
            })
        })
    }

    proptest! {
        #[test]
        fn operators_mean_what_they_mean_for_numbers(
            p in polynomial(), q in polynomial(), at in prop::array::uniform3(-2.0..2.0_f64),
        ) {
            let (a, b) = (p.at(&at), q.at(&at));
            prop_assert!(((&p + &q).at(&at) - (a + b)).abs() < 1e-9);
            prop_assert!(((&p - &q).at(&at) - (a - b)).abs() < 1e-9);
            prop_assert!(((&p * &q).at(&at) - a * b).abs() < 1e-8);
            prop_assert_eq!(&p - &p, Polynomial::zero());
        }
    }

    #[test]
    fn it_reads_as_it_is_written() {
        let mut names = Variables::new();
        let (x, y) = (names.add("x"), names.add("y"));
        let p = &(&x * &y).scaled(-2.0) + &Polynomial::constant(1.5);
        assert_eq!(p.write(&names), "1.5·1 + -2·x·y");
        assert_eq!(Polynomial::zero().write(&names), "0");
    }
}
