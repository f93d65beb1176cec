use super::noise::{NoiseShape, quantise};
use crate::sim::dynamics::Truth;
use crate::sim::random::{Part, Random};

/// A barometer. One metre is about 11.4 Pa near 600 m.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BarometerSpec {
    pub rate_hz: f64,
    pub noise_pa: f64,
    pub shape: NoiseShape,
    /// Slow drift (weather, warming), Pa per √s.
    pub walk_pa: f64,
    pub step_pa: f64,
}

#[derive(Debug, Clone)]
pub(super) struct Barometer {
    spec: BarometerSpec,
    random: Random,
    drift_pa: f64,
    last: Option<f64>,
}

impl Barometer {
    pub fn new(spec: BarometerSpec, seed: u64, vehicle: u8) -> Self {
        Self { spec, random: Random::new(seed, vehicle, Part::Barometer), drift_pa: 0.0, last: None }
    }

    /// Static pressure, Pa.
    pub fn read(&mut self, truth: &Truth, bias_pa: f64, extra_noise_pa: f64, frozen: bool) -> f64 {
        let s = &self.spec;
        self.drift_pa += NoiseShape::Gaussian.draw(s.walk_pa / s.rate_hz.max(1e-3).sqrt(), &mut self.random);
        let noise = s.shape.draw(s.noise_pa + extra_noise_pa, &mut self.random);
        let now = quantise(truth.pressure_pa + self.drift_pa + bias_pa + noise, s.step_pa);
        let out = if frozen { self.last.unwrap_or(now) } else { now };
        self.last = Some(out);
        out
    }
}
