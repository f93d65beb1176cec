use std::ops::Sub;

/// Nanoseconds since the vehicle booted, on the vehicle's own clock.
///
/// Receive time and UTC are kept beside it, never in it: two stamps of one vehicle may always be subtracted.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Default)]
pub struct Stamp(i64);

impl Stamp {
    pub const fn from_nanos(ns: i64) -> Self {
        Self(ns)
    }

    pub const fn from_micros(us: i64) -> Self {
        Self(us.saturating_mul(1_000))
    }

    pub const fn from_millis(ms: i64) -> Self {
        Self(ms.saturating_mul(1_000_000))
    }

    /// From seconds; saturates outside the range of `i64` nanoseconds, and NaN becomes zero.
    pub fn from_secs(s: f64) -> Self {
        Self((s * 1e9).round() as i64)
    }

    pub const fn nanos(self) -> i64 {
        self.0
    }

    pub fn secs(self) -> f64 {
        self.0 as f64 * 1e-9
    }

    /// This stamp moved by `s` seconds.
    pub fn plus_secs(self, s: f64) -> Self {
        Self(self.0.saturating_add((s * 1e9).round() as i64))
    }
}

impl Sub for Stamp {
    type Output = f64;

    /// Seconds from `earlier` to `self`.
    #[allow(clippy::suspicious_arithmetic_impl)] // the difference of two instants is a time, not an instant
    fn sub(self, earlier: Self) -> f64 {
        self.0.saturating_sub(earlier.0) as f64 * 1e-9
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn differences_are_seconds() {
        let a = Stamp::from_millis(1_500);
        assert_eq!(a - Stamp::from_micros(250_000), 1.25);
        assert_eq!(a.plus_secs(-0.5), Stamp::from_secs(1.0));
        assert_eq!(Stamp::from_micros(i64::MAX), Stamp::from_nanos(i64::MAX));
    }
}
