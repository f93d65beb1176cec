use crate::sim::random::Random;
use nalgebra::Vector3;

const FEET_PER_METRE: f64 = 3.280_84;

/// How rough the air is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Turbulence {
    /// Mean wind at 20 ft, m/s, which sets the intensity: 7.7 is light, 15.4 moderate, 23.1 severe (MIL-F-8785C).
    pub wind_at_20ft_mps: f64,
    /// Direction of the longitudinal axis, east of north, rad.
    pub heading_rad: f64,
}

/// Dryden turbulence near the ground (MIL-F-8785C §3.7.1.2 and §3.7.2, below 1000 ft), frozen in the air that passes.
///
/// Each component is white noise through its shaping filter, in time with T = L/V:
/// `u: σ√(2T)/(1 + Ts)` and `v, w: σ√T(1 + √3·Ts)/(1 + Ts)²`, both of variance σ². The filters are sampled exactly
/// (transition and covariance over the step), so neither variance nor spectrum depends on the step.
#[derive(Debug, Clone)]
pub struct Dryden {
    along: Vector3<f64>,
    across: Vector3<f64>,
    wind_at_20ft_mps: f64,
    random: Random,
    u: f64,
    v: Cascade,
    w: Cascade,
}

/// Scale lengths (m) and intensities (m/s) at a height.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Scales {
    horizontal_m: f64,
    vertical_m: f64,
    horizontal_mps: f64,
    vertical_mps: f64,
}

impl Scales {
    fn at(height_m: f64, wind_at_20ft_mps: f64) -> Self {
        let h = (height_m * FEET_PER_METRE).clamp(10.0, 1000.0);
        let k = 0.177 + 0.000_823 * h;
        let vertical_mps = 0.1 * wind_at_20ft_mps;
        Self {
            horizontal_m: h / k.powf(1.2) / FEET_PER_METRE,
            vertical_m: h / FEET_PER_METRE,
            horizontal_mps: vertical_mps / k.powf(0.4),
            vertical_mps,
        }
    }
}

impl Dryden {
    pub fn new(t: Turbulence, mut random: Random) -> Self {
        let (sin, cos) = t.heading_rad.sin_cos();
        let u = random.normal();
        let v = Cascade::stationary(&mut random);
        let w = Cascade::stationary(&mut random);
        Self {
            along: Vector3::new(cos, sin, 0.0),
            across: Vector3::new(-sin, cos, 0.0),
            wind_at_20ft_mps: t.wind_at_20ft_mps,
            random,
            u,
            v,
            w,
        }
    }

    /// The turbulence after `step_s` seconds in which air passes the vehicle at `through_air_ned_mps`.
    pub fn advance(&mut self, step_s: f64, height_m: f64, through_air_ned_mps: Vector3<f64>) -> Vector3<f64> {
        let s = Scales::at(height_m, self.wind_at_20ft_mps);
        // at rest in still air frozen turbulence would never change: eddies still drift past at walking pace
        let speed = through_air_ned_mps.norm().max(1.0);
        let (dh, dv) = (step_s * speed / s.horizontal_m, step_s * speed / s.vertical_m);
        let decay = (-dh).exp();
        // 1 − e^(−2d) without cancellation
        self.u = self.u * decay + (-(-2.0 * dh).exp_m1()).sqrt() * self.random.normal();
        self.v.advance(dh, &mut self.random);
        self.w.advance(dv, &mut self.random);
        (self.along * self.u + self.across * self.v.output()) * s.horizontal_mps
            + Vector3::z() * (self.w.output() * s.vertical_mps)
    }
}

/// (1 + √3 s)/(1 + s)² driven by white noise of unit intensity, time in units of T: output variance 1.
#[derive(Debug, Clone, Copy)]
struct Cascade {
    x: f64,
    rate: f64,
}

impl Cascade {
    /// Drawn from the stationary distribution: x and its rate are independent, each of variance 1/4.
    fn stationary(random: &mut Random) -> Self {
        Self { x: 0.5 * random.normal(), rate: 0.5 * random.normal() }
    }

    fn output(&self) -> f64 {
        self.x + 3f64.sqrt() * self.rate
    }

    /// ẍ + 2ẋ + x = w over `d`: transition e^(−d)[1+d, d; −d, 1−d], and covariance from ∫sⁿe^(−2s) over [0, d].
    fn advance(&mut self, d: f64, random: &mut Random) {
        let e = (-d).exp();
        let (i0, i1, i2) = integrals(d);
        let (xx, xr, rr) = (i2, i1 - i2, i0 - 2.0 * i1 + i2);
        // Cholesky factor, rate first: its variance is the large one
        let a = rr.max(0.0).sqrt();
        let b = if a > 0.0 { xr / a } else { 0.0 };
        let c = (xx - b * b).max(0.0).sqrt();
        let (n1, n2) = (random.normal(), random.normal());
        let (x, rate) = (self.x, self.rate);
        self.x = e * ((1.0 + d) * x + d * rate) + b * n1 + c * n2;
        self.rate = e * (-d * x + (1.0 - d) * rate) + a * n1;
    }
}

