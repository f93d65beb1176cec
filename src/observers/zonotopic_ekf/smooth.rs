//! Equations written once, differentiated twice by the computer, with bounds: for models of one's own.

use super::model::{Linearised, Model, Output};
use crate::sets::Interval;
use nalgebra::{SMatrix, SVector};
use std::ops::{Add, Mul, Neg, Sub};

/// What equations are made of.
pub trait Smooth:
    Copy + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> + Neg<Output = Self> + Mul<f64, Output = Self>
{
    fn constant(x: f64) -> Self;
    fn sin(self) -> Self;
    fn cos(self) -> Self;
    fn sqrt(self) -> Self;
    fn recip(self) -> Self;
}

impl Smooth for f64 {
    fn constant(x: f64) -> Self {
        x
    }
    fn sin(self) -> Self {
        Self::sin(self)
    }
    fn cos(self) -> Self {
        Self::cos(self)
    }
    fn sqrt(self) -> Self {
        Self::sqrt(self)
    }
    fn recip(self) -> Self {
        Self::recip(self)
    }
}

/// A system given by its equations. [`Differentiated`] makes a [`Model`] of it.
pub trait Equations<const N: usize> {
    type Input;

    /// f(x, u).
    fn next<S: Smooth>(&self, x: &[S; N], input: &Self::Input) -> [S; N];

    /// Half-widths of what else may be added to each state in one step.
    fn disturbance(&self, input: &Self::Input) -> SVector<f64, N>;
}

/// A [`Model`] from [`Equations`]: value and Jacobian at the base, and the remainder `½·Σ|∂²f/∂xᵢ∂xⱼ|·rᵢ·rⱼ` of the
/// Lagrange form with the second derivatives bounded over the box, all in interval arithmetic.
///
/// Second derivatives of every operation are carried along: an operation costs about N² multiplications. For a fast
/// loop write the [`Model`] by hand.
#[derive(Debug, Clone, Copy)]
pub struct Differentiated<E>(pub E);

impl<const N: usize, E: Equations<N>> Model<N> for Differentiated<E> {
    type Input = E::Input;

    fn linearise(&self, base: &SVector<f64, N>, hull: &[Interval; N], input: &Self::Input) -> Option<Linearised<N>> {
        let here = self.0.next(&variables(&std::array::from_fn(|i| Interval::point(base[i]))), input);
        let over = self.0.next(&variables(hull), input);
        let radius = radii(base, hull);
        let mut out = Linearised {
            value: SVector::zeros(),
            jacobian: SMatrix::zeros(),
            disturbance: self.0.disturbance(input),
            remainder: SVector::zeros(),
        };
        for (i, (here, over)) in here.iter().zip(&over).enumerate() {
            let (value, row, remainder) = lagrange(here, over, &radius);
            out.value[i] = value;
            out.jacobian.set_row(i, &row.transpose());
            out.remainder[i] = remainder;
        }
        out.remainder.iter().all(|r| r.is_finite()).then_some(out)
    }
}

/// A nonlinear output from its equation, linearised about `base` over the box. `None` where it cannot be bounded.
pub fn output<const N: usize>(
    name: &'static str,
    h: impl Fn(&[Jet<N>; N]) -> Jet<N>,
    base: &SVector<f64, N>,
    hull: &[Interval; N],
    y: f64,
    noise: f64,
) -> Option<Output<N>> {
    let here = h(&variables(&std::array::from_fn(|i| Interval::point(base[i]))));
    let over = h(&variables(hull));
    let (value, row, remainder) = lagrange(&here, &over, &radii(base, hull));
    remainder.is_finite().then(|| Output::about(name, base, value, row, remainder, y, noise))
}

/// Largest distance from the base to the ends of the box.
pub(super) fn radii<const N: usize>(base: &SVector<f64, N>, hull: &[Interval; N]) -> SVector<f64, N> {
    SVector::from_fn(|i, _| (hull[i].hi() - base[i]).max(base[i] - hull[i].lo()).max(0.0).next_up())
}

