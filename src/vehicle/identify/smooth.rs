//! Smoothing and smooth differentiation by modulating functions.
//!
//! With a bump φ (∫φ = 1, zero at both ends with its derivative) `∫φ·ẏ = −∫φ̇·y`: a measured rate is compared with what
//! is thought to drive it without ever being differentiated, and both sides lose the same high frequencies, which
//! telemetry samples too slowly to be trusted (Shinbrot 1957; Preisig and Rippin 1993).

/// Time between the points of the grid, s.
pub const STEP_S: f64 = 0.004;

/// A bump `φ(s) ∝ 1 − cos(2πs/width)` on the grid, with its derivative.
pub struct Bump {
    value: Vec<f64>,
    slope: Vec<f64>,
}

impl Bump {
    pub fn new(width_s: f64) -> Self {
        let n = (width_s / STEP_S).round().max(4.0) as usize;
        let width = n as f64 * STEP_S;
        let turn = |k: usize| 2.0 * std::f64::consts::PI * k as f64 / n as f64;
        // ∫φ = 1 on the grid too: the trapezoid rule is exact for a full turn
        let value = (0..=n).map(|k| (1.0 - turn(k).cos()) / width).collect();
        let slope = (0..=n).map(|k| 2.0 * std::f64::consts::PI / width * turn(k).sin() / width).collect();
        Self { value, slope }
    }

    /// Points before and after that a smoothed point rests on.
    pub fn reach(&self) -> usize {
        self.value.len() / 2
    }

    /// `∫φ(s − t)·x(s) ds` at every point (zero-padded at the ends).
    pub fn smooth(&self, x: &[f64]) -> Vec<f64> {
        self.correlate(&self.value, x)
    }

    /// `∫φ(s − t)·ẋ(s) ds` at every point, without differentiating `x`.
    pub fn differentiate(&self, x: &[f64]) -> Vec<f64> {
        let mut y = self.correlate(&self.slope, x);
        for v in &mut y {
            *v = -*v;
        }
        y
    }

    fn correlate(&self, kernel: &[f64], x: &[f64]) -> Vec<f64> {
        let half = self.reach();
        (0..x.len())
            .map(|i| {
                let from = i.saturating_sub(half);
                let skip = half - (i - from);
                let sum: f64 = kernel.iter().skip(skip).zip(&x[from..]).map(|(k, v)| k * v).sum();
                sum * STEP_S
            })
            .collect()
    }
}

/// A first-order lag `τẏ = x − y` over points of the grid, exact for `x` held between them.
pub fn lag(x: &[f64], time_constant_s: f64) -> Vec<f64> {
    if time_constant_s <= 0.0 {
        return x.to_vec();
    }
    let keep = (-STEP_S / time_constant_s).exp();
    let mut state = x.first().copied().unwrap_or_default();
    x.iter()
        .map(|v| {
            state = *v + (state - *v) * keep;
            state
        })
        .collect()
}

/// Where a sampled function with its largest value at `best` peaks, between the points: the vertex of the parabola
/// through three of them, as an offset in points.
pub fn vertex(values: &[f64], best: usize) -> f64 {
    let (Some(a), Some(b), Some(c)) =
        (best.checked_sub(1).and_then(|i| values.get(i)), values.get(best), values.get(best + 1))
    else {
        return 0.0;
    };
    let bend = a - 2.0 * b + c;
    if bend < 0.0 { (0.5 * (a - c) / bend).clamp(-0.5, 0.5) } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn smoothing_a_derivative_needs_no_derivative() {
        let bump = Bump::new(0.3);
        let wave = |f: fn(f64) -> f64| (0..600).map(|i| f(3.0 * i as f64 * STEP_S)).collect::<Vec<_>>();
        let (sine, cosine) = (wave(f64::sin), wave(f64::cos));
        let (slope, smooth) = (bump.differentiate(&sine), bump.smooth(&cosine));
        // sums in place of integrals: right to a thousandth of the amplitude, which is 3
        for i in 100..500 {
            assert!((slope[i] / 3.0 - smooth[i]).abs() < 1e-3, "{i}: {} {}", slope[i], 3.0 * smooth[i]);
        }
        assert!((bump.smooth(&[1.0; 400])[200] - 1.0).abs() < 1e-12);
    }

    #[test]
    fn a_lag_reaches_63_percent_after_its_time_constant() {
        let mut step = vec![1.0; 100];
        step[0] = 0.0;
        let y = lag(&step, 10.0 * STEP_S);
        assert!((y[10] - (1.0 - (-1.0f64).exp())).abs() < 1e-12);
    }

    #[test]
    fn the_vertex_of_a_parabola() {
        let values: Vec<f64> = (0..5).map(|i| -(f64::from(i) - 2.3).powi(2)).collect();
        assert!((vertex(&values, 2) - 0.3).abs() < 1e-12);
        assert_eq!(vertex(&values, 0), 0.0);
    }
}
