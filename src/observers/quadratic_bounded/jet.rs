use crate::sets::Interval;
use nalgebra::DMatrix;

/// A function of one variable over an interval of it: enclosures of its value and of its first two derivatives.
///
/// Arithmetic follows the product and chain rules in interval arithmetic, so every enclosure holds for all values of
/// the variable in the interval.
#[derive(Debug, Clone, Copy)]
pub(super) struct Jet {
    value: Interval,
    first: Interval,
    second: Interval,
}

impl Jet {
    pub(super) fn constant(x: f64) -> Self {
        let zero = Interval::point(0.0);
        Self { value: Interval::point(x), first: zero, second: zero }
    }

    /// The variable itself, over an interval.
    pub(super) fn variable(over: Interval) -> Self {
        Self { value: over, first: Interval::point(1.0), second: Interval::point(0.0) }
    }

    pub(super) fn plus(self, o: Self) -> Self {
        Self { value: self.value + o.value, first: self.first + o.first, second: self.second + o.second }
    }

    pub(super) fn times(self, o: Self) -> Self {
        // most factors are constants, many of them zero
        match (self.as_constant(), o.as_constant()) {
            (Some(0.0), _) | (_, Some(0.0)) => return Self::constant(0.0),
            (Some(k), _) => return o.by_constant(k),
            (_, Some(k)) => return self.by_constant(k),
            (None, None) => {}
        }
        Self {
            value: self.value * o.value,
            first: self.first * o.value + self.value * o.first,
            second: self.second * o.value + (self.first * o.first) * 2.0 + self.value * o.second,
        }
    }

    fn as_constant(self) -> Option<f64> {
        let flat = self.first.mag() == 0.0 && self.second.mag() == 0.0;
        (flat && self.value.lo() == self.value.hi()).then(|| self.value.lo())
    }

    fn by_constant(self, k: f64) -> Self {
        Self { value: self.value * k, first: self.first * k, second: self.second * k }
    }

    /// 1/f; nothing is known when f may be zero or negative.
    pub(super) fn reciprocal(self) -> Self {
        let v = self.value;
        let r = if v.lo() > 0.0 {
            Interval::new((1.0 / v.hi()).next_down(), (1.0 / v.lo()).next_up())
        } else {
            Interval::new(f64::NAN, f64::NAN)
        };
        let r2 = r * r;
        Self { value: r, first: -(self.first * r2), second: self.first * self.first * r2 * r * 2.0 - self.second * r2 }
    }

    /// e^{rate·f}, for f a variable or constant (f″ = 0).
    pub(super) fn exp_of(self, rate: f64) -> Self {
        // the library's exp errs by at most a few units in the last place
        let end = |x: f64, up: f64| (rate * x).exp() * (1.0 + up * 8.0 * f64::EPSILON);
        let (a, b) = (self.value.lo(), self.value.hi());
        let (lo, hi) = if rate >= 0.0 { (end(a, -1.0), end(b, 1.0)) } else { (end(b, -1.0), end(a, 1.0)) };
        let value = Interval::new(lo, hi);
        let slope = self.first * rate;
        Self { value, first: value * slope, second: value * slope * slope }
    }
}

/// A matrix of [`Jet`]s, row by row.
#[derive(Debug, Clone)]
pub(super) struct JetMatrix {
    rows: usize,
    cols: usize,
    at: Vec<Jet>,
}

impl JetMatrix {
    pub(super) fn constant(m: &DMatrix<f64>) -> Self {
        let (rows, cols) = m.shape();
        let at = (0..rows * cols).map(|k| Jet::constant(m[(k / cols, k % cols)])).collect();
        Self { rows, cols, at }
    }

    fn get(&self, i: usize, j: usize) -> Jet {
        self.at[i * self.cols + j]
    }

    pub(super) fn plus(&self, o: &Self) -> Self {
        debug_assert_eq!((self.rows, self.cols), (o.rows, o.cols));
        Self { at: self.at.iter().zip(&o.at).map(|(a, b)| a.plus(*b)).collect(), ..*self }
    }

    pub(super) fn scaled(&self, by: Jet) -> Self {
        Self { at: self.at.iter().map(|a| a.times(by)).collect(), ..*self }
    }

    pub(super) fn times(&self, o: &Self) -> Self {
        debug_assert_eq!(self.cols, o.rows);
        let at = (0..self.rows * o.cols)
            .map(|k| {
                let (i, j) = (k / o.cols, k % o.cols);
                (0..self.cols).fold(Jet::constant(0.0), |sum, l| sum.plus(self.get(i, l).times(o.get(l, j))))
            })
            .collect();
        Self { rows: self.rows, cols: o.cols, at }
    }

    pub(super) fn transpose(&self) -> Self {
        let at = (0..self.rows * self.cols).map(|k| self.get(k % self.rows, k / self.rows)).collect();
        Self { rows: self.cols, cols: self.rows, at }
    }

    /// A bound on the spectral norm of the second derivative.
    pub(super) fn second_norm(&self) -> f64 {
        frobenius(self.at.iter().map(|x| x.second.mag()))
    }
}

fn frobenius(entries: impl Iterator<Item = f64>) -> f64 {
    entries.map(|x| x * x).sum::<f64>().sqrt() * (1.0 + 1e-12)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn values_and_derivatives_are_enclosed(a in 0.01..0.1_f64, width in 0.0..0.05_f64, s in 0.0..=1.0_f64) {
            // f(x) = x·e^{−3x} / (1 − e^{−2x}), derivatives by central differences of f
            let over = Interval::new(a, a + width);
            let x = Jet::variable(over);
            let lambda = Jet::constant(1.0).plus(x.exp_of(-2.0).times(Jet::constant(-1.0)));
            let f = x.times(x.exp_of(-3.0)).times(lambda.reciprocal());
            let at = |x: f64| x * (-3.0 * x).exp() / -(-2.0 * x).exp_m1();
            let (p, h) = (a + s * width, 1e-4);
            prop_assert!(f.value.contains(at(p)));
            let first = (at(p + h) - at(p - h)) / (2.0 * h);
            let second = (at(p + h) - 2.0 * at(p) + at(p - h)) / (h * h);
            prop_assert!(f.first.lo() - 1e-5 <= first && first <= f.first.hi() + 1e-5);
            prop_assert!(f.second.lo() - 1e-5 <= second && second <= f.second.hi() + 1e-5);
        }
    }

    #[test]
    fn a_reciprocal_across_zero_knows_nothing() {
        let r = Jet::variable(Interval::new(-1.0, 1.0)).reciprocal();
        assert!(r.value.hi().is_infinite());
    }
}
