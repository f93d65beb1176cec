use super::basis::Signs;
use super::check::{Blocks, Certificate};
use super::family::Family;
use super::monomial::{Monomial, Variables};
use super::polynomial::Polynomial;
use crate::sdp::{Affine, Problem, Solution};
use std::collections::BTreeMap;

/// Why a polynomial inequality cannot be stated.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum SosError {
    #[error("`{name}`: no two monomials of the basis have the product {monomial}; the basis is too small")]
    BasisTooSmall { name: String, monomial: String },
    #[error("`{name}`: the basis is empty")]
    EmptyBasis { name: String },
}

/// Positive matrices G over bases b with p = Σ bᵀ·G·b, block by block.
#[derive(Debug, Clone)]
pub struct Gram {
    blocks: Vec<(Vec<Monomial>, Affine)>,
}

impl Gram {
    /// Each block's basis and its matrix at a solution.
    pub fn value(&self, solution: &Solution) -> Blocks {
        self.blocks.iter().map(|(b, g)| (b.clone(), solution.value(g))).collect()
    }

    /// The sizes of the blocks.
    pub fn sizes(&self) -> Vec<usize> {
        self.blocks.iter().map(|b| b.0.len()).collect()
    }

    fn family(&self) -> Family {
        let vector = |b: &[Monomial]| b.iter().cloned().map(Polynomial::from).collect::<Vec<_>>();
        self.blocks.iter().fold(Family::zero(), |sum, (b, g)| sum + super::quadratic(&vector(b), g))
    }

    /// A positive form with nothing prescribed: an unknown multiplier.
    fn unknown(problem: &mut Problem, name: &str, bases: Vec<Vec<Monomial>>, margin: f64) -> Self {
        let mut blocks = Vec::new();
        for b in bases {
            let g = problem.symmetric(b.len());
            problem.positive_by(name, &g, margin);
            blocks.push((b, g));
        }
        Self { blocks }
    }
}

/// Requires that p be a sum of squares over a basis, with room as in [`Problem::positive_by`].
///
/// # Errors
/// A basis that is empty or cannot make all monomials of p.
pub fn positive(
    problem: &mut Problem,
    names: &Variables,
    name: &str,
    p: &Family,
    basis: &[Monomial],
    margin: f64,
) -> Result<Gram, SosError> {
    let signs = Signs::of(p.terms().map(|t| t.0));
    general(problem, names, name, p, signs.split(basis), margin)
}

/// The general matrix with the identity, made positive.
fn general(
    problem: &mut Problem,
    names: &Variables,
    name: &str,
    p: &Family,
    bases: Vec<Vec<Monomial>>,
    margin: f64,
) -> Result<Gram, SosError> {
    if bases.iter().all(Vec::is_empty) {
        return Err(SosError::EmptyBasis { name: name.into() });
    }
    // where each monomial can come from: block, row ≤ column
    let mut places: BTreeMap<Monomial, Vec<(usize, usize, usize)>> = BTreeMap::new();
    for (k, b) in bases.iter().enumerate() {
        for j in 0..b.len() {
            for i in 0..=j {
                places.entry(&b[i] * &b[j]).or_default().push((k, i, j));
            }
        }
    }
    if let Some((m, _)) = p.terms().find(|(m, _)| !places.contains_key(m)) {
        return Err(SosError::BasisTooSmall { name: name.into(), monomial: names.write(m) });
    }
    let mut entries: Vec<Vec<((usize, usize), Affine)>> = vec![Vec::new(); bases.len()];
    for (m, mut places) in places {
        // an entry off the diagonal counts twice in bᵀGb; the last place takes what the others leave
        let share = |(_, i, j): (usize, usize, usize)| if i == j { 1.0 } else { 2.0 };
        places.sort_by_key(|&(_, i, j)| i == j);
        let mut left = p.coefficient(&m);
        let last = places.len().saturating_sub(1);
        for (n, place) in places.into_iter().enumerate() {
            let (k, i, j) = place;
            let entry = if n == last { left.scaled(1.0 / share(place)) } else { problem.scalar() };
            left = left - entry.scaled(share(place));
            if i != j {
                entries[k].push(((j, i), entry.clone()));
            }
            entries[k].push(((i, j), entry));
        }
    }
    let mut blocks = Vec::new();
    for (b, entries) in bases.into_iter().zip(entries) {
        let g = Affine::from_entries(b.len(), b.len(), entries);
        problem.positive_by(name, &g, margin);
        blocks.push((b, g));
    }
    Ok(Gram { blocks })
}

/// p = Σ sₖ·gₖ + (sum of squares) with sums of squares sₖ: p ≥ 0 wherever all gₖ ≥ 0 (Positivstellensatz, Lemma 1 of
/// Pitarch and Sala).
#[derive(Debug, Clone)]
pub struct Local {
    pub rest: Gram,
    pub multipliers: Vec<Gram>,
}

/// Requires p ≥ 0 where all polynomials of `region` are ≥ 0, with one multiplier basis for each of them.
///
/// # Errors
/// Those of [`positive`].
pub fn positive_on(
    problem: &mut Problem,
    names: &Variables,
    name: &str,
    p: &Family,
    region: &[(Polynomial, Vec<Monomial>)],
    basis: &[Monomial],
    margin: f64,
) -> Result<Local, SosError> {
    let mut signs = Signs::of(p.terms().map(|t| t.0));
    for (g, _) in region {
        signs = signs.with(g.terms().map(|t| t.0));
    }
    let mut rest = p.clone();
    let mut multipliers = Vec::new();
    for (k, (g, multiplier)) in region.iter().enumerate() {
        let title = format!("{name}, multiplier {}", k + 1);
        let s = Gram::unknown(problem, &title, signs.split(multiplier), margin);
        rest = rest - &s.family() * g;
        multipliers.push(s);
    }
    let rest = general(problem, names, name, &rest, signs.split(basis), margin)?;
    Ok(Local { rest, multipliers })
}

impl Local {
    /// The numbers at a solution, which prove p ≥ 0 on the region by themselves.
    pub fn certificate(&self, solution: &Solution) -> Certificate {
        Certificate {
            rest: self.rest.value(solution),
            multipliers: self.multipliers.iter().map(|s| s.value(solution)).collect(),
        }
    }
}
