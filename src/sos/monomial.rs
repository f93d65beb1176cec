use super::polynomial::Polynomial;
use std::cmp::Ordering;
use std::ops::Mul;

/// The names of a problem's variables, in order.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Variables(Vec<String>);

impl Variables {
    pub fn new() -> Self {
        Self::default()
    }

    /// A new variable, as a polynomial.
    pub fn add(&mut self, name: impl Into<String>) -> Polynomial {
        self.0.push(name.into());
        Polynomial::from(Monomial::variable(self.0.len() - 1))
    }

    /// `count` new variables name₁ … as polynomials.
    pub fn group(&mut self, name: &str, count: usize) -> Vec<Polynomial> {
        (1..=count).map(|i| self.add(format!("{name}{i}"))).collect()
    }

    pub fn len(&self) -> usize {
        self.0.len()
    }

    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// A monomial in these names, `x1²·w`.
    pub fn write(&self, m: &Monomial) -> String {
        if m.factors.is_empty() {
            return "1".into();
        }
        let name = |k: usize| self.0.get(k).map_or_else(|| format!("?{k}"), Clone::clone);
        let one = |&(k, power): &(usize, u32)| match power {
            1 => name(k),
            2 => format!("{}²", name(k)),
            n => format!("{}^{n}", name(k)),
        };
        m.factors.iter().map(one).collect::<Vec<_>>().join("·")
    }
}

/// A product of powers of variables. Ordered by degree first.
#[derive(Debug, Clone, Default, PartialEq, Eq, Hash)]
pub struct Monomial {
    /// (variable, power ≥ 1), by variable.
    factors: Vec<(usize, u32)>,
}

impl Monomial {
    /// The monomial 1.
    pub fn one() -> Self {
        Self::default()
    }

    pub fn variable(index: usize) -> Self {
        Self { factors: vec![(index, 1)] }
    }

    pub fn degree(&self) -> u32 {
        self.factors.iter().map(|f| f.1).sum()
    }

    /// The product of these (variable, power), in any order.
    pub fn of(factors: &[(usize, u32)]) -> Self {
        factors.iter().filter(|f| f.1 > 0).fold(Self::one(), |m, &f| &m * &Self { factors: vec![f] })
    }

    /// (variable, power) of each factor.
    pub fn factors(&self) -> &[(usize, u32)] {
        &self.factors
    }

    /// The value at a point; variables beyond its end count as zero.
    pub fn at(&self, point: &[f64]) -> f64 {
        let power = |&(k, n): &(usize, u32)| point.get(k).copied().unwrap_or(0.0).powi(n as i32);
        self.factors.iter().map(power).product()
    }

    /// Which variables have an odd power, as bits; variables from 128 on are not told apart from absent ones.
    pub(super) fn parity(&self) -> u128 {
        self.factors.iter().filter(|(k, n)| n % 2 == 1 && *k < 128).fold(0, |bits, (k, _)| bits ^ (1 << k))
    }
}

impl Mul for &Monomial {
    type Output = Monomial;
    // powers of a product add up
    #[allow(clippy::suspicious_arithmetic_impl)]
    fn mul(self, other: &Monomial) -> Monomial {
        let mut factors = self.factors.clone();
        for &(k, n) in &other.factors {
            match factors.binary_search_by_key(&k, |f| f.0) {
                Ok(at) => factors[at].1 += n,
                Err(at) => factors.insert(at, (k, n)),
            }
        }
        Monomial { factors }
    }
}

impl Ord for Monomial {
    fn cmp(&self, other: &Self) -> Ordering {
        self.degree().cmp(&other.degree()).then_with(|| self.factors.cmp(&other.factors))
    }
}

impl PartialOrd for Monomial {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn products_add_powers_and_names_are_readable() {
        let mut names = Variables::new();
        let (x, y) = (names.add("x"), names.add("y"));
        let square = &(&x * &x) * &y;
        let (m, _) = square.terms().next().unwrap();
        assert_eq!((names.write(m), m.degree(), m.at(&[3.0, 2.0]), m.parity()), ("x²·y".into(), 3, 18.0, 2));
        assert_eq!(names.write(&Monomial::one()), "1");
        assert!(Monomial::one() < Monomial::variable(7) && Monomial::variable(7) < *m);
    }
}
