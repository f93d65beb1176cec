//! Affine expressions as they are written: sums, differences, products with numbers and constant matrices.

use super::Affine;
use nalgebra::DMatrix;
use std::ops::{Add, Mul, Neg, Sub};

impl From<&Affine> for Affine {
    fn from(a: &Affine) -> Self {
        a.clone()
    }
}

impl From<DMatrix<f64>> for Affine {
    fn from(m: DMatrix<f64>) -> Self {
        Self::constant(m)
    }
}

impl<T: Into<Affine>> Add<T> for &Affine {
    type Output = Affine;
    fn add(self, other: T) -> Affine {
        let other = other.into();
        let mut out = self.joined("sum", &other, self.shape() == other.shape());
        if out.fault.is_none() {
            out.constant += &other.constant;
            out.add_shifted(&other, (0, 0));
        }
        out
    }
}

impl<T: Into<Affine>> Add<T> for Affine {
    type Output = Affine;
    fn add(self, other: T) -> Affine {
        &self + other
    }
}

impl<T: Into<Affine>> Sub<T> for &Affine {
    type Output = Affine;
    fn sub(self, other: T) -> Affine {
        self + (-other.into())
    }
}

impl<T: Into<Affine>> Sub<T> for Affine {
    type Output = Affine;
    fn sub(self, other: T) -> Affine {
        &self - other
    }
}

impl Neg for &Affine {
    type Output = Affine;
    fn neg(self) -> Affine {
        self.scaled(-1.0)
    }
}

impl Neg for Affine {
    type Output = Affine;
    fn neg(self) -> Affine {
        self.scaled(-1.0)
    }
}

impl Mul<&Affine> for f64 {
    type Output = Affine;
    fn mul(self, a: &Affine) -> Affine {
        a.scaled(self)
    }
}

impl Mul<Affine> for f64 {
    type Output = Affine;
    fn mul(self, a: Affine) -> Affine {
        a.scaled(self)
    }
}

impl Mul<&Affine> for &DMatrix<f64> {
    type Output = Affine;
    fn mul(self, a: &Affine) -> Affine {
        if a.fault.is_some() || self.ncols() != a.constant.nrows() {
            return a.faulty("product", self.shape(), a.shape());
        }
        a.mapped(self * &a.constant, |i, j, v, out| {
            for (r, c) in self.column(i).iter().enumerate() {
                *out.entry((r, j)).or_insert(0.0) += c * v;
            }
        })
    }
}

impl Mul<Affine> for &DMatrix<f64> {
    type Output = Affine;
    fn mul(self, a: Affine) -> Affine {
        self * &a
    }
}

impl Mul<&DMatrix<f64>> for &Affine {
    type Output = Affine;
    fn mul(self, m: &DMatrix<f64>) -> Affine {
        if self.fault.is_some() || self.constant.ncols() != m.nrows() {
            return self.faulty("product", self.shape(), m.shape());
        }
        self.mapped(&self.constant * m, |i, j, v, out| {
            for (c, x) in m.row(j).iter().enumerate() {
                *out.entry((i, c)).or_insert(0.0) += x * v;
            }
        })
    }
}

impl Mul<&DMatrix<f64>> for Affine {
    type Output = Affine;
    fn mul(self, m: &DMatrix<f64>) -> Affine {
        &self * m
    }
}
