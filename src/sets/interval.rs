use std::ops::{Add, Mul, Neg, Sub};

/// A closed interval `[lo, hi]` with outward rounding: the exact result of an operation on any members lies inside
/// the computed interval.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Interval {
    lo: f64,
    hi: f64,
}

impl Interval {
    /// The whole line: nothing is known.
    pub const ENTIRE: Self = Self { lo: f64::NEG_INFINITY, hi: f64::INFINITY };

    /// Exactly zero.
    pub const ZERO: Self = Self { lo: 0.0, hi: 0.0 };

    /// The interval between two numbers, in either order. A NaN end gives the whole line: nothing is known.
    pub fn new(a: f64, b: f64) -> Self {
        if a.is_nan() || b.is_nan() {
            return Self::ENTIRE;
        }
        Self { lo: a.min(b), hi: a.max(b) }
    }

    pub fn point(x: f64) -> Self {
        Self::new(x, x)
    }

    /// `centre ± radius`; a negative radius counts as its size.
    pub fn centred(centre: f64, radius: f64) -> Self {
        let r = radius.abs();
        Self::new((centre - r).next_down(), (centre + r).next_up())
    }

    pub fn lo(self) -> f64 {
        self.lo
    }

    pub fn hi(self) -> f64 {
        self.hi
    }

    pub fn mid(self) -> f64 {
        0.5 * self.lo + 0.5 * self.hi
    }

    /// The largest distance from the middle to an end, rounded up.
    pub fn radius(self) -> f64 {
        let m = self.mid();
        (self.hi - m).max(m - self.lo).next_up()
    }

    pub fn contains(self, x: f64) -> bool {
        self.lo <= x && x <= self.hi
    }

    /// The largest absolute value.
    pub fn mag(self) -> f64 {
        self.lo.abs().max(self.hi.abs())
    }

    /// The common part; `None` when disjoint.
    pub fn intersect(self, other: Self) -> Option<Self> {
        let (lo, hi) = (self.lo.max(other.lo), self.hi.min(other.hi));
        (lo <= hi).then_some(Self { lo, hi })
    }

    /// The smallest interval that holds both.
    pub fn hull(self, other: Self) -> Self {
        Self { lo: self.lo.min(other.lo), hi: self.hi.max(other.hi) }
    }

    fn outward(lo: f64, hi: f64) -> Self {
        Self::new(lo.next_down(), hi.next_up())
    }
}

impl Add for Interval {
    type Output = Self;
    fn add(self, o: Self) -> Self {
        Self::outward(self.lo + o.lo, self.hi + o.hi)
    }
}

impl Sub for Interval {
    type Output = Self;
    fn sub(self, o: Self) -> Self {
        Self::outward(self.lo - o.hi, self.hi - o.lo)
    }
}

impl Neg for Interval {
    type Output = Self;
    fn neg(self) -> Self {
        Self { lo: -self.hi, hi: -self.lo }
    }
}

impl Mul for Interval {
    type Output = Self;
    fn mul(self, o: Self) -> Self {
        let p = [self.lo * o.lo, self.lo * o.hi, self.hi * o.lo, self.hi * o.hi];
        // 0 · ∞ is NaN: then nothing is known, which `new` turns into the whole line
        if p.iter().any(|x| x.is_nan()) {
            return Self::new(f64::NAN, f64::NAN);
        }
        Self::outward(
            p.iter().copied().fold(f64::INFINITY, f64::min),
            p.iter().copied().fold(f64::NEG_INFINITY, f64::max),
        )
    }
}

impl Mul<f64> for Interval {
    type Output = Self;
    fn mul(self, k: f64) -> Self {
        self * Self::point(k)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn interval() -> impl Strategy<Value = (Interval, f64)> {
        (-1e6..1e6_f64, 0.0..1e5_f64, 0.0..=1.0_f64).prop_map(|(lo, w, s)| {
            let i = Interval::new(lo, lo + w);
            (i, (i.lo() + s * (i.hi() - i.lo())).clamp(i.lo(), i.hi()))
        })
    }

    proptest! {
        #[test]
        fn members_stay_inside((a, x) in interval(), (b, y) in interval()) {
            prop_assert!((a + b).contains(x + y));
            prop_assert!((a - b).contains(x - y));
            prop_assert!((a * b).contains(x * y));
            prop_assert!((-a).contains(-x));
            prop_assert!(a.hull(b).contains(x) && a.hull(b).contains(y));
            prop_assert!(Interval::centred(a.mid(), a.radius()).contains(x));
            if let Some(c) = a.intersect(b) {
                prop_assert!(a.contains(c.mid()) && b.contains(c.mid()));
            }
        }
    }

    #[test]
    fn unknown_ends_mean_the_whole_line() {
        assert!(Interval::new(f64::NAN, 1.0).contains(1e300));
        assert!((Interval::new(f64::NEG_INFINITY, f64::INFINITY) * Interval::point(0.0)).contains(7.0));
        assert_eq!(Interval::new(1.0, 2.0).intersect(Interval::new(3.0, 4.0)), None);
    }
}
