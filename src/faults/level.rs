//! How far a healthy residual may stray, from how often a false alarm is bearable.

/// Largest size, in standard deviations of one axis, that Gaussian noise of `axes` axes exceeds with a probability of at
/// most `p` at one look.
///
/// From the tail bounds `P(|x| > u) ≤ 2φ(u)/u` for one axis, `exp(−u²/2)` for two and `2φ(u)(u + 1/u)` for three
/// (Abramowitz and Stegun 7.1.13 and 26.4.4–26.4.5): never too small.
pub(super) fn quantile(p: f64, axes: usize) -> f64 {
    let density = |u: f64| (-0.5 * u * u).exp() / std::f64::consts::TAU.sqrt();
    let tail = |u: f64| match axes {
        1 => 2.0 * density(u) / u,
        2 => (-0.5 * u * u).exp(),
        _ => 2.0 * density(u) * (u + 1.0 / u),
    };
    // the tails fall for u above 1
    let (mut low, mut high) = (1.0, 40.0);
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        if tail(middle) > p { low = middle } else { high = middle }
    }
    high
}

/// The chance of exceeding at one look that keeps a residual, smoothed over `span_s`, to `per_hour` false alarms.
///
/// What is smoothed over a time can leave its bound anew a few times in that time, whatever the rate of its samples:
/// ten looks in each are counted.
pub(super) fn chance(per_hour: f64, span_s: f64) -> f64 {
    (per_hour * span_s / (3600.0 * 10.0)).clamp(1e-15, 0.1)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_are_those_of_the_tables_or_a_little_above() {
        // two-sided normal, Rayleigh and Maxwell quantiles
        for (p, axes, exact) in [(1e-3, 1, 3.2905), (1e-6, 1, 4.8916), (1e-3, 2, 3.7169), (1e-3, 3, 4.0331)] {
            let u = quantile(p, axes);
            assert!((0.0..0.03).contains(&(u - exact)), "{p} {axes}: {u}");
        }
        assert!(quantile(1e-9, 3) > quantile(1e-6, 3));
    }
}
