mod operators;

use nalgebra::DMatrix;
use std::collections::BTreeMap;

/// Two matrices that an operation cannot join.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{operation}: {}×{} does not fit {}×{}", left.0, left.1, right.0, right.1)]
pub struct ShapeError {
    pub operation: &'static str,
    pub left: (usize, usize),
    pub right: (usize, usize),
}

/// A matrix whose entries are affine in the scalar unknowns of a [`Problem`](super::Problem):
/// F(x) = F₀ + Σ xₖ Fₖ.
///
/// Expressions are built with `+`, `−`, products with constant matrices on either side, [`transpose`](Self::transpose)
/// and blocks. A shape that does not fit is remembered inside the expression, survives every further operation, and
/// comes out as an error when the expression is given to a problem: formulas stay readable, mistakes stay typed.
#[derive(Debug, Clone)]
pub struct Affine {
    constant: DMatrix<f64>,
    /// Fₖ by unknown, sparse; no entry is zero.
    terms: BTreeMap<usize, Sparse>,
    fault: Option<ShapeError>,
}

/// Entries by (row, column).
pub(super) type Sparse = BTreeMap<(usize, usize), f64>;

impl Affine {
    pub fn constant(matrix: DMatrix<f64>) -> Self {
        Self { constant: matrix, terms: BTreeMap::new(), fault: None }
    }

    pub fn zeros(rows: usize, cols: usize) -> Self {
        Self::constant(DMatrix::zeros(rows, cols))
    }

    pub fn identity(n: usize) -> Self {
        Self::constant(DMatrix::identity(n, n))
    }

    /// A matrix each of whose entries is one unknown; `index` says which.
    pub(super) fn unknowns(rows: usize, cols: usize, index: impl Fn(usize, usize) -> usize) -> Self {
        let mut out = Self::zeros(rows, cols);
        for i in 0..rows {
            for j in 0..cols {
                out.terms.entry(index(i, j)).or_default().insert((i, j), 1.0);
            }
        }
        out
    }

    pub fn shape(&self) -> (usize, usize) {
        self.constant.shape()
    }

    pub(super) fn fault(&self) -> Option<&ShapeError> {
        self.fault.as_ref()
    }

    pub(super) fn constant_part(&self) -> &DMatrix<f64> {
        &self.constant
    }

    pub(super) fn terms(&self) -> &BTreeMap<usize, Sparse> {
        &self.terms
    }

    /// F(x). Unknowns beyond the end of `x` count as zero.
    pub fn value(&self, x: &[f64]) -> DMatrix<f64> {
        let mut out = self.constant.clone();
        self.add_terms(x, &mut out);
        out
    }

    /// F(x) − F₀: what a direction x changes.
    pub fn slope(&self, x: &[f64]) -> DMatrix<f64> {
        let mut out = DMatrix::zeros(self.constant.nrows(), self.constant.ncols());
        self.add_terms(x, &mut out);
        out
    }

    fn add_terms(&self, x: &[f64], out: &mut DMatrix<f64>) {
        for (k, f) in &self.terms {
            let xk = x.get(*k).copied().unwrap_or(0.0);
            for (at, v) in f {
                out[*at] += xk * v;
            }
        }
    }

    pub fn transpose(&self) -> Self {
        let flip = |f: &Sparse| f.iter().map(|(&(i, j), &v)| ((j, i), v)).collect();
        Self {
            constant: self.constant.transpose(),
            terms: self.terms.iter().map(|(&k, f)| (k, flip(f))).collect(),
            fault: self.fault.clone(),
        }
    }

    /// F + Fᵀ.
    pub fn plus_transpose(&self) -> Self {
        self + self.transpose()
    }

    /// The matrix with these 1×1 expressions at (row, column) and zero elsewhere; what meets in one place adds up.
    pub fn from_entries(rows: usize, cols: usize, entries: impl IntoIterator<Item = ((usize, usize), Affine)>) -> Self {
        let mut out = Self::zeros(rows, cols);
        for (at, entry) in entries {
            let outside = at.0 >= rows || at.1 >= cols;
            if out.fault.is_none() && (entry.fault.is_some() || outside || entry.shape() != (1, 1)) {
                out.fault = entry.faulty("entry", (rows, cols), entry.shape()).fault;
            }
            if out.fault.is_none() {
                out.constant[at] += entry.constant[(0, 0)];
                out.add_shifted(&entry, at);
            }
        }
        out
    }

