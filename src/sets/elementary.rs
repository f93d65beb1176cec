use super::Interval;
use std::f64::consts::{FRAC_PI_2, PI, TAU};
use std::ops::Div;

/// Arguments beyond this lose too many digits for the place of a sine's extremes to be known.
const LARGEST_ANGLE: f64 = 1e6;
/// The mathematics libraries in use err by less than one unit in the last place; this allows for four.
const LIBRARY_ULPS: usize = 4;

impl Interval {
    /// x², tighter than `x * x`, which forgets that both factors are the same.
    pub fn sqr(self) -> Self {
        let (a, b) = (self.lo() * self.lo(), self.hi() * self.hi());
        let low = if self.contains(0.0) { 0.0 } else { a.min(b).next_down() };
        Self::new(low.max(0.0), a.max(b).next_up())
    }

    /// √x of the members that are not negative; the whole line when there are none.
    pub fn sqrt(self) -> Self {
        if self.hi() < 0.0 {
            return Self::ENTIRE;
        }
        Self::new(self.lo().max(0.0).sqrt().next_down().max(0.0), self.hi().sqrt().next_up())
    }

    /// 1/x; the whole line when 0 is a member.
    pub fn recip(self) -> Self {
        if self.contains(0.0) {
            return Self::ENTIRE;
        }
        Self::new((1.0 / self.hi()).next_down(), (1.0 / self.lo()).next_up())
    }

    /// Sine of an angle in rad.
    pub fn sin(self) -> Self {
        self.wave(f64::sin, FRAC_PI_2)
    }

    /// Cosine of an angle in rad.
    pub fn cos(self) -> Self {
        self.wave(f64::cos, 0.0)
    }

    /// A wave of period 2π between −1 and 1 with a crest at `crest`.
    fn wave(self, f: fn(f64) -> f64, crest: f64) -> Self {
        if self.mag() > LARGEST_ANGLE || self.hi() - self.lo() >= TAU {
            return Self::new(-1.0, 1.0);
        }
        // the crests and troughs are found with a margin far above the error of their computed places
        let (from, to) = (self.lo() - 1e-9, self.hi() + 1e-9);
        let reaches = |place: f64| place + TAU * ((from - place) / TAU).ceil() <= to;
        let (a, b) = (f(self.lo()), f(self.hi()));
        let widen = |x: f64, step: fn(f64) -> f64| (0..LIBRARY_ULPS).fold(x, |x, _| step(x)).clamp(-1.0, 1.0);
        let low = if reaches(crest + PI) { -1.0 } else { widen(a.min(b), f64::next_down) };
        let high = if reaches(crest) { 1.0 } else { widen(a.max(b), f64::next_up) };
        Self::new(low, high)
    }
}

impl Div for Interval {
    type Output = Self;

    #[allow(clippy::suspicious_arithmetic_impl)] // division by an interval is the product with its reciprocal
    fn div(self, o: Self) -> Self {
        self * o.recip()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn interval() -> impl Strategy<Value = (Interval, f64)> {
        (-20.0..20.0_f64, 0.0..7.0_f64, 0.0..=1.0_f64).prop_map(|(lo, w, s)| {
            let i = Interval::new(lo, lo + w);
            (i, (i.lo() + s * w).clamp(i.lo(), i.hi()))
        })
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(4096))]
        #[test]
        fn members_stay_inside((a, x) in interval(), (b, y) in interval()) {
            prop_assert!(a.sqr().contains(x * x));
            prop_assert!(a.sin().contains(x.sin()));
            prop_assert!(a.cos().contains(x.cos()));
            prop_assert!(x < 0.0 || a.sqrt().contains(x.sqrt()));
            prop_assert!(y == 0.0 || (a / b).contains(x / y));
        }
    }

    #[test]
    fn waves_are_tight() {
        let near = |i: Interval, lo: f64, hi: f64| (i.lo() - lo).abs() < 1e-12 && (i.hi() - hi).abs() < 1e-12;
        assert!(near(Interval::new(0.1, 0.2).sin(), 0.1_f64.sin(), 0.2_f64.sin()));
        assert!(near(Interval::new(1.0, 2.0).sin(), 1.0_f64.sin(), 1.0));
        assert!(near(Interval::new(-0.3, 0.2).cos(), 0.3_f64.cos(), 1.0));
        assert!(near(Interval::new(3.0, 3.5).cos(), -1.0, 3.5_f64.cos()));
        assert_eq!(Interval::new(0.0, 7.0).cos(), Interval::new(-1.0, 1.0));
        assert_eq!(Interval::ENTIRE.sin(), Interval::new(-1.0, 1.0));
    }

    #[test]
    fn what_has_no_answer_says_nothing() {
        assert_eq!(Interval::new(-1.0, 1.0).recip(), Interval::ENTIRE);
        assert_eq!(Interval::new(-2.0, -1.0).sqrt(), Interval::ENTIRE);
        assert_eq!(Interval::new(-1.0, 4.0).sqrt().lo(), 0.0);
    }
}