fn lagrange<const N: usize>(here: &Jet<N>, over: &Jet<N>, r: &SVector<f64, N>) -> (f64, SVector<f64, N>, f64) {
    let mut remainder = here.value.radius();
    for i in 0..N {
        remainder += here.gradient[i].radius() * r[i];
        for j in 0..N {
            remainder += 0.5 * over.hessian[i][j].mag() * r[i] * r[j];
        }
    }
    let row = SVector::from_fn(|i, _| here.gradient[i].mid());
    (here.value.mid(), row, remainder * (1.0 + 4.0 * ((N + 2) * (N + 2)) as f64 * f64::EPSILON) + f64::MIN_POSITIVE)
}

fn variables<const N: usize>(at: &[Interval; N]) -> [Jet<N>; N] {
    std::array::from_fn(|k| {
        let mut x = Jet::of(at[k]);
        x.gradient[k] = Interval::point(1.0);
        x
    })
}

const ZERO: Interval = Interval::ZERO;

/// Intervals that hold a function of N variables with its first and second derivatives.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Jet<const N: usize> {
    value: Interval,
    gradient: [Interval; N],
    hessian: [[Interval; N]; N],
}

impl<const N: usize> Jet<N> {
    fn of(value: Interval) -> Self {
        Self { value, gradient: [ZERO; N], hessian: [[ZERO; N]; N] }
    }

    /// g(x) by the chain rule, given g, g′ and g″ at x.
    fn chain(self, value: Interval, first: Interval, second: Interval) -> Self {
        let mut out = Self::of(value);
        for i in 0..N {
            out.gradient[i] = times(first, self.gradient[i]);
            for j in 0..N {
                let bent = times(second, times(self.gradient[i], self.gradient[j]));
                out.hessian[i][j] = plus(bent, times(first, self.hessian[i][j]));
            }
        }
        out
    }

    fn each(self, other: Self, f: impl Fn(Interval, Interval) -> Interval) -> Self {
        Self {
            value: f(self.value, other.value),
            gradient: std::array::from_fn(|i| f(self.gradient[i], other.gradient[i])),
            hessian: std::array::from_fn(|i| std::array::from_fn(|j| f(self.hessian[i][j], other.hessian[i][j]))),
        }
    }
}

/// Most derivatives are exactly zero: no rounding then.
fn times(a: Interval, b: Interval) -> Interval {
    if a == ZERO || b == ZERO { ZERO } else { a * b }
}

fn plus(a: Interval, b: Interval) -> Interval {
    if a == ZERO {
        b
    } else if b == ZERO {
        a
    } else {
        a + b
    }
}

impl<const N: usize> Add for Jet<N> {
    type Output = Self;
    fn add(self, o: Self) -> Self {
        self.each(o, plus)
    }
}

impl<const N: usize> Sub for Jet<N> {
    type Output = Self;
    fn sub(self, o: Self) -> Self {
        self.each(o, |a, b| plus(a, -b))
    }
}

impl<const N: usize> Neg for Jet<N> {
    type Output = Self;
    fn neg(self) -> Self {
        self.each(self, |a, _| -a)
    }
}

impl<const N: usize> Mul for Jet<N> {
    type Output = Self;
    fn mul(self, o: Self) -> Self {
        let mut out = Self::of(times(self.value, o.value));
        for i in 0..N {
            out.gradient[i] = plus(times(self.gradient[i], o.value), times(self.value, o.gradient[i]));
            for j in 0..N {
                let outer = plus(times(self.hessian[i][j], o.value), times(self.value, o.hessian[i][j]));
                let cross = plus(times(self.gradient[i], o.gradient[j]), times(self.gradient[j], o.gradient[i]));
                out.hessian[i][j] = plus(outer, cross);
            }
        }
        out
    }
}

impl<const N: usize> Mul<f64> for Jet<N> {
    type Output = Self;
    fn mul(self, k: f64) -> Self {
        self.each(self, |a, _| times(a, Interval::point(k)))
    }
}