    /// (row, column, 1×1 expression) of every entry that is not zero throughout.
    pub fn entries_that_occur(&self) -> Vec<(usize, usize, Affine)> {
        let mut found: BTreeMap<(usize, usize), Affine> = BTreeMap::new();
        let start = |at: (usize, usize)| Self {
            fault: self.fault.clone(),
            ..Self::constant(self.constant.view(at, (1, 1)).into())
        };
        for (j, column) in self.constant.column_iter().enumerate() {
            for (i, _) in column.iter().enumerate().filter(|(_, v)| **v != 0.0) {
                found.insert((i, j), start((i, j)));
            }
        }
        for (&k, f) in &self.terms {
            for (&at, &v) in f {
                found.entry(at).or_insert_with(|| start(at)).terms.entry(k).or_default().insert((0, 0), v);
            }
        }
        found.into_iter().map(|((i, j), e)| (i, j, e)).collect()
    }

    /// The trace, as a 1×1 expression.
    pub fn trace(&self) -> Self {
        let (rows, cols) = self.shape();
        if self.fault.is_some() || rows != cols {
            return self.faulty("trace", (rows, cols), (cols, 1));
        }
        let sum = DMatrix::from_element(1, 1, self.constant.trace());
        self.mapped(sum, |i, j, v, out| {
            if i == j {
                *out.entry((0, 0)).or_insert(0.0) += v;
            }
        })
    }

    pub fn scaled(&self, by: f64) -> Self {
        if by == 0.0 {
            let mut out = Self::zeros(self.constant.nrows(), self.constant.ncols());
            out.fault = self.fault.clone();
            return out;
        }
        let mut out = self.clone();
        out.constant *= by;
        out.terms.values_mut().flat_map(BTreeMap::values_mut).for_each(|v| *v *= by);
        out
    }

    /// `left · F · right`, with constant matrices.
    pub fn congruence(&self, left: &DMatrix<f64>, right: &DMatrix<f64>) -> Self {
        left * self * right
    }

    /// The matrix put together from rows of blocks.
    pub fn block(rows: &[Vec<Affine>]) -> Self {
        let mut out = Self::zeros(0, 0);
        for (r, row) in rows.iter().enumerate() {
            let mut strip = Self::zeros(0, 0);
            for (c, piece) in row.iter().enumerate() {
                strip = if c == 0 { piece.clone() } else { strip.beside(piece) };
            }
            out = if r == 0 { strip } else { out.above(&strip) };
        }
        out
    }

    /// The symmetric matrix of which `lower` holds the blocks on and below the diagonal: row i has i + 1 blocks.
    pub fn symmetric_block(lower: &[Vec<Affine>]) -> Self {
        let n = lower.len();
        if let Some((i, row)) = lower.iter().enumerate().find(|(i, row)| row.len() != i + 1) {
            let mut out = Self::zeros(0, 0);
            out.fault =
                Some(ShapeError { operation: "lower block row", left: (i + 1, i + 1), right: (i + 1, row.len()) });
            return out;
        }
        let full: Vec<Vec<Affine>> = (0..n)
            .map(|i| (0..n).map(|j| if j <= i { lower[i][j].clone() } else { lower[j][i].transpose() }).collect())
            .collect();
        Self::block(&full)
    }

    fn beside(&self, right: &Self) -> Self {
        let (a, b) = (self.shape(), right.shape());
        let mut out = self.joined("beside", right, a.0 == b.0);
        if out.fault.is_none() {
            let mut constant = DMatrix::zeros(a.0, a.1 + b.1);
            constant.columns_mut(0, a.1).copy_from(&self.constant);
            constant.columns_mut(a.1, b.1).copy_from(&right.constant);
            out.constant = constant;
            out.add_shifted(right, (0, a.1));
        }
        out
    }

    fn above(&self, below: &Self) -> Self {
        let (a, b) = (self.shape(), below.shape());
        let mut out = self.joined("above", below, a.1 == b.1);
        if out.fault.is_none() {
            let mut constant = DMatrix::zeros(a.0 + b.0, a.1);
            constant.rows_mut(0, a.0).copy_from(&self.constant);
            constant.rows_mut(a.0, b.0).copy_from(&below.constant);
            out.constant = constant;
            out.add_shifted(below, (a.0, 0));
        }
        out
    }

    /// A copy of `self` that carries the first fault of the two, or a new one unless they fit.
    fn joined(&self, operation: &'static str, other: &Self, fits: bool) -> Self {
        let mut out = self.clone();
        if out.fault.is_none() {
            out.fault = other.fault.clone();
        }
        if out.fault.is_none() && !fits {
            out.fault = Some(ShapeError { operation, left: self.shape(), right: other.shape() });
        }
        out
    }