/// ∫₀ᵈ sⁿ e^(−2s) ds for n = 0, 1, 2.
fn integrals(d: f64) -> (f64, f64, f64) {
    if d < 0.02 {
        // the closed forms cancel here; four terms of the series leave a relative error below 1e-7
        let series = |n: f64| {
            let term = |k: f64, c: f64| c * d.powi(k as i32) / (n + 1.0 + k);
            d.powi(n as i32 + 1) * (term(0.0, 1.0) + term(1.0, -2.0) + term(2.0, 2.0) + term(3.0, -4.0 / 3.0))
        };
        return (series(0.0), series(1.0), series(2.0));
    }
    let e = (-2.0 * d).exp();
    ((1.0 - e) / 2.0, (1.0 - e * (1.0 + 2.0 * d)) / 4.0, (1.0 - e * (1.0 + 2.0 * d + 2.0 * d * d)) / 4.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sim::random::Part;
    use std::f64::consts::PI;

    #[test]
    fn scales_are_those_of_the_standard() {
        // MIL-F-8785C at 100 ft with 30 kt at 20 ft: k = .2593, σ_w = 1.543, σ_u = 2.647 m/s, L_u = 154.0 m
        let s = Scales::at(30.48, 15.43);
        assert!((s.vertical_mps - 1.543).abs() < 1e-3);
        assert!((s.horizontal_mps - 2.647).abs() < 2e-3, "{}", s.horizontal_mps);
        assert!((s.horizontal_m - 154.0).abs() < 1.0, "{}", s.horizontal_m);
        assert!((s.vertical_m - 30.48).abs() < 1e-2);
    }

    #[test]
    fn series_and_closed_form_meet() {
        let exact = |d: f64| {
            let e = (-2.0 * d).exp();
            ((1.0 - e) / 2.0, (1.0 - e * (1.0 + 2.0 * d)) / 4.0, (1.0 - e * (1.0 + 2.0 * d + 2.0 * d * d)) / 4.0)
        };
        let (s, c) = (integrals(0.0199), exact(0.0199));
        assert!((s.0 / c.0 - 1.0).abs() < 1e-7 && (s.1 / c.1 - 1.0).abs() < 1e-7 && (s.2 / c.2 - 1.0).abs() < 1e-5);
    }

    /// A long record of all three components, and its time scales.
    fn record(step: f64, n: usize) -> (Vec<Vector3<f64>>, Scales, f64) {
        let turbulence = Turbulence { wind_at_20ft_mps: 10.0, heading_rad: 0.0 };
        let mut d = Dryden::new(turbulence, Random::new(3, 1, Part::Turbulence));
        let speed = 20.0;
        let out = (0..n).map(|_| d.advance(step, 20.0, Vector3::x() * speed)).collect();
        (out, Scales::at(20.0, 10.0), speed)
    }

    #[test]
    fn variance_is_that_of_the_standard_whatever_the_step() {
        for step in [0.02, 0.5] {
            let (r, s, speed) = record(step, 400_000);
            let n = r.len() as f64;
            for (i, sigma, length) in [
                (0, s.horizontal_mps, s.horizontal_m),
                (1, s.horizontal_mps, s.horizontal_m),
                (2, s.vertical_mps, s.vertical_m),
            ] {
                let variance = r.iter().map(|x| x[i] * x[i]).sum::<f64>() / n;
                // correlated samples: the estimate's own spread is about √(2·2T/duration)
                let spread = (4.0 * (length / speed) / (n * step)).sqrt();
                let error = (variance / sigma.powi(2) - 1.0).abs();
                assert!(error < 4.0 * spread + 0.02, "step {step}, axis {i}: off by {error:.3}, spread {spread:.3}");
            }
        }
    }

    #[test]
    fn spectra_follow_the_dryden_forms() {
        let (step, n) = (0.02, 1 << 21);
        let (r, s, speed) = record(step, n);
        for f_hz in [0.02, 0.1, 0.3, 1.0, 3.0] {
            let w = 2.0 * PI * f_hz;
            let (tu, tw) = (s.horizontal_m / speed, s.vertical_m / speed);
            let first = |t: f64| 2.0 * t / (1.0 + (w * t).powi(2));
            let second = |t: f64| t * (1.0 + 3.0 * (w * t).powi(2)) / (1.0 + (w * t).powi(2)).powi(2);
            let expected = [
                s.horizontal_mps.powi(2) * first(tu),
                s.horizontal_mps.powi(2) * second(tu),
                s.vertical_mps.powi(2) * second(tw),
            ];
            for (axis, e) in expected.into_iter().enumerate() {
                let psd = bartlett(&r, axis, step, w);
                assert!((psd / e - 1.0).abs() < 0.2, "axis {axis} at {f_hz} Hz: {psd:.4} against {e:.4}");
            }
        }
    }

    /// Two-sided power spectral density at one frequency (rad/s), averaged over windowed segments.
    fn bartlett(r: &[Vector3<f64>], axis: usize, step: f64, w: f64) -> f64 {
        let length = 4096;
        let window = |k: usize| (PI * (k as f64 + 0.5) / length as f64).sin().powi(2);
        let power: f64 = (0..length).map(|k| window(k).powi(2)).sum();
        let segments = r.chunks_exact(length);
        let count = segments.len() as f64;
        let total: f64 = segments
            .map(|seg| {
                let (mut re, mut im) = (0.0, 0.0);
                for (k, x) in seg.iter().enumerate() {
                    let (sin, cos) = (w * step * k as f64).sin_cos();
                    re += window(k) * x[axis] * cos;
                    im += window(k) * x[axis] * sin;
                }
                re * re + im * im
            })
            .sum();
        total * step / (power * count)
    }
}
