//! Norms and products with unknown numbers, as expressions for a linear matrix inequality.

use super::expr::Affine;
use nalgebra::DMatrix;

impl Affine {
    /// u·M for an unknown number: a 1×1 expression times a constant matrix.
    pub fn times(&self, m: &DMatrix<f64>) -> Self {
        if self.shape() != (1, 1) {
            return self.faulty("number times matrix", self.shape(), m.shape());
        }
        let rows: Vec<Vec<Affine>> = m.row_iter().map(|row| row.iter().map(|&v| self.scaled(v)).collect()).collect();
        Self::block(&rows)
    }

    /// u·I of size n, for a 1×1 expression.
    pub fn times_identity(&self, n: usize) -> Self {
        self.times(&DMatrix::identity(n, n))
    }

    /// [t·I, F; Fᵀ, t·I], which is ⪰ 0 exactly when the largest singular value of F is at most t.
    pub fn spectral_norm_within(&self, t: &Affine) -> Self {
        let (rows, cols) = self.shape();
        Self::symmetric_block(&[vec![t.times_identity(rows)], vec![self.transpose(), t.times_identity(cols)]])
    }

    /// [t, vᵀ; v, t·I] with v the entries of F, which is ⪰ 0 exactly when the Frobenius norm of F (for a vector its
    /// length) is at most t.
    pub fn frobenius_norm_within(&self, t: &Affine) -> Self {
        self.entries().spectral_norm_within(t)
    }

    /// [t, vᵀ; v, I] with v the entries of F, which is ⪰ 0 exactly when the sum of their squares is at most t.
    pub fn squares_within(&self, t: &Affine) -> Self {
        let v = self.entries();
        let n = v.shape().0;
        Self::symmetric_block(&[vec![t.clone()], vec![v, Self::identity(n)]])
    }

    /// All entries in one column.
    fn entries(&self) -> Self {
        let cols = self.shape().1;
        let column = |j: usize| self * &DMatrix::from_fn(cols, 1, |i, _| if i == j { 1.0 } else { 0.0 });
        Self::block(&(0..cols).map(|j| vec![column(j)]).collect::<Vec<_>>())
    }
}