    fn add_shifted(&mut self, other: &Self, (down, right): (usize, usize)) {
        for (k, f) in &other.terms {
            let mine = self.terms.entry(*k).or_default();
            for (&(i, j), v) in f {
                let sum = mine.entry((i + down, j + right)).or_insert(0.0);
                *sum += v;
            }
            mine.retain(|_, v| *v != 0.0);
            if mine.is_empty() {
                self.terms.remove(k);
            }
        }
    }

    /// Applies a linear map to F₀ and each Fₖ; `entry` gives the nonzeros into which one entry goes.
    fn mapped(&self, constant: DMatrix<f64>, entry: impl Fn(usize, usize, f64, &mut Sparse)) -> Self {
        let mut terms = BTreeMap::new();
        for (&k, f) in &self.terms {
            let mut out = Sparse::new();
            for (&(i, j), &v) in f {
                entry(i, j, v, &mut out);
            }
            out.retain(|_, v| *v != 0.0);
            if !out.is_empty() {
                terms.insert(k, out);
            }
        }
        Self { constant, terms, fault: None }
    }

    pub(super) fn faulty(&self, operation: &'static str, left: (usize, usize), right: (usize, usize)) -> Self {
        let mut out = Self::zeros(left.0, right.1);
        out.fault = Some(self.fault.clone().unwrap_or(ShapeError { operation, left, right }));
        out
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn matrix(rows: usize, cols: usize) -> impl Strategy<Value = DMatrix<f64>> {
        prop::collection::vec(-3.0..3.0_f64, rows * cols).prop_map(move |v| DMatrix::from_vec(rows, cols, v))
    }

    /// A 3×2 matrix of six unknowns.
    fn unknown() -> Affine {
        Affine::unknowns(3, 2, |i, j| 2 * i + j)
    }

    proptest! {
        #[test]
        fn operators_mean_what_they_mean_for_matrices(
            x in matrix(3, 2), a in matrix(4, 3), b in matrix(2, 5), c in matrix(4, 5), s in -2.0..2.0_f64,
        ) {
            let values: Vec<f64> = x.transpose().iter().copied().collect();
            let e = &a * unknown() * &b - s * Affine::constant(c.clone()) + c.clone();
            let expected = &a * &x * &b - &c * s + &c;
            prop_assert!((e.value(&values) - &expected).amax() < 1e-12);
            prop_assert!((e.transpose().value(&values) - expected.transpose()).amax() < 1e-12);
            let square = &e * &c.transpose();
            prop_assert!((square.trace().value(&values)[(0, 0)] - (expected * c.transpose()).trace()).abs() < 1e-11);
        }

        #[test]
        fn blocks_land_where_they_are_written(x in matrix(3, 2), d in matrix(3, 3)) {
            let values: Vec<f64> = x.transpose().iter().copied().collect();
            let sym = &d + d.transpose();
            let e = Affine::symmetric_block(&[
                vec![Affine::constant(sym.clone())],
                vec![unknown().transpose(), Affine::identity(2)],
            ]);
            let v = e.value(&values);
            prop_assert_eq!(v.shape(), (5, 5));
            prop_assert!((v.view((0, 0), (3, 3)) - sym).amax() < 1e-12);
            prop_assert!((v.view((0, 3), (3, 2)) - &x).amax() < 1e-12);
            prop_assert!((&v - v.transpose()).amax() < 1e-12);
        }
    }

    #[test]
    fn a_wrong_shape_is_remembered_through_further_operations() {
        let wrong = &DMatrix::<f64>::identity(2, 2) * unknown();
        let e = (wrong + Affine::zeros(2, 2)).transpose().scaled(0.0);
        assert_eq!(e.fault(), Some(&ShapeError { operation: "product", left: (2, 2), right: (3, 2) }));
        assert_eq!(e.fault().unwrap().to_string(), "product: 2×2 does not fit 3×2");
        assert!((unknown() + unknown().transpose()).fault().is_some());
        assert!(Affine::block(&[vec![unknown(), Affine::zeros(2, 2)]]).fault().is_some());
        assert!(Affine::block(&[vec![unknown()], vec![Affine::zeros(2, 3)]]).fault().is_some());
        assert!(Affine::symmetric_block(&[vec![unknown(), unknown()]]).fault().is_some());
    }

    #[test]
    fn cancelled_terms_vanish() {
        assert!((unknown() - unknown()).terms().is_empty());
    }
}
