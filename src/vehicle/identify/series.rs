/// A gap longer than this is not bridged by interpolation, s.
const MAX_GAP_S: f64 = 0.6;

/// Samples of one quantity in order of time (s on the vehicle's boot clock).
#[derive(Debug, Clone)]
pub struct Series<T> {
    t: Vec<f64>,
    x: Vec<T>,
}

impl<T> Default for Series<T> {
    fn default() -> Self {
        Self { t: Vec::new(), x: Vec::new() }
    }
}

impl<T: Copy> Series<T> {
    /// Appends a sample; one that is not later than the newest is left out.
    pub fn push(&mut self, t_s: f64, value: T) {
        if t_s.is_finite() && self.t.last().is_none_or(|last| t_s > *last) {
            self.t.push(t_s);
            self.x.push(value);
        }
    }

    pub fn len(&self) -> usize {
        self.t.len()
    }

    pub fn is_empty(&self) -> bool {
        self.t.is_empty()
    }

    pub fn times(&self) -> &[f64] {
        &self.t
    }

    pub fn iter(&self) -> impl Iterator<Item = (f64, T)> + '_ {
        self.t.iter().copied().zip(self.x.iter().copied())
    }

    /// The usual time between samples (median), s; infinite where there are fewer than two.
    pub fn period_s(&self) -> f64 {
        let mut gaps: Vec<f64> = self.t.windows(2).map(|w| w[1] - w[0]).collect();
        median(&mut gaps).unwrap_or(f64::INFINITY)
    }

    /// The two samples around an instant and the share of the way between them; `None` outside and in gaps.
    fn around(&self, t_s: f64) -> Option<(T, T, f64)> {
        let after = self.t.partition_point(|t| *t < t_s);
        let (b, later) = (*self.t.get(after)?, *self.x.get(after)?);
        let Some(before) = after.checked_sub(1) else { return (b == t_s).then_some((later, later, 0.0)) };
        let a = self.t[before];
        (b - a <= MAX_GAP_S).then(|| (self.x[before], later, (t_s - a) / (b - a)))
    }

    /// The value at an instant, by `lerp(before, after, share)`.
    pub fn interpolate(&self, t_s: f64, lerp: impl Fn(&T, &T, f64) -> T) -> Option<T> {
        self.around(t_s).map(|(a, b, share)| lerp(&a, &b, share))
    }

    /// The newest value at an instant, however old.
    pub fn hold(&self, t_s: f64) -> Option<T> {
        self.x.get(self.t.partition_point(|t| *t <= t_s).checked_sub(1)?).copied()
    }
}

/// The median; the slice is reordered. `None` for an empty one.
pub fn median(x: &mut [f64]) -> Option<f64> {
    quantile(x, 0.5)
}

/// The value below which the share `q` of the values lies; the slice is reordered. `None` for an empty one.
pub fn quantile(x: &mut [f64], q: f64) -> Option<f64> {
    let at = ((x.len() as f64 * q) as usize).min(x.len().checked_sub(1)?);
    Some(*x.select_nth_unstable_by(at, f64::total_cmp).1)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn interpolates_inside_and_not_across_gaps() {
        let mut s = Series::default();
        for t in [0.0, 0.2, 0.1, 0.4, 2.0, 2.1] {
            s.push(t, 10.0 * t);
        }
        assert_eq!(s.len(), 5, "what comes late is left out");
        let at = |t| s.interpolate(t, |a, b, w| a + w * (b - a));
        assert!((at(0.3).unwrap() - 3.0).abs() < 1e-12);
        assert_eq!((at(1.0), at(-0.1), at(2.2)), (None, None, None));
        assert_eq!((s.hold(1.9), s.hold(-1.0)), (Some(4.0), None));
    }

    #[test]
    fn quantiles() {
        assert_eq!(median(&mut [3.0, 1.0, 2.0]), Some(2.0));
        assert_eq!(quantile(&mut [], 0.9), None);
    }
}
