use nalgebra::Vector3;
use std::f64::consts::SQRT_2;

/// The autopilot's low-pass filter on an inertial sensor: second-order Butterworth, so that slow motion comes late by
/// √2/ω and nothing else, and rotor vibration is damped.
#[derive(Debug, Clone)]
pub(super) struct LowPass {
    b0: f64,
    a1: f64,
    a2: f64,
    /// Delayed terms (transposed form).
    s1: Vector3<f64>,
    s2: Vector3<f64>,
    started: bool,
}

impl LowPass {
    /// With this delay at low frequencies, sampled every `period_s`; `None` when the delay is below one period and
    /// no such filter exists.
    pub fn with_delay(delay_s: f64, period_s: f64) -> Option<Self> {
        if delay_s <= period_s {
            return None;
        }
        // bilinear transform: its warping leaves the delay at low frequencies as it is
        let k = SQRT_2 / delay_s * period_s / 2.0;
        let norm = 1.0 / (1.0 + SQRT_2 * k + k * k);
        Some(Self {
            b0: k * k * norm,
            a1: 2.0 * (k * k - 1.0) * norm,
            a2: (1.0 - SQRT_2 * k + k * k) * norm,
            s1: Vector3::zeros(),
            s2: Vector3::zeros(),
            started: false,
        })
    }

    pub fn apply(&mut self, x: Vector3<f64>) -> Vector3<f64> {
        if !self.started {
            // as if x had been there for ever
            self.s2 = x * (self.b0 - self.a2);
            self.s1 = x * (2.0 * self.b0 - self.a1) + self.s2;
            self.started = true;
        }
        let y = x * self.b0 + self.s1;
        self.s1 = x * (2.0 * self.b0) - y * self.a1 + self.s2;
        self.s2 = x * self.b0 - y * self.a2;
        y
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn slow_ramps_come_late_by_the_delay() {
        let mut f = LowPass::with_delay(0.014, 0.0025).unwrap();
        let mut late = 0.0;
        for i in 0..2000 {
            let t = 0.0025 * f64::from(i);
            late = t - f.apply(Vector3::x() * t).x;
        }
        assert!((late - 0.014).abs() < 1e-6, "{late}");
    }

    #[test]
    fn it_starts_without_a_transient_and_stops_rotor_frequencies() {
        let mut f = LowPass::with_delay(0.014, 0.0025).unwrap();
        for _ in 0..10 {
            assert!((f.apply(Vector3::z() * -9.81).z + 9.81).abs() < 1e-12);
        }
        let peak = (0..400)
            .map(|i| (f.apply(Vector3::z() * (-9.81 + (2.3 * f64::from(i)).sin())).z + 9.81).abs())
            .fold(0.0, f64::max);
        assert!(peak < 0.03, "{peak}");
        assert!(LowPass::with_delay(0.001, 0.0025).is_none());
    }
}