impl<const N: usize> Smooth for Jet<N> {
    fn constant(x: f64) -> Self {
        Self::of(Interval::point(x))
    }

    fn sin(self) -> Self {
        let (s, c) = (self.value.sin(), self.value.cos());
        self.chain(s, c, -s)
    }

    fn cos(self) -> Self {
        let (s, c) = (self.value.sin(), self.value.cos());
        self.chain(c, -s, -c)
    }

    fn sqrt(self) -> Self {
        let root = self.value.sqrt();
        let first = (root * 2.0).recip();
        self.chain(root, first, -(first * (self.value * 2.0).recip()))
    }

    fn recip(self) -> Self {
        let inverse = self.value.recip();
        let first = -inverse.sqr();
        self.chain(inverse, first, -(first * inverse) * 2.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    struct Pendulum;

    impl Equations<2> for Pendulum {
        type Input = f64;

        fn next<S: Smooth>(&self, x: &[S; 2], dt: &f64) -> [S; 2] {
            let inertia = (S::constant(2.0) + x[0].cos()).recip();
            [x[0] + x[1] * *dt, x[1] - (x[0].sin() * inertia + (S::constant(1.0) + x[1] * x[1]).sqrt()) * *dt]
        }

        fn disturbance(&self, _: &f64) -> SVector<f64, 2> {
            SVector::zeros()
        }
    }

    /// Remainders, and the largest errors of the linear form found on a grid over the box.
    fn remainder_and_error(base: [f64; 2], radius: [f64; 2]) -> ([f64; 2], [f64; 2]) {
        let hull = [0, 1].map(|k| Interval::new(base[k] - radius[k], base[k] + radius[k]));
        let base = SVector::from(base);
        let form = Differentiated(Pendulum).linearise(&base, &hull, &0.2).unwrap();
        let mut largest = [0.0_f64; 2];
        for i in -20..=20 {
            for j in -20..=20 {
                let x = [base[0] + radius[0] * f64::from(i) / 20.0, base[1] + radius[1] * f64::from(j) / 20.0];
                let error =
                    SVector::from(Pendulum.next(&x, &0.2)) - (form.value + form.jacobian * (SVector::from(x) - base));
                largest = [0, 1].map(|k| largest[k].max(error[k].abs()));
            }
        }
        (form.remainder.into(), largest)
    }

    #[test]
    fn the_linear_form_holds_the_function_over_the_box() {
        let wide = remainder_and_error([0.3, 1.5], [0.65, 0.75]);
        let narrow = remainder_and_error([0.3, 1.5], [0.065, 0.075]);
        for (remainder, error) in [wide, narrow] {
            assert!(error[0] <= remainder[0] && error[1] <= remainder[1], "{error:?} beyond {remainder:?}");
            assert!(remainder[0] < 1e-14, "the first equation is linear");
        }
        // x₀ enters the second derivatives often, so interval arithmetic exaggerates: less over a smaller box
        let exaggeration = |(remainder, error): ([f64; 2], [f64; 2])| remainder[1] / error[1];
        assert!(exaggeration(narrow) < 6.0, "{} for {}", narrow.0[1], narrow.1[1]);
        assert!(exaggeration(narrow) < exaggeration(wide));
    }

    #[test]
    fn derivatives_agree_with_differences() {
        let base = SVector::from([0.3, 1.5]);
        let hull = [Interval::point(0.3), Interval::point(1.5)];
        let form = Differentiated(Pendulum).linearise(&base, &hull, &0.2).unwrap();
        for k in 0..2 {
            let at = |h: f64| {
                let mut x = [0.3, 1.5];
                x[k] += h;
                SVector::from(Pendulum.next(&x, &0.2))
            };
            let slope = (at(1e-6) - at(-1e-6)) / 2e-6;
            assert!((slope - form.jacobian.column(k)).norm() < 1e-8);
        }
        assert!(form.remainder.norm() < 1e-14);
    }
}
