use super::monomial::Monomial;
use std::collections::{BTreeMap, BTreeSet};

/// All monomials in these variables up to a degree, the constant first.
pub fn monomials(variables: &[usize], degree: u32) -> Vec<Monomial> {
    let mut all = BTreeSet::from([Monomial::one()]);
    for _ in 0..degree {
        let grown: Vec<Monomial> =
            all.iter().flat_map(|m| variables.iter().map(move |&k| m * &Monomial::variable(k))).collect();
        all.extend(grown);
    }
    all.into_iter().collect()
}

/// The changes of sign of the variables that a set of monomials does not notice.
///
/// A polynomial that such a change leaves as it is has a Gram matrix that is block-diagonal over the classes of
/// monomials which change alike (averaging over the changes keeps it positive): Löfberg, *Pre- and post-processing
/// sum-of-squares programs in practice*, section IV.
#[derive(Debug, Clone, Default)]
pub struct Signs {
    /// Independent parities of the monomials, each with a leading bit that no other has.
    span: Vec<u128>,
}

impl Signs {
    pub fn of<'a>(support: impl IntoIterator<Item = &'a Monomial>) -> Self {
        let mut signs = Self::default();
        support.into_iter().for_each(|m| signs.note(m.parity()));
        signs
    }

    /// Takes in the monomials of another polynomial.
    pub fn with<'a>(mut self, support: impl IntoIterator<Item = &'a Monomial>) -> Self {
        support.into_iter().for_each(|m| self.note(m.parity()));
        self
    }

    fn note(&mut self, parity: u128) {
        let new = self.class(parity);
        if new != 0 {
            let leading = 1u128 << (127 - new.leading_zeros());
            self.span.iter_mut().filter(|v| **v & leading != 0).for_each(|v| *v ^= new);
            self.span.push(new);
        }
    }

    /// What is left of a parity after all combinations of noticed ones are taken out.
    fn class(&self, parity: u128) -> u128 {
        self.span.iter().fold(parity, |p, v| {
            let leading = 1u128 << (127 - v.leading_zeros());
            if p & leading != 0 { p ^ v } else { p }
        })
    }

    /// A basis in blocks: two monomials stand together when the polynomial may hold their product.
    pub fn split(&self, basis: &[Monomial]) -> Vec<Vec<Monomial>> {
        let mut blocks: BTreeMap<u128, Vec<Monomial>> = BTreeMap::new();
        for m in basis {
            blocks.entry(self.class(m.parity())).or_default().push(m.clone());
        }
        blocks.into_values().collect()
    }
}

/// The basis without the monomials whose square neither occurs in the support nor is the product of two others: their
/// row of a positive Gram matrix is zero (Löfberg, section V: diagonal inconsistency).
pub fn reduced(basis: &[Monomial], support: &BTreeSet<Monomial>) -> Vec<Monomial> {
    let mut kept = basis.to_vec();
    loop {
        let products: BTreeSet<Monomial> =
            (0..kept.len()).flat_map(|i| (0..i).map(move |j| (i, j))).map(|(i, j)| &kept[i] * &kept[j]).collect();
        let before = kept.len();
        kept.retain(|m| {
            let square = m * m;
            support.contains(&square) || products.contains(&square)
        });
        if kept.len() == before {
            return kept;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn x(k: usize) -> Monomial {
        Monomial::variable(k)
    }

    #[test]
    fn monomials_are_counted() {
        // (n + d choose d)
        assert_eq!(monomials(&[0, 1, 2], 2).len(), 10);
        assert_eq!(monomials(&[4], 3).iter().map(Monomial::degree).collect::<Vec<_>>(), [0, 1, 2, 3]);
    }

    #[test]
    fn signs_split_a_basis() {
        // x₀², x₀x₁, x₁² notice only that x₀ and x₁ change together; x₂ is free
        let support = [&x(0) * &x(0), &x(0) * &x(1), &x(2) * &x(2)];
        let blocks = Signs::of(&support).split(&[Monomial::one(), x(0), x(1), x(2), &x(0) * &x(2)]);
        assert_eq!(blocks.iter().map(Vec::len).collect::<Vec<_>>(), [1, 2, 1, 1]);
        let odd = Signs::of(&[x(0)]).with(&[x(1)]).split(&[Monomial::one(), x(0), x(1)]);
        assert_eq!(odd.len(), 1);
    }

    #[test]
    fn what_nothing_balances_is_left_out() {
        // Motzkin's polynomial x⁴y² + x²y⁴ − 3x²y² + 1: of all monomials up to degree 3 only four can serve
        let (a, b) = (x(0), x(1));
        let (aab, abb) = (&(&a * &a) * &b, &(&a * &b) * &b);
        let ab = &a * &b;
        let support = BTreeSet::from([&aab * &aab, &abb * &abb, &ab * &ab, Monomial::one()]);
        let kept = reduced(&monomials(&[0, 1], 3), &support);
        for needed in [Monomial::one(), ab, aab, abb] {
            assert!(kept.contains(&needed));
        }
        assert!(!kept.contains(&(&(&a * &a) * &a)) && kept.len() < 10, "{kept:?}");
    }
}
